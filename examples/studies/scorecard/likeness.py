"""How near a wrong kind comes to the truth: whether any test could have told the two apart."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
from hidden_effects import noises
from hidden_effects.cases import Case

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.search.context import SearchContext
from hybridsurrogate.diagnosis.search.search import best_modes

# neither says what the curve is: nothing is wrong, or a curve of any shape
_NAMELESS = ("none", "unexplained")


def distance(case: Case, diagnosis: hs.DiscrepancyDiagnosis) -> float:
    """Return the chi-square by which the truth beats the kind that was found, on average.

    All causes of that kind are fitted, with the parameters, to the noise-free truth at the measured
    inputs. What the best of them misses, squared and summed in noise standard deviations, is how
    much lower the truth's chi-square is on average over the noise.

    Parameters
    ----------
    case : Case
        With one hidden effect.
    diagnosis : DiscrepancyDiagnosis
        Of this case, fitted.

    Returns
    -------
    float
        NaN where the right kind was found, or nothing is hidden, or several effects are; infinite
        where what was found draws no curve of its own, or the truth is in the noise.
    """
    hidden, found = case.truth["kind"], diagnosis.best_cause_.kind
    if hidden in ("none", found) or "kinds" in case.truth:
        return float("nan")
    search, truth = diagnosis.search_, case.truth["mu"]
    named = [w for w in search.candidates if w.cause and w.cause.kind == found]
    mine = [w.cause for w in named if w.cause and w.cause.changes_output]
    # a curve of size zero would draw the truth of a case whose noise alone is strange
    if not mine or found in _NAMELESS or hidden in noises.KINDS:
        return float("inf")
    near = [w.fit for w in named if w.cause and w.cause.changes_output]
    context = SearchContext.of(replace(search.problem, y=truth), search.context.emulator)
    with warnings.catch_warnings():
        # a simulation may leave its domain on the way; such fits end at infinity
        warnings.simplefilter("ignore", RuntimeWarning)
        null = context.best_null()
        # curves alone are compared, not with "nothing is wrong"
        prior = np.append(-np.inf, np.zeros(len(mine)))
        fits, _ = best_modes(context, mine, null, prior, [None] * len(mine), is_coarse=True)
        # what fitted the data so well that it was taken for the truth is a start, too
        fits += best_modes(context, mine, null, prior, near, is_coarse=False)[0]
    squares = [fit.mode.squares for fit in fits if np.isfinite(fit.mode.objective)]
    return float(min(squares, default=np.inf) / case.truth["noise_sd"] ** 2)
