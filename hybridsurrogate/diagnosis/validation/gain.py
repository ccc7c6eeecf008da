"""What an extension is worth on rows it has not seen."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hybridsurrogate.notebook import table
from hybridsurrogate.numerics import digits
from hybridsurrogate.scoring.scores import COVERAGE_LEVEL
from hybridsurrogate.types import FloatArray

# of the narrower of two intervals whose coverage is shown: a choice of presentation
INNER_LEVEL = 0.5
_HEADER = ("", "before", "after", "difference")


@dataclass(frozen=True)
class FoldGain:
    """Scores before and after on one held-out fold.

    Attributes
    ----------
    kind : str
        What the fold's search chose: "none", a kind, or "kind + kind", sorted.
    n_rows : int
    elpd_before, elpd_after : float
        Mean log predictive density per row.
    standard_error : float
        Of their paired difference; NaN with a single row.
    """

    kind: str
    n_rows: int
    elpd_before: float
    elpd_after: float
    standard_error: float


@dataclass(frozen=True)
class HeldOutGain:
    """Scores before and after an extension on the same held-out rows.

    Attributes
    ----------
    elpd_before, elpd_after : float
        Mean log predictive density per row.
    elpd_difference, standard_error : float
        Their paired difference and its standard error.
    rmse_before, rmse_after : float
        Root mean square error of the predictive mean, in the units of y; of several outputs in
        units of the standard deviation of each.
    coverage_before, coverage_after : float
        Share of rows inside the 90 % predictive interval.
    half_before, half_after : float
        Share of rows inside the 50 % predictive interval.
    n_rows : int
    kinds : tuple of str
        What each fold's search chose, as ``kind`` of its `FoldGain`; empty for a test set.
    folds : tuple of FoldGain
        The same fold by fold; empty for a test set.
    rmse_error, coverage_error, half_error : float
        Standard errors of the paired differences of RMSE (by the delta method) and of coverage.
        NaN with a single row.

    Examples
    --------
    >>> one, zero = np.ones(2), np.zeros(2)
    >>> before = Scores(np.array([-2.0, -3.0]), np.array([1.0, 3.0]), one, zero, one)
    >>> after = Scores(-one, one, one, one, one)
    >>> print(gain_from(before, after))
                       before  after  difference
    ELPD a row          -2.50  -1.00  +1.50 ± 0.50
    RMSE                 2.24   1.00  -1.24 ± 0.89
    in 90 % intervals   100 %  100 %  0 % ± 0 %
    in 50 % intervals     0 %  100 %  +100 % ± 0 %
    2 held-out rows
    """

    elpd_before: float
    elpd_after: float
    elpd_difference: float
    standard_error: float
    rmse_before: float
    rmse_after: float
    coverage_before: float
    coverage_after: float
    half_before: float
    half_after: float
    n_rows: int
    kinds: tuple[str, ...] = ()
    folds: tuple[FoldGain, ...] = ()
    rmse_error: float = field(default=np.nan, compare=False)
    coverage_error: float = field(default=np.nan, compare=False)
    half_error: float = field(default=np.nan, compare=False)

    def __repr__(self) -> str:
        change = digits.plus_minus(self.elpd_difference, self.standard_error, sign=True)
        return f"{type(self).__name__}({change} nats a row on {self.n_rows} held-out rows)"

    def __str__(self) -> str:
        rows = [_HEADER, *self._lines()]
        widths = [max(len(row[k]) for row in rows) for k in range(3)]
        lines = [
            f"{name:<{widths[0]}}  {a:>{widths[1]}}  {b:>{widths[2]}}  {change}"
            for name, a, b, change in rows
        ]
        return "\n".join([*lines, self._rows()])

    def _repr_html_(self) -> str:
        return table(self._lines(), _HEADER, self._rows())

    def _rows(self) -> str:
        """Return how many rows were held out, and what was detected without them."""
        chosen = ", ".join(f"{kind} in {n}" for kind, n in Counter(self.kinds).most_common())
        folds = f"; the searches of {len(self.kinds)} folds chose {chosen}" if chosen else ""
        return f"{self.n_rows} held-out rows{folds}"

    def _lines(self) -> list[tuple[str, ...]]:
        """Return name, before, after and difference of each score."""
        change = self.rmse_after - self.rmse_before
        scores = (
            (self.elpd_before, self.elpd_after, self.elpd_difference, self.standard_error),
            (self.rmse_before, self.rmse_after, change, self.rmse_error),
        )
        out: list[tuple[str, ...]] = [
            (
                name,
                digits.score(before, error),
                digits.score(after, error),
                digits.plus_minus(change, error, sign=True),
            )
            for name, (before, after, change, error) in zip(
                ("ELPD a row", "RMSE"), scores, strict=True
            )
        ]
        shares = (
            (COVERAGE_LEVEL, self.coverage_before, self.coverage_after, self.coverage_error),
            (INNER_LEVEL, self.half_before, self.half_after, self.half_error),
        )
        for level, before, after, error in shares:
            points = digits.fixed(100 * (after - before), 0)
            sign = "+" if after > before and points != "0" else ""
            out.append(
                (
                    f"in {100 * level:.0f} % intervals",
                    f"{100 * before:.0f} %",
                    f"{100 * after:.0f} %",
                    f"{sign}{points} % ± {digits.fixed(100 * error, 0)} %",
                )
            )
        return out


class Scores(NamedTuple):
    """Pointwise scores of one fitted estimator on held-out rows, and the weights of the rows."""

    log_density: FloatArray
    error: FloatArray
    inside: FloatArray
    inside_half: FloatArray
    weight: FloatArray


class Held(NamedTuple):
    """Scores before and after on the held-out rows of one fold, and what its search chose."""

    before: Scores
    after: Scores
    kind: str


def in_one_word(kinds: Sequence[str]) -> str:
    """Return the kinds that a search chose, the same whichever of them came first.

    Examples
    --------
    >>> in_one_word(["step", "periodic"])
    'periodic + step'
    """
    return " + ".join(sorted(kinds))


def pointwise(
    estimator: Any,
    X: ArrayLike,
    y: FloatArray,
    weights: FloatArray | None = None,
    y_err: Any = None,
) -> Scores:
    """Return log density, error of the mean and whether the intervals cover y, for each row.

    Of what was measured; of several outputs errors in shares of the output's spread.
    """
    inside, half = estimator.interval_holds(X, y, (COVERAGE_LEVEL, INNER_LEVEL), y_err)
    y = np.asarray(y, dtype=float)
    error, weight = y - estimator.predict(X), np.ones(len(y)) if weights is None else weights
    # a value at a limit stands for all beyond it
    side = estimator.side_of(y)
    error = np.where(
        side < 0, np.minimum(error, 0), np.where(side > 0, np.maximum(error, 0), error)
    )
    density = estimator.log_predictive_density(X, y, y_err)
    scores = Scores(density, error, inside, half, weight)
    if error.ndim > 1:
        scores = scores._replace(
            error=error / estimator.data_.stacking.scale,
            weight=np.repeat(weight[:, None], y.shape[1], 1),
        )
    there = np.isfinite(y)
    return Scores(*(values[there] for values in scores))


def gain_on(before: Any, after: Any, X: ArrayLike, y: FloatArray, y_err: Any = None) -> HeldOutGain:
    """Return the gain of a fitted model after over one before, on a test set."""
    return gain_from(pointwise(before, X, y, None, y_err), pointwise(after, X, y, None, y_err))


# squares of predictions far away overflow: their RMSE is infinite
@np.errstate(over="ignore", invalid="ignore")
def gain_from(before: Scores, after: Scores, folds: tuple[FoldGain, ...] = ()) -> HeldOutGain:
    """Summarise two sets of pointwise scores of the same rows, each row with its weight."""
    weight = before.weight
    found: dict[str, Any] = {}
    per_row = []
    for word, scores in (("before", before), ("after", after)):
        rmse = float(np.sqrt(mean_and_error(scores.error**2, weight)[0]))
        found[f"elpd_{word}"] = mean_and_error(scores.log_density, weight)[0]
        found[f"rmse_{word}"] = rmse
        found[f"coverage_{word}"] = mean_and_error(scores.inside, weight)[0]
        found[f"half_{word}"] = mean_and_error(scores.inside_half, weight)[0]
        # d RMSE = d(mean of squares) / (2 RMSE): the delta method
        per_row.append(scores.error**2 / (2 * max(rmse, np.finfo(float).tiny)))
    change, error = mean_and_error(after.log_density - before.log_density, weight)
    return HeldOutGain(
        **found,
        elpd_difference=change,
        standard_error=error,
        n_rows=len(weight),
        kinds=tuple(fold.kind for fold in folds),
        folds=folds,
        rmse_error=mean_and_error(per_row[1] - per_row[0], weight)[1],
        coverage_error=mean_and_error(after.inside - before.inside, weight)[1],
        half_error=mean_and_error(after.inside_half - before.inside_half, weight)[1],
    )


def mean_and_error(values: FloatArray, weight: FloatArray) -> tuple[float, float]:
    """Return the weighted mean of rows and its standard error, NaN of a single row.

    Weights are fixed and rows independent, whatever their scatter:
    ``se^2 = n / (n - 1) sum_i w_i^2 (v_i - mean)^2 / (sum_i w_i)^2``, that of a plain mean where
    all weights are equal.
    """
    n, share = len(values), weight / weight.sum()
    mean = float(share @ values)
    if n < 2:
        return mean, float("nan")
    return mean, float(np.sqrt(n / (n - 1) * np.sum((share * (values - mean)) ** 2)))


def gain_over(folds: Sequence[Held]) -> HeldOutGain:
    """Return the gain over folds, each held out once."""
    befores, afters, _ = zip(*folds, strict=True)
    before, after = (
        Scores(*map(np.concatenate, zip(*scores, strict=True))) for scores in (befores, afters)
    )
    each = [gain_from(one.before, one.after) for one in folds]
    gains = tuple(
        FoldGain(held.kind, one.n_rows, one.elpd_before, one.elpd_after, one.standard_error)
        for held, one in zip(folds, each, strict=True)
    )
    return gain_from(before, after, gains)
