"""What an extension is worth on rows it has not seen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hybridsurrogate.priors import FloatArray
from hybridsurrogate.scoring import elpd, paired_difference

COVERAGE_LEVEL = 0.9


@dataclass(frozen=True)
class FoldGain:
    """Scores before and after on one held-out fold.

    Attributes
    ----------
    kind : str
        What the fold's own search chose.
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
        Root mean square error of the predictive mean, in the units of y.
    coverage_before, coverage_after : float
        Share of rows inside the 90 % predictive interval.
    n_rows : int
    kinds : tuple of str
        What each fold's own search chose; empty for a test set.
    folds : tuple of FoldGain
        The same fold by fold; empty for a test set.
    """

    elpd_before: float
    elpd_after: float
    elpd_difference: float
    standard_error: float
    rmse_before: float
    rmse_after: float
    coverage_before: float
    coverage_after: float
    n_rows: int
    kinds: tuple[str, ...] = ()
    folds: tuple[FoldGain, ...] = ()


class Scores(NamedTuple):
    """Pointwise scores of one fitted estimator on held-out rows."""

    log_density: FloatArray
    error: FloatArray
    inside: FloatArray


def pointwise(estimator: Any, X: ArrayLike, y: FloatArray) -> Scores:
    """Return log density, error of the mean and whether the interval holds y, for each row."""
    lower, upper = estimator.predict_interval(X, COVERAGE_LEVEL)
    return Scores(
        estimator.log_predictive_density(X, y),
        np.asarray(y, dtype=float) - estimator.predict(X),
        ((y >= lower) & (y <= upper)).astype(float),
    )


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
        len(before.error),
        tuple(fold.kind for fold in folds),
        folds,
    )


def _fold_gain(before: Scores, after: Scores, kind: str) -> FoldGain:
    difference = after.log_density - before.log_density
    n = len(difference)
    error = float(np.std(difference, ddof=1) / np.sqrt(n)) if n > 1 else float("nan")
    means = float(np.mean(before.log_density)), float(np.mean(after.log_density))
    return FoldGain(kind, n, *means, error)


def cross_validated_gain(
    folds: list[tuple[NDArray[np.intp], NDArray[np.intp]]],
    fit_pair: Callable[[NDArray[np.intp]], tuple[Any, Any, str]],
    take: Callable[[NDArray[np.intp]], ArrayLike],
    y: FloatArray,
) -> Gain:
    """Return the gain on held-out folds.

    Parameters
    ----------
    folds : list of (train, test) row indices
    fit_pair : callable
        Given training rows, searches anew and returns the estimator before, the one after, and
        the kind that the search chose.
    take : callable
        Returns X at given rows.
    y : ndarray of shape (n,)
    """
    befores: list[Scores] = []
    afters: list[Scores] = []
    told = []
    for train, test in folds:
        plain, extended, kind = fit_pair(train)
        befores.append(pointwise(plain, take(test), y[test]))
        same = extended is plain
        afters.append(befores[-1] if same else pointwise(extended, take(test), y[test]))
        told.append(_fold_gain(befores[-1], afters[-1], kind))
    merge = [
        Scores(*map(np.concatenate, zip(*scores, strict=True))) for scores in (befores, afters)
    ]
    return gain_from(merge[0], merge[1], tuple(told))
