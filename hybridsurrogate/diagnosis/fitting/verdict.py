"""The verdict on a finished search, every word of it, how sure it is, and what makes it doubtful.

The probabilities of a search suppose that the true cause is in the catalogue. No test of the data
can name a curve that fits as well. How often that misleads was counted on
blind cases with their kind in the catalogue and with it taken out, alone and together with a
further, smaller fault. Each is as frequent as among measured data sets. A logistic regression on
them predicts how often the most probable cause is the right one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy import special

from hybridsurrogate.diagnosis.checks.caution import Caution
from hybridsurrogate.diagnosis.checks.columns import better_columns
from hybridsurrogate.diagnosis.checks.data import gross_errors, mirrored, single_rows
from hybridsurrogate.diagnosis.checks.parameters import Settings
from hybridsurrogate.diagnosis.checks.simulation import EmulatorCheck
from hybridsurrogate.diagnosis.fitting.result import Conclusion
from hybridsurrogate.diagnosis.search.candidate import MIN_PROBABILITY, Candidate
from hybridsurrogate.diagnosis.search.forward_selection import SearchStep, tested
from hybridsurrogate.diagnosis.search.residuals import (
    ResidualCheck,
    check_residuals,
    has_residual_structure,
)
from hybridsurrogate.diagnosis.search.search import Search, draw_the_same, predicted_rows
from hybridsurrogate.diagnosis.search.simulated import detectable, smallest_detectable
from hybridsurrogate.diagnosis.validation.refit import accepted, with_rows
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.effects.noise.outliers import GrossError
from hybridsurrogate.inference.evidence.settings import SETTINGS
from hybridsurrogate.inference.procedure import at_prior_ends, effects_at_prior_ends
from hybridsurrogate.model.posterior import Posterior
from hybridsurrogate.model.problem import Problem
from hybridsurrogate.numerics import digits
from hybridsurrogate.studied import STUDIED


def conclude(
    steps: Sequence[SearchStep],
    false_alarm_rate: float,
    residual_check: ResidualCheck | None,
    emulator_check: EmulatorCheck | None,
    posterior: Posterior,
) -> Conclusion:
    """Return the verdict on a finished search.

    A name or "adequate" needs runs, rows and priors that can decide. They cannot where

    - the runs leave the simulation open by more than the noise, or of rounded counts by a third
      of it (`EmulatorCheck.hidden`), and by more than the detected effect. In 52 blind
      cases with 8 to 40 runs names were right in 5 of 5 whose effect was larger than this and in
      1 of 7 whose effect was smaller,
    - the test rejects that nothing is wrong, p <= ``false_alarm_rate``, and the evidence favours
      no cause over none,
    - the data push a parameter against an end of its prior, and the simulation cannot be run
      beyond it to see whether that is all.

    Parameters
    ----------
    steps : sequence of SearchStep
    false_alarm_rate : float
    residual_check : ResidualCheck or None
        Of the last cause that was accepted.
    emulator_check : EmulatorCheck or None
        None where the simulation itself is run.
    posterior : Posterior
        Without a cause.
    """
    first = steps[0]
    chosen, found, test = first.chosen, first.conditional, first.test
    assert test is not None  # only folds have none
    if emulator_check is not None and emulator_check.hidden > size_of_effect(first):
        return Conclusion("undecided", undecided_by="runs")
    if chosen.cause is None:
        if test.p_value <= false_alarm_rate:
            return Conclusion("undecided", undecided_by="rows")
        return Conclusion("adequate")
    if not posterior.model.basis.is_simulation and at_prior_ends(posterior):
        return Conclusion("undecided", undecided_by="prior")
    same, of_kind = kinds_of_same_curve(found, chosen), found.kind_shares
    share = sum(of_kind[kind] for kind in (chosen.kind, *same))
    last = next(step for step in reversed(steps) if step.is_accepted)
    word = "named" if share >= SETTINGS.naming_level else "ambiguous"
    if not chosen.has_name:
        word = "unexplained"
    elif word == "named" and has_residual_structure(last.conditional, last.chosen, residual_check):
        word = "nearest"
    return Conclusion(word, chosen.cause.concerns, None, same, share)


def kinds_of_same_curve(result: Search, chosen: Candidate) -> tuple[str, ...]:
    """Return the other kinds whose best form draws the same curve as a cause: `draw_the_same`.

    Parameters
    ----------
    result : Search
    chosen : Candidate
        Of its candidates.
    """
    best: dict[str, Candidate] = {}
    for k in np.argsort(-result.probability):
        w = result.candidates[k]
        worth = result.probability[k] > MIN_PROBABILITY * result.probability[1:].max()
        if w.cause is not None and not w.cause.is_process and worth:
            best.setdefault(w.kind, w)
    own = chosen.kind
    if chosen.cause is None or chosen.cause.is_process:
        return ()
    return tuple(
        kind for kind, w in best.items() if kind != own and draw_the_same(result, chosen, w)
    )


def size_of_effect(step: SearchStep) -> float:
    """Return how far a cause moves the predictions at the measured rows, in units of the noise.

    The root mean square over the rows; zero where nothing was accepted, or noise alone.
    """
    if not step.is_accepted:
        return 0.0
    result, w = step.search, step.chosen
    null, found = (predicted_rows(result, one)[0] for one in (result.candidates[0], w))
    return float(np.sqrt(np.mean((found - null) ** 2))) / w.fit.sigma


def concluded(
    steps: Sequence[SearchStep],
    before: Any,
    problem: Problem,
    emulator_check: EmulatorCheck | None,
    known: Sequence[Caution],
    settings: Settings,
) -> tuple[Conclusion, list[Caution]]:
    """Return what a search amounts to, and what makes it doubtful.

    Parameters
    ----------
    steps : sequence of SearchStep
    before : PowerScaledSurrogate
        Fitted.
    problem : Problem
        As it was prepared, with all rows.
    emulator_check : EmulatorCheck or None
    known : sequence of Caution
        Doubts from the search itself.
    settings : Settings
    """
    first, rate = steps[0], settings.false_alarm_rate
    last = [step for step in steps if step.is_accepted][-1:]
    check = check_residuals(last[0].conditional, last[0].chosen) if last else None
    found = conclude(steps, rate, check, emulator_check, before.posterior_)
    smallest, of_kinds = None, None
    if not last and first.test is not None:
        of_kinds = detectable(first.search, first.test, rate)
        smallest = smallest_detectable(first.search, first.test, rate)
    doubts = [*known, *_doubts(steps, before, problem, found.verdict)]
    cause = first.chosen.cause
    # no cause in the output has the name alone on doubtful data
    doubtful = any(one.about in ("data", "columns") for one in doubts)
    if found.verdict == "named" and doubtful and cause is not None and cause.changes_output:
        found = replace(found, verdict="nearest")
    right = None
    if found.verdict not in ("adequate", "unexplained", "undecided"):
        wrong = 1 - float(first.conditional.probability[0])
        several = len(tested(steps)) > 1
        right = wrong * probability_right(found.share, found.verdict == "nearest", several)
    conclusion = replace(
        found,
        probability_right=right,
        residual_check=check,
        smallest_detectable=smallest,
        detectable=of_kinds,
    )
    return conclusion, doubts


def _doubts(
    steps: Sequence[SearchStep], before: Any, problem: Problem, verdict: str
) -> list[Caution]:
    """Return what makes a search doubtful: single rows, columns and their units."""
    first, ranges = steps[0], before.data_.simulation.input_ranges
    found = with_rows(accepted(steps), steps)
    left_out = [
        one for cause in found if isinstance(cause, GrossError) for one in gross_errors(cause)
    ]
    if left_out:
        return left_out
    out = list(single_rows(first.search, first.chosen))
    none = float(first.search.probability[0])
    if verdict == "adequate" and none < 1 - SETTINGS.naming_level:
        leader = first.search.leader
        kind, share = first.search.candidates[leader].kind, first.search.probability[leader]
        out.append(
            Caution(
                "rows",
                f"The p-value shows nothing, but {kind} has {digits.percent(share)} of the "
                f"probability and the simulation as it is {digits.percent(none)}: measure more.",
            )
        )
    if verdict != "adequate":
        out += better_columns(first.search, ranges, first.chosen)
    return out if verdict in ("named", "nearest") else [*out, *mirrored(problem)]


def contradicted(posterior: Posterior, known: Sequence[Cause]) -> list[Caution]:
    """Return known effects of which the data show nothing, or against an end of their priors.

    Parameters
    ----------
    posterior : Posterior
        Of the extended model, whose first effects these are.
    known : sequence of Cause
    """
    said = [
        f"The data contradict what is known of an effect: the {one.name} is "
        f"{digits.number(one.mean)}, at the end of its prior. Widen it, or diagnose without it."
        for one in effects_at_prior_ends(posterior, len(known))
    ]
    for k, effect in enumerate(known):
        sizes = posterior.draws_of(k)[1]
        ends = [np.quantile(draws, (0.05, 0.95)) for draws in sizes.values()]
        if effect.changes_output and ends and all(low < 0 < high for low, high in ends):
            said.append(
                f"The data show nothing of a known effect: {effect.name} may be zero (90 % "
                "interval). Look whether it is where it is known to be, or diagnose without it."
            )
    return [Caution("prior", sentence) for sentence in said]


# of the measured data sets with a documented cause (docs/evidence/measured_data.md) some had one
# that the catalogue does not hold; coefficients of one, of the log odds within the catalogue, of
# residual structure, and of further causes. In tenfold cross-validation the odds gain 0.046
# (standard error 0.019) in the mean log score, residual structure 0.000 (0.007; 0.014 where
# searches stopped at one cause), further causes 0.003 (0.010): 284 cases decide on neither
_FOUND = STUDIED["probability_right"]
NOT_HELD, DOCUMENTED, N_CASES = (_FOUND[name] for name in ("not_held", "documented", "n_cases"))
_ONE, _ODDS, _STRUCTURE, _SEVERAL = (
    _FOUND[name] for name in ("one", "odds", "structure", "several")
)
# probabilities beyond it are all the same: no case was surer
_HIGHEST_PROBABILITY = 0.9999


def probability_right(share: float, has_residual_structure: bool, several: bool = False) -> float:
    """Return the probability that the most probable cause is right, given that something is wrong.

    Parameters
    ----------
    share : float
        Probability of its kind within the catalogue, given that something is wrong.
    has_residual_structure : bool
        Whether the verdict is "nearest".
    several : bool, default=False
        Whether further causes were accepted: two of the catalogue also imitate one outside it.

    Returns
    -------
    float
        Never more than ``share``.

    Examples
    --------
    >>> sure, unsure = probability_right(0.99, False), probability_right(0.6, False)
    >>> unsure < sure < 0.99
    True
    """
    odds = float(special.logit(min(max(share, 1 - _HIGHEST_PROBABILITY), _HIGHEST_PROBABILITY)))
    total = _ONE + _ODDS * odds + _STRUCTURE * has_residual_structure + _SEVERAL * several
    return min(share, 1 / (1 + math.exp(-total)))
