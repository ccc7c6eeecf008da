"""Log densities of held-out rows, and the weights with which their mixture predicts best."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from joblib import delayed
from numpy.typing import ArrayLike, NDArray
from sklearn.base import clone

from hybridsurrogate.diagnosis.validation.folds import random_folds, row_taker
from hybridsurrogate.diagnosis.validation.parallel import in_parallel
from hybridsurrogate.estimators.power_scaled import PowerScaledSurrogate
from hybridsurrogate.exceptions import HybridSurrogateWarning
from hybridsurrogate.types import FloatArray

# gain in the mean log density of the mixture at which its weights have converged, and steps at most
_CONVERGED, _MOST_STEPS = 1e-10, 20_000


def held_out_densities(
    estimators: Sequence[PowerScaledSurrogate],
    X: ArrayLike,
    y: FloatArray,
    cv: int,
    random_state: np.random.RandomState,
    n_jobs: int | None = None,
    y_err: FloatArray | None = None,
) -> FloatArray:
    """Return the log density of each measurement under each model fitted without its fold, (m, k).

    Parameters
    ----------
    estimators : sequence of k PowerScaledSurrogate
        Not fitted.
    X, y : array-like of shape (n, n_columns), ndarray of shape (n,) or (n, n_outputs)
    cv : int
        Folds, the same for all.
    random_state : RandomState
    n_jobs : int or None
    y_err : ndarray of the shape of y, or None

    Returns
    -------
    ndarray of shape (m, k)
        Of all that was measured, row by row: m is n where there is one output without gaps.
    """
    take, folds = row_taker(X), random_folds(len(y), cv, random_state)
    tasks = [
        delayed(_densities)(
            one,
            (take(train), y[train], None if y_err is None else y_err[train]),
            (take(test), y[test], None if y_err is None else y_err[test]),
        )
        for train, test in folds
        for one in estimators
    ]
    found = iter(in_parallel(tasks, n_jobs))
    out = np.full((*y.shape, len(estimators)), np.nan)
    for _, test in folds:
        for k in range(len(estimators)):
            out[test, ..., k] = next(found)
    return out[np.isfinite(y)]


def _densities(
    estimator: PowerScaledSurrogate,
    known: tuple[ArrayLike, FloatArray, FloatArray | None],
    held: tuple[ArrayLike, FloatArray, FloatArray | None],
) -> FloatArray:
    with warnings.catch_warnings():
        # the fit to all rows has warned of the data, and held-out rows are beyond these
        warnings.simplefilter("ignore", HybridSurrogateWarning)
        X, y, y_err = known
        fitted: Any = clone(estimator).fit(X, y, y_err=y_err)
        X, y, y_err = held
        return np.asarray(fitted.log_predictive_density(X, y, y_err))


def stacking_weights(log_density: ArrayLike) -> NDArray[np.float64]:
    """Return the weights of predictive densities whose mixture predicts held-out rows best.

    ``argmax_w sum_i log sum_k w_k p_k(y_i)`` on the simplex (Yao, Vehtari, Simpson and Gelman 2018,
    Bayesian Analysis 13:917, eq. 4), which is concave in w: by the EM algorithm for mixture
    weights, none of whose steps falls.

    Parameters
    ----------
    log_density : array-like of shape (n, k)
        Log densities of held-out rows. A row that is impossible under every model is left out.

    Returns
    -------
    ndarray of shape (k,)

    Examples
    --------
    >>> stacking_weights([[0.0, -2.0], [-2.0, 0.0]]).tolist()
    [0.5, 0.5]
    """
    values = np.asarray(log_density, dtype=float)
    top = np.max(values, axis=1, keepdims=True)
    possible = np.isfinite(top[:, 0])
    density = np.exp(values[possible] - top[possible])
    weight = np.full(values.shape[1], 1 / values.shape[1])
    score = -np.inf
    for _ in range(_MOST_STEPS if len(density) else 0):
        mixture = density @ weight
        before, score = score, float(np.mean(np.log(mixture)))
        if score - before < _CONVERGED:
            break
        weight = weight * np.mean(density / mixture[:, None], axis=0)
    return np.asarray(weight / weight.sum())
