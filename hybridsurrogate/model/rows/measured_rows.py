"""Checks of measured rows as an estimator gets them: gaps, outcomes and weights."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from sklearn.utils import _safe_indexing

from hybridsurrogate.exceptions import MissingMeasurementWarning
from hybridsurrogate.likelihoods import Likelihood
from hybridsurrogate.simulation.arrays import as_numbers, as_table, check_size
from hybridsurrogate.types import FloatArray


def without_gaps(
    X: Any,
    y: Any,
    sample_weight: ArrayLike | None = None,
    y_err: Any = None,
    *,
    word: str = "y",
) -> tuple[Any, Any, Any, Any]:
    """Return tables, weights and errors without rows in which one output was not measured.

    Of several outputs all rows stay, where any may be missing.

    Parameters
    ----------
    X : array-like of shape (n, n_columns)
        Such a row may lack its inputs, too.
    y : array-like of shape (n,), or (n, k) of several outputs, or None
    sample_weight, y_err : array-like of shape (n,), float or None
    word : str, default="y"
        What to call the outputs in a message.

    Returns
    -------
    X, y, sample_weight, y_err
        DataFrames or arrays of floats; as given where numbers of rows differ.

    Raises
    ------
    ValueError
        Where no row has a measurement.

    Warns
    -----
    MissingMeasurementWarning
        Says how many rows were left out.

    Examples
    --------
    >>> import warnings
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always")
    ...     X, y, *_ = without_gaps([[1.0], [2.0], [3.0]], [4.0, None, 6.0])
    >>> y, str(caught[0].message)[:35]
    (array([4., 6.]), '1 of 3 rows have no measurement (y ')
    """
    X, y = as_table(X), None if y is None else as_table(y, word)
    there = has_measurement(y)
    if np.shape(y)[1:] not in ((), (1,)) or there.all() or np.shape(X)[:1] != np.shape(y)[:1]:
        return X, y, sample_weight, y_err
    if not there.any():
        raise ValueError(f"Input {word} contains NaN alone: no row has a measurement.")
    lost = np.flatnonzero(~there)
    warnings.warn(
        f"{len(lost)} of {len(there)} rows have no measurement ({word} is NaN) and were left out, "
        f"the first is row {lost[0] + 1}.",
        MissingMeasurementWarning,
        stacklevel=4,
    )
    kept = np.flatnonzero(there)
    of_rows = {"sample_weight": sample_weight, "y_err": y_err}
    for name, values in of_rows.items():
        if values is not None and np.shape(values) == there.shape:
            of_rows[name] = as_numbers(values, name)[kept]
    return _safe_indexing(X, kept), _safe_indexing(y, kept), *of_rows.values()


def has_measurement(y: Any) -> NDArray[np.bool_]:
    """Return which rows of outputs, a DataFrame or an array (n,) or (n, k), hold any.

    Examples
    --------
    >>> has_measurement(np.array([[1.0, np.nan], [np.nan, np.nan]]))
    array([ True, False])
    """
    there = np.atleast_1d(~np.asarray(pd.isna(y), dtype=bool))
    return np.asarray(there.any(axis=tuple(range(1, there.ndim))))


def check_outcomes(y: Any, likelihood: Likelihood) -> None:
    """Raise ValueError for booleans where a likelihood takes them for numbers with noise.

    Examples
    --------
    >>> from hybridsurrogate.likelihoods import as_likelihood
    >>> check_outcomes([True, False], as_likelihood("binomial"))
    """
    if likelihood.has_scale and _are_booleans(y):
        raise ValueError(
            f"y holds booleans, True and False, which the {likelihood.name} likelihood takes for "
            "numbers with noise. Of outcomes choose likelihood='binomial', with a simulation of "
            "their probability; of measured numbers pass y.astype(float)."
        )


def _are_booleans(y: Any) -> bool:
    if isinstance(y, pd.DataFrame):
        return any(map(_are_booleans, (column for _, column in y.items())))
    try:
        array = np.asarray(y)
    except ValueError:  # lists of unequal length, which are refused later
        return False
    if array.dtype != object:
        return array.dtype == bool
    there = array[~np.asarray(pd.isna(array), dtype=bool)]
    return len(there) > 0 and all(isinstance(value, bool | np.bool_) for value in there.flat)


def check_weights(sample_weight: ArrayLike | None, n: int) -> FloatArray:
    """Return n weights; raise ValueError when they are unusable.

    Examples
    --------
    >>> check_weights(None, 3)
    array([1., 1., 1.])
    """
    if sample_weight is None:
        return np.ones(n)
    weights = as_numbers(sample_weight, "sample_weight")
    if weights.ndim == 0:
        weights = np.full(n, float(weights))
    if weights.shape != (n,):
        raise ValueError(f"sample_weight must have shape ({n},), got {weights.shape}.")
    if not (np.isfinite(weights) & (weights >= 0)).all():
        raise ValueError("sample_weight must be finite and not negative.")
    check_size(weights, "sample_weight")
    if not weights.sum() > 0:
        raise ValueError("sample_weight sums to zero: no measured row would count.")
    return weights
