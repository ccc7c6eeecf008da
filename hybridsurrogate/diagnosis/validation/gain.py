"""What an extension is worth on rows it has not seen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from hybridsurrogate.priors import FloatArray
from hybridsurrogate.scoring import elpd, paired_difference
from hybridsurrogate.scoring.scores import last_of_the_best

COVERAGE_LEVEL, HALF = 0.9, 0.5


@dataclass(frozen=True)
class FoldGain:
    """Scores before and after on one held-out fold.

    Attributes
    ----------
    kind : str
        What the fold's own search chose: "none", a kind, or "kind + kind", sorted.
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
class Gain:
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
        What each fold's own search chose, as ``kind`` of its `FoldGain`; empty for a test set.
    folds : tuple of FoldGain
        The same fold by fold; empty for a test set.
    scan : callable or None
        Returns the held-out scores over the weight beta on which the best weights rest. It is
        called when they are first asked for, and may take longer than the diagnosis.
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
    scan: Callable[[], pd.DataFrame | None] | None = field(default=None, repr=False, compare=False)

    def best_beta_before(self) -> float | None:
        """Return the weight of the simulation with the best held-out score, before.

        The largest of those as good; None for a test set, and where there is no weight to choose
        or trying takes minutes.
        """
        return self._best_beta("before")

    def best_beta_after(self) -> float | None:
        """Return the same after: larger where the simulation is worth more, its fault named."""
        return self._best_beta("after")

    def _best_beta(self, word: str) -> float | None:
        scan = None if self.scan is None else self.scan()
        return None if scan is None else best_beta(scan, word)


class Scores(NamedTuple):
    """Pointwise scores of one fitted estimator on held-out rows."""

    log_density: FloatArray
    error: FloatArray
    inside: FloatArray
    inside_half: FloatArray


class Held(NamedTuple):
    """Scores before and after on the held-out rows of one fold, and what its search chose."""

    before: Scores
    after: Scores
    kind: str


def best_beta(scan: pd.DataFrame, word: str) -> float:
    """Return the largest weight with the best score in one column of a scan over beta."""
    return float(scan["beta"].iloc[last_of_the_best(scan[word])])


def in_one_word(kinds: Sequence[str]) -> str:
    """Return the kinds that a search chose, the same whichever of them came first.

    Examples
    --------
    >>> in_one_word(["step", "periodic"])
    'periodic + step'
    """
    return " + ".join(sorted(kinds))


def pointwise(estimator: Any, X: ArrayLike, y: FloatArray) -> Scores:
    """Return log density, error of the mean and whether the intervals hold y, for each row.

    Of what was measured; of several outputs errors in shares of the output's spread.
    """
    inside = estimator.interval_holds(X, y, (COVERAGE_LEVEL, HALF))
    error = np.asarray(y, dtype=float) - estimator.predict(X)
    scores = Scores(estimator.log_predictive_density(X, y), error, *inside)
    if error.ndim > 1:
        scores = scores._replace(error=error / estimator.stacking_.scale)
    there = np.isfinite(np.asarray(y, dtype=float))
    return Scores(*(values[there] for values in scores))


def gain_from(before: Scores, after: Scores, folds: tuple[FoldGain, ...] = ()) -> Gain:
    """Summarise two sets of pointwise scores of the same rows."""
    difference = paired_difference(after.log_density, before.log_density)
    return Gain(
        elpd(before.log_density)[0],
        elpd(after.log_density)[0],
        difference.difference,
        difference.standard_error,
        float(np.sqrt(np.mean(before.error**2))),
        float(np.sqrt(np.mean(after.error**2))),
        float(np.mean(before.inside)),
        float(np.mean(after.inside)),
        float(np.mean(before.inside_half)),
        float(np.mean(after.inside_half)),
        len(before.error),
        tuple(fold.kind for fold in folds),
        folds,
    )


def _fold_gain(held: Held) -> FoldGain:
    """Summarise one fold."""
    difference = held.after.log_density - held.before.log_density
    n = len(difference)
    error = float(np.std(difference, ddof=1) / np.sqrt(n)) if n > 1 else float("nan")
    means = float(np.mean(held.before.log_density)), float(np.mean(held.after.log_density))
    return FoldGain(held.kind, n, *means, error)


def gain_over(folds: Sequence[Held]) -> Gain:
    """Return the gain over folds, each held out once."""
    befores, afters, _ = zip(*folds, strict=True)
    before, after = (
        Scores(*map(np.concatenate, zip(*scores, strict=True))) for scores in (befores, afters)
    )
    return gain_from(before, after, tuple(map(_fold_gain, folds)))
