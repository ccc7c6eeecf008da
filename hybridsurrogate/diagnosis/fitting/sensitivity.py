"""Whether a verdict rests on a prior: the same evidence where priors are halved and doubled."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
from scipy import special

from hybridsurrogate.diagnosis.fitting.result import DiagnosisResult
from hybridsurrogate.diagnosis.fitting.verdict import conclude
from hybridsurrogate.diagnosis.search.candidate import Candidate
from hybridsurrogate.diagnosis.search.forward_selection import SearchStep
from hybridsurrogate.diagnosis.search.search import Search
from hybridsurrogate.inference.evidence.marginal_likelihood import scan
from hybridsurrogate.types import FloatArray

# halved and doubled, as in power scaling (Kallioinen and others 2024, Statistics and Computing
# 34:57), of which this changes the width and not the power
_FACTORS = (0.5, 2.0)
_PRIORS = ("nothing is wrong", "parameters", "effect sizes")


def prior_sensitivity(result: DiagnosisResult) -> pd.DataFrame:
    """Return the verdict under priors halved and doubled, one row each; the first is as it was.

    To first order around the fit of each cause, as the search compares them: the odds of "nothing
    is wrong", the standard deviation of every parameter, and the largest size of an effect.

    Parameters
    ----------
    result : DiagnosisResult

    Returns
    -------
    pandas.DataFrame
        Columns prior, factor, verdict, cause, probability (of this kind), nothing (probability),
        changes (whether verdict or kind differ from the first row's).
    """
    first = result.steps[0]
    found = _concluded(result, first)
    # "nearest" may be the word for what doubtful data would name, whatever the priors
    doubted = found["verdict"] == "named" and result.conclusion.verdict == "nearest"
    rows = [{"prior": "as given", "factor": 1.0, **found}]
    for prior in _PRIORS:
        for factor in _FACTORS:
            search = _under(first.conditional, prior, factor)
            nothing = search.probability[0] > 0.5
            chosen = search.candidates[0 if nothing else search.leader]
            step = replace(first, search=search, conditional=search, chosen=chosen)
            rows.append({"prior": prior, "factor": factor, **_concluded(result, step)})
    table = pd.DataFrame(rows)
    if doubted:
        table["verdict"] = table["verdict"].replace("named", "nearest")
    same = (table["verdict"] == table["verdict"][0]) & (table["cause"] == table["cause"][0])
    return table.assign(changes=~same)


def _under(search: Search, prior: str, factor: float) -> Search:
    """Return the search with one prior ``factor`` times as wide, or odds so many times as high."""
    if prior == "nothing is wrong":
        none, *causes = search.candidates
        return replace(search, candidates=[none.moved(float(np.log(factor))), *causes])
    on_slopes, on_sizes = (factor, 1.0) if prior == "parameters" else (1.0, factor)
    largest = search.sizes[-1] * on_sizes
    sizes = np.geomspace(min(search.sizes[0], largest / 2), largest, len(search.sizes))
    candidates = [
        w
        if w.is_estimate or not np.isfinite(w.log_evidence)
        else w.moved(_gain(search, w, sizes, on_slopes))
        for w in search.candidates
    ]
    return replace(search, candidates=candidates)


def _gain(search: Search, w: Candidate, sizes: FloatArray, on_slopes: float) -> float:
    """Return how much more evidence a cause has under other priors."""
    parts, y = search.context.linearise(w.fit), search.problem.y[None]
    args = y, w.fit.sigma, search.context.noise
    before = scan(parts, *args, search.sizes)[0]
    after = scan(replace(parts, G=on_slopes * parts.G), *args, sizes)[0]
    return float(special.logsumexp(after) - special.logsumexp(before))


def _concluded(result: DiagnosisResult, first: SearchStep) -> dict[str, object]:
    """Return verdict, cause and probabilities where this is the first step."""
    found = conclude(
        [first, *result.steps[1:]],
        result.settings.false_alarm_rate,
        result.conclusion.residual_check,
        result.emulator_check,
        result.before.posterior_,
    )
    search, kind = first.conditional, first.chosen.kind
    alike = [w.kind == kind for w in search.candidates]
    return {
        "verdict": found.verdict,
        "cause": kind,
        "probability": float(search.probability[alike].sum()),
        "nothing": float(search.probability[0]),
    }
