"""Scores of fitted estimators, for scikit-learn's searches."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hybridsurrogate.scoring.scores import crps, elpd, interval_score, same_rows
from hybridsurrogate.simulation.arrays import as_outputs
from hybridsurrogate.types import FloatArray

# of y, behind a continuous ranked probability score
_N_DRAWS = 1000
_LEVEL = 0.9


def elpd_scorer(estimator: Any, X: ArrayLike, y: ArrayLike) -> float:
    """Return the mean log predictive density per row, for ``GridSearchCV(scoring=...)``.

    Parameters
    ----------
    estimator : fitted estimator with ``log_predictive_density``
    X : array-like of shape (n, n_columns)
    y : array-like of shape (n,)

    Returns
    -------
    float
        In nats.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> fitted = SimpleNamespace(log_predictive_density=lambda X, y: -np.abs(y - X[:, 0]))
    >>> elpd_scorer(fitted, np.array([[0.0], [1.0]]), np.array([2.0, 5.0]))
    -3.0
    """
    density = _method(estimator, "log_predictive_density", "elpd_scorer")
    values, there = np.asarray(density(X, y)), _measured(estimator, y)[1]
    return elpd(values[there])[0]


def neg_crps_scorer(estimator: Any, X: ArrayLike, y: ArrayLike) -> float:
    """Return minus the mean continuous ranked probability score of 1000 draws a row.

    The draws have a fixed seed, so that the same fit has the same score.

    Parameters
    ----------
    estimator : fitted estimator with ``sample_posterior_predictive``
    X : array-like of shape (n, n_columns)
    y : array-like of shape (n,)

    Returns
    -------
    float
        In the units of y.

    Examples
    --------
    Draws without scatter, whose score is the absolute error:

    >>> from types import SimpleNamespace
    >>> fitted = SimpleNamespace(
    ...     sample_posterior_predictive=lambda X, n_draws, random_state: np.ones((n_draws, len(X))))
    >>> neg_crps_scorer(fitted, np.zeros((2, 1)), np.array([2.0, 4.0]))
    -2.0
    """
    sample = _method(estimator, "sample_posterior_predictive", "neg_crps_scorer")
    draws = sample(X, n_draws=_N_DRAWS, random_state=0)
    values, there = _measured(estimator, y)
    _check_rows("each draw of sample_posterior_predictive(X)", draws[0], values)
    return -float(crps(draws[:, there], values[there]).mean())


def neg_rmse_scorer(estimator: Any, X: ArrayLike, y: ArrayLike) -> float:
    """Return minus the root mean square error of ``estimator.predict``.

    Parameters
    ----------
    estimator : fitted estimator
    X : array-like of shape (n, n_columns)
    y : array-like of shape (n,)

    Returns
    -------
    float
        In the units of y.

    Examples
    --------
    >>> from sklearn.dummy import DummyRegressor
    >>> X, y = np.zeros((2, 1)), np.array([1.0, 5.0])
    >>> neg_rmse_scorer(DummyRegressor().fit(X, y), X, y)  # predicts the mean, 3
    -2.0
    """
    predict = _method(estimator, "predict", "neg_rmse_scorer")
    values, there = _measured(estimator, y)
    predicted = np.asarray(predict(X))
    pair = predicted, values
    if predicted.shape == there.shape:
        pair = predicted[there], values[there]
    predicted, values = same_rows(dict(zip(("predict(X)", "y"), pair, strict=True)))
    return -float(np.sqrt(np.mean((predicted - values) ** 2)))


def interval_score_scorer(estimator: Any, X: ArrayLike, y: ArrayLike) -> float:
    """Return minus the mean `interval_score` of 90 % intervals.

    Parameters
    ----------
    estimator : fitted estimator with ``predict_interval``
    X : array-like of shape (n, n_columns)
    y : array-like of shape (n,)

    Returns
    -------
    float
        In the units of y.

    Examples
    --------
    Both rows lie inside, so that the score is the width:

    >>> from types import SimpleNamespace
    >>> fitted = SimpleNamespace(
    ...     predict_interval=lambda X, level: (np.zeros(len(X)), np.full(len(X), 2.0)))
    >>> interval_score_scorer(fitted, np.zeros((2, 1)), np.array([0.5, 1.0]))
    -2.0
    """
    interval = _method(estimator, "predict_interval", "interval_score_scorer")
    lower, upper = interval(X, level=_LEVEL)
    values, there = _measured(estimator, y)
    _check_rows("predict_interval(X)", lower, values)
    return -float(interval_score(values[there], lower[there], upper[there], _LEVEL).mean())


#: All scorers by name, as in ``GridSearchCV(model, grid, scoring=SCORERS, refit="elpd")``.
SCORERS: dict[str, Callable[[Any, ArrayLike, ArrayLike], float]] = {
    "elpd": elpd_scorer,
    "neg_crps": neg_crps_scorer,
    "neg_rmse": neg_rmse_scorer,
    "neg_interval_score": interval_score_scorer,
}


def _measured(estimator: Any, y: ArrayLike) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return outputs and which of them were measured: of several some may be missing.

    An estimator of several outputs knows their order, in a pipeline the last step.
    """
    last = getattr(estimator, "_final_estimator", estimator)
    read = getattr(last, "measured_outputs", as_outputs)
    values = read(y)
    return values, np.isfinite(values)


def _check_rows(name: str, predicted: FloatArray, y: FloatArray) -> None:
    """Raise ValueError where rows that were predicted are not those of y."""
    if np.shape(predicted) != y.shape:
        raise ValueError(
            f"X and y must have the same rows and outputs: {name} has shape "
            f"{np.shape(predicted)}, y has {y.shape}."
        )


def _method(estimator: Any, name: str, scorer: str) -> Callable[..., Any]:
    method = getattr(estimator, name, None)
    if method is None:
        raise TypeError(
            f"{scorer} needs an estimator with the method {name}, such as PowerScaledSurrogate; "
            f"{type(estimator).__name__} has none."
        )
    return method
