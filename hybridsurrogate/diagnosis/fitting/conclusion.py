"""The verdict on a finished search, and what makes it doubtful."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hybridsurrogate.diagnosis.checks.caution import Caution
from hybridsurrogate.diagnosis.checks.columns import better_columns
from hybridsurrogate.diagnosis.checks.data import gross_errors, mirrored, single_rows
from hybridsurrogate.diagnosis.checks.detectable import smallest_detectable
from hybridsurrogate.diagnosis.checks.emulator import EmulatorCheck
from hybridsurrogate.diagnosis.checks.outside import probability_right
from hybridsurrogate.diagnosis.checks.residuals import check_residuals
from hybridsurrogate.diagnosis.fitting.result import Conclusion, Settings
from hybridsurrogate.diagnosis.fitting.verdict import Verdict, conclude, given_doubts
from hybridsurrogate.diagnosis.search.forward_selection import SearchStep
from hybridsurrogate.diagnosis.simulated.detectable import detectable
from hybridsurrogate.diagnosis.validation.refit import accepted
from hybridsurrogate.diagnosis.validation.rows_left_out import with_rows
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.effects.noise.gross_error import GrossError
from hybridsurrogate.inference.prior_ends import at_prior_ends, effects_at_prior_ends
from hybridsurrogate.model.posterior import Posterior
from hybridsurrogate.model.problem import Problem
from hybridsurrogate.numerics import digits


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
    first, last = steps[0], [step for step in steps if step.is_accepted][-1:]
    check = check_residuals(last[0].conditional, last[0].chosen) if last else None
    posterior = before.posterior_
    verdict = conclude(
        steps,
        settings.false_alarm_rate,
        check,
        0.0 if emulator_check is None else emulator_check.hidden,
        not posterior.model.basis.is_simulation and bool(at_prior_ends(posterior)),
    )
    smallest, of_kinds = None, None
    if not last and first.test is not None:
        of_kinds = detectable(first.search, first.test, settings.false_alarm_rate)
        smallest = smallest_detectable(first.search, first.test, settings.false_alarm_rate)
    doubts = [*known, *_doubts(steps, before, problem, verdict.word)]
    verdict = given_doubts(verdict, first, doubts)
    conclusion = Conclusion(
        verdict.word,
        verdict.concerns,
        verdict.open,
        verdict.same_curve,
        _probability_right(first, verdict),
        check,
        smallest,
        of_kinds,
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


def _probability_right(first: SearchStep, verdict: Verdict) -> float | None:
    if verdict.word in ("adequate", "unexplained", "undecided"):
        return None
    wrong = 1 - float(first.conditional.probability[0])
    return wrong * probability_right(verdict.share, verdict.word == "nearest")
