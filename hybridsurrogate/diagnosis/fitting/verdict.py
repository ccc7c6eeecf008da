"""The verdict on a finished search: every word of it is chosen here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hybridsurrogate.diagnosis.checks.caution import Caution
from hybridsurrogate.diagnosis.checks.residuals import ResidualCheck, has_residual_structure
from hybridsurrogate.diagnosis.search.candidate import Candidate
from hybridsurrogate.diagnosis.search.forward_selection import SearchStep
from hybridsurrogate.diagnosis.search.local_prediction import draw_the_same, predicted_rows
from hybridsurrogate.diagnosis.search.search import Search
from hybridsurrogate.inference.evidence.settings import SETTINGS


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
