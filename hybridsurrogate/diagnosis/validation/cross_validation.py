"""The gain on rows held out, the whole diagnosis repeated without them."""

from __future__ import annotations

import warnings
from typing import NamedTuple

from joblib import delayed
from numpy.typing import ArrayLike

from hybridsurrogate.diagnosis.validation.folds import Folds, row_taker
from hybridsurrogate.diagnosis.validation.gain import Held, HeldOutGain, gain_over, pointwise
from hybridsurrogate.diagnosis.validation.parallel import in_parallel
from hybridsurrogate.diagnosis.validation.refit import Refit
from hybridsurrogate.exceptions import DiagnosisWarning, HybridSurrogateWarning
from hybridsurrogate.types import FloatArray


class FoldScores(NamedTuple):
    """The result of a fold: its scores, and the doubtful fits behind them."""

    held: Held
    doubts: list[str]


def cross_validated(
    refitted: Refit,
    within: Folds,
    beyond: Folds,
    X: ArrayLike,
    y: FloatArray,
    n_jobs: int | None,
    progress: bool = False,
    weights: FloatArray | None = None,
    y_err: FloatArray | None = None,
) -> tuple[HeldOutGain | None, HeldOutGain | None]:
    """Return the gain within the measured range and beyond it, None where there are no folds.

    Parameters
    ----------
    refitted : Refit
        Returns the models before and after for given rows, from a search on them.
    within, beyond : list of (train, test)
    X, y : array-like of shape (n, n_columns), (n,)
    n_jobs : int or None
        Folds at the same time, as in `joblib.Parallel`.
    progress : bool
        Count the folds on a terminal.
    weights : ndarray of shape (n,) or None
        Of the rows, in the fits and in the means of their scores.
    y_err : ndarray of the shape of y, or None
        Known errors of the rows.
    """
    take = row_taker(X)
    tasks = [
        delayed(score_fold)(
            refitted,
            take(train),
            y[train],
            take(test),
            y[test],
            None if weights is None else (weights[train], weights[test]),
            None if y_err is None else (y_err[train], y_err[test]),
        )
        for train, test in [*within, *beyond]
    ]
    scored: list[FoldScores] = in_parallel(tasks, n_jobs, progress)
    doubtful = sorted({doubt for fold in scored for doubt in fold.doubts})
    if doubtful:
        warnings.warn(
            f"{len(doubtful)} of the fits behind the gain have doubtful draws, for example: "
            f"{doubtful[0]}",
            DiagnosisWarning,
            stacklevel=5,
        )
    held = [fold.held for fold in scored]
    inside, outside = held[: len(within)], held[len(within) :]
    return gain_over(inside) if inside else None, gain_over(outside) if outside else None


def score_fold(
    refitted: Refit,
    X: ArrayLike,
    y: FloatArray,
    X_held: ArrayLike,
    y_held: FloatArray,
    weights: tuple[FloatArray, FloatArray] | None = None,
    y_err: tuple[FloatArray, FloatArray] | None = None,
) -> FoldScores:
    """Return the scores of the models before and after on held-out rows.

    Its warnings are part of what it returns: those of another process would be lost.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", HybridSurrogateWarning)
        train, held = (None, None) if weights is None else weights
        known, new = (None, None) if y_err is None else y_err
        plain, extended, kind = refitted(X, y, train, known)
        before = pointwise(plain, X_held, y_held, held, new)
        after = before if extended is plain else pointwise(extended, X_held, y_held, held, new)
    doubts = [str(w.message) for w in caught if "doubtful" in str(w.message)]
    return FoldScores(Held(before, after, kind), doubts)
