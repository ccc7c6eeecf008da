"""What an extension is worth on rows it has not seen."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hybridsurrogate.diagnosis.folds import Folds
from hybridsurrogate.exceptions import DiagnosisWarning, HybridSurrogateWarning
from hybridsurrogate.priors import FloatArray
from hybridsurrogate.scoring import elpd, paired_difference

if TYPE_CHECKING:
    from hybridsurrogate.diagnosis.rehearsal import Pair

COVERAGE_LEVEL, HALF = 0.9, 0.5


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
    half_before, half_after : float
        Share of rows inside the 50 % predictive interval.
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
    half_before: float
    half_after: float
    n_rows: int
    kinds: tuple[str, ...] = ()
    folds: tuple[FoldGain, ...] = ()


class Scores(NamedTuple):
    """Pointwise scores of one fitted estimator on held-out rows."""

    log_density: FloatArray
    error: FloatArray
    inside: FloatArray
    inside_half: FloatArray


def pointwise(estimator: Any, X: ArrayLike, y: FloatArray) -> Scores:
    """Return log density, error of the mean and whether the intervals hold y, for each row."""
    inside = estimator._inside(X, y, (COVERAGE_LEVEL, HALF))
    error = np.asarray(y, dtype=float) - estimator.predict(X)
    return Scores(estimator.log_predictive_density(X, y), error, *inside)


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


def _fold_gain(before: Scores, after: Scores, kind: str) -> FoldGain:
    difference = after.log_density - before.log_density
    n = len(difference)
    error = float(np.std(difference, ddof=1) / np.sqrt(n)) if n > 1 else float("nan")
    means = float(np.mean(before.log_density)), float(np.mean(after.log_density))
    return FoldGain(kind, n, *means, error)


def held_out_gain(
    tests: Sequence[NDArray[np.intp]],
    pairs: Iterable[Pair],
    take: Callable[[NDArray[np.intp]], ArrayLike],
    y: FloatArray,
) -> Gain:
    """Return the gain on rows held out in turn.

    Parameters
    ----------
    tests : sequence of row indices
        One for each fold.
    pairs : iterable of Pair
        The models before and after, from a search on the other rows of each fold.
    take : callable
        Returns X at given rows.
    y : ndarray of shape (n,)
    """
    befores: list[Scores] = []
    afters: list[Scores] = []
    told = []
    for test, (plain, extended, kind) in zip(tests, pairs, strict=True):
        befores.append(pointwise(plain, take(test), y[test]))
        same = extended is plain
        afters.append(befores[-1] if same else pointwise(extended, take(test), y[test]))
        told.append(_fold_gain(befores[-1], afters[-1], kind))
    merge = [
        Scores(*map(np.concatenate, zip(*scores, strict=True))) for scores in (befores, afters)
    ]
    return gain_from(merge[0], merge[1], tuple(told))


def proof(
    rehearse: Callable[[ArrayLike, FloatArray], Pair],
    within: Folds,
    beyond: Folds,
    X: ArrayLike,
    y: FloatArray,
) -> tuple[Gain | None, Gain | None]:
    """Return the gain within the measured range and beyond it, None where there are no folds.

    Parameters
    ----------
    rehearse : callable
        Returns the models before and after for given rows, from a search on them.
    within, beyond : list of (train, test)
    X, y : array-like of shape (n, n_columns), (n,)
    """
    take = rows_of(X)
    out: list[Gain | None] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", HybridSurrogateWarning)
        for folds in (within, beyond):
            pairs = (rehearse(take(train), y[train]) for train, _ in folds)
            tests = [test for _, test in folds]
            out.append(held_out_gain(tests, pairs, take, y) if folds else None)
    doubtful = {str(w.message) for w in caught if "doubtful" in str(w.message)}
    if doubtful:
        warnings.warn(
            f"{len(doubtful)} of the fits behind the gain have doubtful draws, for example: "
            f"{sorted(doubtful)[0]}",
            DiagnosisWarning,
            stacklevel=4,
        )
    return out[0], out[1]


def rows_of(X: ArrayLike) -> Callable[[Any], Any]:
    """Return a function from row numbers to rows of an array or a DataFrame."""
    return X.iloc.__getitem__ if hasattr(X, "iloc") else np.asarray(X).__getitem__
