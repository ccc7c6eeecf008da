"""What a diagnosis concludes: one rule for all who ask."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hybridsurrogate.diagnosis.checks.emulator import MOST_OPEN
from hybridsurrogate.diagnosis.checks.residuals import ResidualCheck, leaves_structure
from hybridsurrogate.diagnosis.search.evidence import family_shares, verdict_on
from hybridsurrogate.diagnosis.search.forward_selection import Step
from hybridsurrogate.diagnosis.search.local_prediction import predict_locally


@dataclass(frozen=True)
class Verdict:
    """What was concluded.

    Attributes
    ----------
    word : {"adequate", "named", "nearest", "ambiguous", "unexplained", "undecided"}
    concerns : {"simulation", "noise", "inputs", "data", "prior"} or None
        What is at fault; None where nothing is, or none can tell.
    open : {"runs", "rows", "prior"} or None
        Of an undecided verdict: what cannot tell.
    """

    word: str
    concerns: str | None = None
    open: str | None = None


def conclude(
    steps: Sequence[Step],
    false_alarm_rate: float,
    residual_check: ResidualCheck | None,
    left_open: float,
    kept_by_prior: bool,
) -> Verdict:
    """Return the verdict on a finished search.

    A name or "adequate" needs runs, rows and priors that can tell. They cannot where

    - the runs leave the simulation open by more than the noise (`EmulatorCheck.left_open`), and
      by more than the effect that was found: of 60 blind cases in which they did so, names were
      right in 5 of 5 whose effect was larger and in none of 11 whose effect was smaller,
    - the test says that something is wrong, p <= ``false_alarm_rate``, and the evidence favours
      no cause over none,
    - the data push a parameter against an end of its prior, and the simulation cannot be run
      beyond it to see whether that is all.

    Parameters
    ----------
    steps : sequence of Step
    false_alarm_rate : float
    residual_check : ResidualCheck or None
        Of the last cause that was accepted.
    left_open : float
        What the runs leave open of the simulation at the measured rows, in units of the noise; 0
        where the simulation itself is run.
    kept_by_prior : bool
        Whether an emulated parameter is at an end of its prior.
    """
    first = steps[0]
    word = verdict_on(first.chosen, first.given_others)
    last = [step for step in steps if step.is_accepted][-1:]
    if word == "named" and any(leaves_structure(step, residual_check) for step in last):
        word = "nearest"
    shares = family_shares(first.given_others)
    concerns = max(shares, key=lambda name: shares[name]) if word != "adequate" else None
    test = first.test
    assert test is not None  # only folds have none
    if left_open > max(MOST_OPEN, size_of_effect(first)):
        return Verdict("undecided", None, "runs")
    if word == "adequate" and test.p_value <= false_alarm_rate:
        return Verdict("undecided", None, "rows")
    if word != "adequate" and kept_by_prior:
        return Verdict("undecided", None, "prior")
    return Verdict(word, concerns)


def size_of_effect(step: Step) -> float:
    """Return how far a cause moves the predictions at the measured rows, in units of the noise.

    The root mean square over the rows; zero where nothing was accepted, or noise alone.
    """
    if not step.is_accepted:
        return 0.0
    result, w = step.search, step.chosen
    X = result.problem.X
    means = [predict_locally(result, one, X)[0] for one in (result.candidates[0], w)]
    return float(np.sqrt(np.mean((means[1] - means[0]) ** 2))) / w.sigma
