"""Scores of predictions: functions of arrays, and of fitted estimators."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hybridsurrogate.arguments import as_real, random_generator
from hybridsurrogate.simulation.arrays import as_numbers, as_outputs
from hybridsurrogate.types import FloatArray

# differences in nats per row that say nothing
_SAME_ELPD = 0.01


def elpd(log_predictive_density: ArrayLike) -> tuple[float, float]:
    """Return the mean log predictive density per row and its standard error.

    Parameters
    ----------
    log_predictive_density : array-like of shape (n,)
        Minus infinity for a row that is impossible.

    Returns
    -------
    mean, standard_error : float
        In nats. Of an impossible row minus infinity and NaN; NaN is the error of a single row, too.

    Raises
    ------
    ValueError
        For NaN, plus infinity or no rows.

    Examples
    --------
    >>> elpd([-1.0, -2.0, -3.0])[0]
    -2.0
    """
    (values,) = same_rows({"log_predictive_density": log_predictive_density}, infinite=True)
    if np.max(values) == np.inf:
        raise ValueError("log_predictive_density must be below infinity, but some values are not.")
    return float(values.mean()), _standard_error(values)


def rmse(draws: ArrayLike, truth: ArrayLike) -> float:
    """Return the mean over rows of the root mean square error over draws.

    As in arXiv 2412.11875, section 3: RMSE = mean_i sqrt(mean_s (mu_si - mu_i)^2).

    Parameters
    ----------
    draws : array-like of shape (n_draws, n)
        Noise-free predictions, as from ``sample_predictive_mean``.
    truth : array-like of shape (n,)

    Raises
    ------
    ValueError
        For NaN, infinity, no rows or other shapes.

    Examples
    --------
    >>> rmse([[0.0, 1.0], [0.0, 3.0]], [0.0, 2.0])
    0.5
    """
    draws, truth = _draws_and_rows(draws, truth, "truth")
    error = draws - truth
    return float(np.sqrt(np.mean(error**2, axis=0)).mean())


def coverage(y: ArrayLike, lower: ArrayLike, upper: ArrayLike) -> float:
    """Return the share of rows inside their interval.

    Parameters
    ----------
    y, lower, upper : array-like of shape (n,)
        An interval may be open at an end, infinity.

    Raises
    ------
    ValueError
        For NaN, no rows or different shapes.

    Examples
    --------
    >>> coverage([0.0, 5.0], [-1.0, -1.0], [1.0, 1.0])
    0.5
    """
    y, lower, upper = same_rows({"y": y, "lower": lower, "upper": upper}, infinite=True)
    return float(np.mean((y >= lower) & (y <= upper)))


def interval_width(lower: ArrayLike, upper: ArrayLike) -> float:
    """Return the mean width of the intervals.

    Parameters
    ----------
    lower, upper : array-like of shape (n,)

    Raises
    ------
    ValueError
        For NaN, infinity, no rows or different shapes.

    Examples
    --------
    >>> interval_width([0.0, 1.0], [1.0, 4.0])
    2.0
    """
    lower, upper = same_rows({"lower": lower, "upper": upper})
    return float(np.mean(upper - lower))


def interval_score(
    y: ArrayLike, lower: ArrayLike, upper: ArrayLike, level: float = 0.9
) -> FloatArray:
    """Return the interval score of each row: smaller is better.

    The width of a central interval, and 2 / (1 - level) for every unit by which y lies outside
    (equation 43 of [1]_): a narrow interval pays off only if it still covers y often enough.

    Parameters
    ----------
    y, lower, upper : array-like of shape (n,)
    level : float, default=0.9
        Nominal coverage of the intervals.

    Returns
    -------
    ndarray of shape (n,)

    Raises
    ------
    ValueError
        For NaN, infinity, no rows or different shapes.

    References
    ----------
    .. [1] T. Gneiting, A. E. Raftery, "Strictly proper scoring rules, prediction, and estimation",
       Journal of the American Statistical Association 102, 2007.

    Examples
    --------
    >>> interval_score([0.5, 2.0], [0.0, 0.0], [1.0, 1.0], level=0.5)
    array([1., 5.])
    """
    if not 0 < as_real(level, "level") < 1:
        raise ValueError(f"level must lie between 0 and 1, got {level!r}.")
    y, lower, upper = same_rows({"y": y, "lower": lower, "upper": upper})
    outside = np.maximum(lower - y, 0) + np.maximum(y - upper, 0)
    return upper - lower + 2 / (1 - level) * outside


def crps(draws: ArrayLike, y: ArrayLike) -> FloatArray:
    """Return the continuous ranked probability score of each row: smaller is better.

    E|Y - y| - E|Y - Y'| / 2 for independent predictions Y and Y' (equation 21 of [1]_), in the
    units of y; of a prediction without scatter it is the absolute error. The second mean is over
    pairs of different draws (the fair version of [2]_), so that the result estimates the score of
    the distribution behind the draws without bias, however few they are; it can then be slightly
    negative. Sorting the draws turns the sum over pairs into one over draws.

    Parameters
    ----------
    draws : array-like of shape (n_draws, n)
        Predictions with noise, as from ``sample_posterior_predictive``; at least two.
    y : array-like of shape (n,)

    Returns
    -------
    ndarray of shape (n,)

    References
    ----------
    .. [1] T. Gneiting, A. E. Raftery, "Strictly proper scoring rules, prediction, and estimation",
       Journal of the American Statistical Association 102, 2007.
    .. [2] C. A. T. Ferro, "Fair scores for ensemble forecasts", Quarterly Journal of the Royal
       Meteorological Society 140, 2014.

    Examples
    --------
    >>> crps([[0.0, 5.0], [2.0, 5.0]], [1.0, 2.0])
    array([0., 3.])
    """
    draws, y = _draws_and_rows(draws, y)
    n_draws = len(draws)
    if n_draws < 2:
        raise ValueError("crps needs at least two draws, got 1.")
    error = draws - y
    error.sort(axis=0)
    # in the sum over pairs the k-th smallest of S draws is added k - 1 and subtracted S - k times
    times = 2 * np.arange(1, n_draws + 1) - n_draws - 1.0
    spread = times @ error / (n_draws * (n_draws - 1))
    return np.abs(error, out=error).mean(axis=0) - spread


def pit(draws: ArrayLike, y: ArrayLike, random_state: Any = None) -> FloatArray:
    """Return the probability integral transform of each row: where y falls among its predictions.

    If the predictions are right the values are uniform on (0, 1), whatever the number of draws and
    for counts as well: y has a rank among its draws, drawn at random where they are equal
    (as in [1]_), and a place drawn uniformly within that rank's share. A histogram shaped like a
    bowl shows that predictions are too narrow, one like a hill that they are too wide.

    Parameters
    ----------
    draws : array-like of shape (n_draws, n)
        Predictions with noise, as from ``sample_posterior_predictive``.
    y : array-like of shape (n,)
    random_state : None, int, numpy Generator or RandomState

    Returns
    -------
    ndarray of shape (n,)

    References
    ----------
    .. [1] C. Czado, T. Gneiting, L. Held, "Predictive model assessment for count data", Biometrics
       65, 2009.

    Examples
    --------
    >>> draws = [[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]]
    >>> np.floor(4 * pit(draws, [-1.0, 3.0], random_state=0))  # the quarter of each
    array([0., 3.])
    """
    draws, y = _draws_and_rows(draws, y)
    below = (draws < y).sum(axis=0)
    equal = (draws == y).sum(axis=0)
    share = random_generator(random_state).uniform(size=len(y))
    return (below + share * (equal + 1)) / (len(draws) + 1)


@dataclass(frozen=True)
class PairedDifference:
    """A difference of two scores on the same rows, and its standard error.

    Attributes
    ----------
    difference : float
    standard_error : float
        NaN for a single row.

    Examples
    --------
    >>> found = paired_difference([1.0, 4.0], [0.0, 1.0])  # the differences are 1 and 3
    >>> found.difference, round(found.standard_error, 6)
    (2.0, 1.0)
    """

    difference: float
    standard_error: float


def paired_difference(after: ArrayLike, before: ArrayLike) -> PairedDifference:
    """Return the mean difference of two pointwise scores with its paired standard error.

    Parameters
    ----------
    after, before : array-like of shape (n,)
        Minus infinity where a row is impossible; in both, it is no difference.

    Returns
    -------
    PairedDifference
        Infinite where one of them finds a row impossible that the other does not, NaN where each
        of them does; the error is NaN then.

    Raises
    ------
    ValueError
        For NaN, no rows or different shapes.

    Examples
    --------
    >>> paired_difference([1.0, 3.0], [0.0, 1.0]).difference
    1.5
    """
    one, other = same_rows({"after": after, "before": before}, infinite=True)
    values = np.zeros(len(one))
    # what both find impossible is no difference
    np.subtract(one, other, out=values, where=one != other)
    with np.errstate(invalid="ignore"):  # of infinities with both signs
        mean = float(values.mean())
    return PairedDifference(mean, _standard_error(values))


def last_of_the_best(scores: ArrayLike) -> int:
    """Return the position of the last score that is as good as the best one.

    Over rising weights of a simulation: where the score is level, it deserves all the weight that
    costs nothing. A hundredth of a nat per row is the Monte Carlo error of a few hundred draws.

    Examples
    --------
    >>> last_of_the_best([-0.501, -0.5, -0.502, -0.7])
    2
    """
    values = as_numbers(scores, "scores")
    return int(np.flatnonzero(values >= values.max() - _SAME_ELPD)[-1])


def same_rows(arrays: dict[str, ArrayLike], infinite: bool = False) -> list[FloatArray]:
    """Return the arrays as floats; ValueError unless all have one shape (n,), n at least 1.

    And for NaN, and for infinity where it has no meaning.
    """
    values = {name: as_numbers(array, name) for name, array in arrays.items()}
    shapes = {array.shape for array in values.values()}
    if len(shapes) > 1 or len(shape := shapes.pop()) != 1 or shape == (0,):
        got = ", ".join(f"{name} {array.shape}" for name, array in values.items())
        raise ValueError(f"Scores need arrays of one shape (n,), one value a row; got {got}.")
    for name, array in values.items():
        wrong = np.isnan(array) if infinite else ~np.isfinite(array)
        if wrong.any():
            need = "hold no NaN" if infinite else "be finite, without NaN and infinity"
            raise ValueError(
                f"{name} must {need}: {wrong.sum()} of {len(array)} values are wrong, the first, "
                f"{array[wrong][0]}, in row {np.argmax(wrong) + 1}."
            )
    return list(values.values())


def _draws_and_rows(
    draws: ArrayLike, y: ArrayLike, word: str = "y"
) -> tuple[FloatArray, FloatArray]:
    """Return both as floats; ValueError unless they are finite and of shapes (S, n) and (n,)."""
    draws = as_numbers(draws, "draws")
    (y,) = same_rows({word: y})
    if draws.ndim != 2 or draws.shape[1] != len(y) or len(draws) == 0:
        raise ValueError(
            f"draws must have shape (n_draws, {len(y)}), a column for each of the {len(y)} values "
            f"of {word}; got {draws.shape}."
        )
    if not np.isfinite(draws).all():
        raise ValueError("draws must be finite, without NaN and infinity.")
    return draws, y


def _standard_error(values: FloatArray) -> float:
    if len(values) < 2 or not np.isfinite(values).all():
        return float("nan")
    return float(values.std(ddof=1) / np.sqrt(len(values)))


# of predictive intervals, and of the set of causes or simulations that are left
COVERAGE_LEVEL = 0.9
# of y, behind a continuous ranked probability score
_N_DRAWS = 1000


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
    _check_rows("predict(X)", predicted, values)
    predicted, values = same_rows({"predict(X)": predicted[there], "y": values[there]})
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
    lower, upper = interval(X, level=COVERAGE_LEVEL)
    values, there = _measured(estimator, y)
    _check_rows("predict_interval(X)", lower, values)
    return -float(interval_score(values[there], lower[there], upper[there], COVERAGE_LEVEL).mean())


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
