"""The verdict on a finished search, every word of it, and what makes it doubtful."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hybridsurrogate.diagnosis.checks.caution import Caution
from hybridsurrogate.diagnosis.checks.columns import better_columns
from hybridsurrogate.diagnosis.checks.data import gross_errors, mirrored, single_rows
from hybridsurrogate.diagnosis.checks.residuals import (
    ResidualCheck,
    check_residuals,
    has_residual_structure,
    probability_right,
)
from hybridsurrogate.diagnosis.checks.simulation import EmulatorCheck
from hybridsurrogate.diagnosis.fitting.result import Conclusion, Settings
from hybridsurrogate.diagnosis.search.candidate import Candidate
from hybridsurrogate.diagnosis.search.forward_selection import SearchStep
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


@dataclass(frozen=True)
class Verdict:
    """What was concluded.

    Attributes
    ----------
    word : {"adequate", "named", "nearest", "ambiguous", "unexplained", "undecided"}
    concerns : {"simulation", "noise", "inputs", "data", "prior"} or None
        What is at fault; None where nothing is, or the data cannot decide.
    open : {"runs", "rows", "prior"} or None
        Of an undecided verdict: what cannot decide.
    same_curve : tuple of str
        Other kinds that draw the same curve through these rows as the most probable one.
    share : float
        Probability of the most probable kind and of these, given that something is wrong.
    """

    word: str
    concerns: str | None = None
    open: str | None = None
    same_curve: tuple[str, ...] = ()
    share: float = 0.0


def conclude(
    steps: Sequence[SearchStep],
    false_alarm_rate: float,
    residual_check: ResidualCheck | None,
    hidden: float,
    kept_by_prior: bool,
) -> Verdict:
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
    hidden : float
        How large an effect the runs may hide at the measured rows, in units of the noise; 0 where
        they are enough, or the simulation itself is run.
    kept_by_prior : bool
        Whether an emulated parameter is at an end of its prior.
    """
    first = steps[0]
    found = first.conditional
    word = _word(first.chosen, found)
    same: tuple[str, ...] = ()
    share = 0.0
    if first.is_accepted:
        same = kinds_of_same_curve(found, first.chosen)
        of_kind = found.kind_shares
        share = sum(of_kind[kind] for kind in (first.chosen.kind, *same))
        if word == "ambiguous" and share >= SETTINGS.named:
            word = "named"
    last = [step for step in steps if step.is_accepted][-1:]
    if word == "named" and any(has_residual_structure(step, residual_check) for step in last):
        word = "nearest"
    cause = first.chosen.cause
    test = first.test
    assert test is not None  # only folds have none
    if hidden > size_of_effect(first):
        return Verdict("undecided", None, "runs")
    if word == "adequate" and test.p_value <= false_alarm_rate:
        return Verdict("undecided", None, "rows")
    if word != "adequate" and kept_by_prior:
        return Verdict("undecided", None, "prior")
    return Verdict(word, None if cause is None else cause.concerns, None, same, share)


def given_doubts(verdict: Verdict, first: SearchStep, doubts: Sequence[Caution]) -> Verdict:
    """Return the verdict: no cause in the output has the name alone on doubtful data.

    Parameters
    ----------
    verdict : Verdict
    first : SearchStep
    doubts : sequence of Caution
        Of the data.
    """
    cause = first.chosen.cause
    rests_on_it = any(one.about in ("data", "columns") for one in doubts)
    if verdict.word == "named" and rests_on_it and cause is not None and cause.changes_output:
        return replace(verdict, word="nearest")
    return verdict


def _word(chosen: Candidate, found: Search) -> str:
    """Return the verdict by probability alone."""
    if chosen.cause is None:
        return "adequate"
    if not chosen.has_name:
        return "unexplained"
    return "named" if found.kind_shares[chosen.kind] >= SETTINGS.named else "ambiguous"


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
        worth = result.probability[k] > 0.01 * result.probability[1:].max()
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
