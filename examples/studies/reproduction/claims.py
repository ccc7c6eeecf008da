"""Ways to hold a claim against the scores of many seeds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from .scores import curves, select

HOLDS, WITHIN, FAILS = "holds", "holds within error", "does not hold"
# standard errors that a claim may miss by and still hold within error
REACH = 2.0
ROWS = {"in": "in range", "out": "out of range"}


@dataclass(frozen=True)
class Measured:
    """What came out: in words, the number, its Monte Carlo error over seeds, and the verdict."""

    what: str
    value: float
    error: float
    verdict: str


@dataclass(frozen=True)
class Claim:
    """One statement of the paper, and how to measure it.

    ``because`` says why it does not hold, where it does not; ``note`` why it holds only within
    error.
    """

    case: str
    text: str
    measure: Callable[[pd.DataFrame], Measured]
    because: str = ""
    note: str = ""


def mean_error(values: pd.Series) -> tuple[float, float]:
    """Return the mean over seeds and its standard error; one seed has none."""
    error = values.std(ddof=1) / np.sqrt(len(values)) if len(values) > 1 else 0.0
    return float(values.mean()), float(error)


def judged(miss: float, error: float) -> str:
    """Return the verdict on a claim that is missed by so much; nothing or less is a hit."""
    if miss <= 0:
        return HOLDS
    return WITHIN if miss <= REACH * error else FAILS


def optimum(
    case: str, scheme: str, rows: str, score: str, low: float, high: float
) -> Callable[[pd.DataFrame], Measured]:
    """Claim that the best beta lies between two.

    The best beta is that of the mean over seeds; its error is the scatter of the best beta when
    one seed is left out (jackknife). Within error: the best score between the two is not worse
    than the best of all by more than two standard errors of their difference over seeds.
    """

    def measure(frame: pd.DataFrame) -> Measured:
        sign = 1 if score == "ELPD" else -1
        curve = sign * curves(frame, case, scheme, rows, score)
        best = float(curve.mean().idxmax())
        seeds = curve.index if len(curve) > 1 else []
        left_out = [curve.drop(index=seed).mean().idxmax() for seed in seeds]
        # of n means without one seed; one seed alone tells no error
        error = float(np.std(left_out) * np.sqrt(len(left_out) - 1)) if left_out else 0.0
        allowed = curve.loc[:, (curve.columns >= low) & (curve.columns <= high)]
        inside = float(allowed.mean().idxmax())
        miss, spread = mean_error(curve[best] - curve[inside])
        return Measured(f"best beta {best:g}", best, error, judged(miss, spread))

    return measure


def greater(
    name: str,
    more: Callable[[pd.DataFrame], pd.Series],
    less: Callable[[pd.DataFrame], pd.Series],
    by: float = 0.0,
) -> Callable[[pd.DataFrame], Measured]:
    """Claim that one value exceeds another by at least so much, on average over seeds.

    It holds if it does so by more than two standard errors, within error if that is open.
    """

    def measure(frame: pd.DataFrame) -> Measured:
        value, error = mean_error(more(frame) - less(frame))
        verdict = judged(by - value, error)
        if verdict == HOLDS and value - by < REACH * error:
            verdict = WITHIN
        return Measured(f"{name} {value:+.3g}", value, error, verdict)

    return measure


def between(
    name: str, of: Callable[[pd.DataFrame], pd.Series], low: float, high: float
) -> Callable[[pd.DataFrame], Measured]:
    """Claim that a value lies between two, on average over seeds."""

    def measure(frame: pd.DataFrame) -> Measured:
        value, error = mean_error(of(frame))
        miss = max(low - value, value - high)
        return Measured(f"{name} {value:.3g}", value, error, judged(miss, error))

    return measure


def rising(
    case: str, scheme: str, rows: str, score: str, sign: int = 1
) -> Callable[[pd.DataFrame], Measured]:
    """Claim that a curve over beta never falls (``sign=-1``: never rises), on average over seeds.

    Measured is the largest step in the wrong direction, against its error over seeds.
    """

    def measure(frame: pd.DataFrame) -> Measured:
        steps = -sign * curves(frame, case, scheme, rows, score).diff(axis=1).iloc[:, 1:]
        worst = steps.mean().idxmax()
        value, error = mean_error(steps[worst])
        what = "no step back" if value <= 0 else f"largest step back {value:.3g} at beta {worst:g}"
        return Measured(what, value, error, judged(value, error))

    return measure


def at(case: str, scheme: str, rows: str, score: str, beta: float) -> Callable[..., pd.Series]:
    """Return the value at one beta, by seed."""
    return lambda frame: curves(frame, case, scheme, rows, score)[beta]


def best(
    case: str, scheme: str, rows: str, score: str, low: float = 0.0, high: float = 1.0
) -> Callable[..., pd.Series]:
    """Return the score at the beta that is best on average over seeds, by seed."""

    def of(frame: pd.DataFrame) -> pd.Series:
        curve = curves(frame, case, scheme, rows, score)
        curve = curve.loc[:, (curve.columns >= low) & (curve.columns <= high)]
        mean = curve.mean()
        return curve[mean.idxmax() if score == "ELPD" else mean.idxmin()]

    return of


def average(
    case: str, scheme: str, rows: str, score: str, low: float = 0.05, high: float = 0.95
) -> Callable[..., pd.Series]:
    """Return the mean over the beta between two, by seed."""

    def of(frame: pd.DataFrame) -> pd.Series:
        curve = curves(frame, case, scheme, rows, score)
        return curve.loc[:, (curve.columns >= low) & (curve.columns <= high)].mean(axis=1)

    return of


def alone(case: str, scheme: str, rows: str, score: str) -> Callable[..., pd.Series]:
    """Return the value of a model without beta, by seed."""
    return lambda frame: select(frame, case, scheme, rows, score).set_index("seed")["value"]


def least(values: Sequence[Callable[..., pd.Series]]) -> Callable[..., pd.Series]:
    """Return the smallest of several values, by seed."""
    return lambda frame: pd.concat([of(frame) for of in values], axis=1).min(axis=1)


def most(values: Sequence[Callable[..., pd.Series]]) -> Callable[..., pd.Series]:
    """Return the largest of several values, by seed."""
    return lambda frame: pd.concat([of(frame) for of in values], axis=1).max(axis=1)


def times(factor: float, of: Callable[..., pd.Series]) -> Callable[..., pd.Series]:
    """Return a multiple of a value."""
    return lambda frame: factor * of(frame)


def constant(value: float, of: Callable[..., pd.Series]) -> Callable[..., pd.Series]:
    """Return one number for every seed of another value."""
    return lambda frame: 0 * of(frame) + value
