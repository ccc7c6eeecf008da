"""Checks of the standard deviations that measured rows bring with them, and their layout."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from hybridsurrogate.effects.noise.known_errors import RowErrors
from hybridsurrogate.exceptions import did_you_mean
from hybridsurrogate.likelihoods import Likelihood
from hybridsurrogate.model.rows.measured_data import MeasuredData, with_errors
from hybridsurrogate.model.rows.stacking import Stacking, as_several
from hybridsurrogate.simulation.arrays import as_numbers, as_table
from hybridsurrogate.types import FloatArray


def taken_out(X: Any, y_err: Any) -> tuple[Any, Any]:
    """Return a table without its column of errors, and that column; others as they are.

    Parameters
    ----------
    X : array-like of shape (n, n_columns)
    y_err : str, list of str, array-like or None
        A name: that column of a DataFrame X; of several outputs a name for each.

    Raises
    ------
    ValueError
        Where X has no such column.

    Examples
    --------
    >>> table = pd.DataFrame({"t": [1.0, 2.0], "error": [0.1, 0.2]})
    >>> X, y_err = taken_out(table, "error")
    >>> list(X), y_err.tolist()
    (['t'], [0.1, 0.2])
    """
    wanted = [y_err] if isinstance(y_err, str) else y_err
    if not isinstance(wanted, list) or not all(isinstance(name, str) for name in wanted):
        return X, y_err
    X = as_table(X)
    names = list(X.columns) if isinstance(X, pd.DataFrame) else []
    missing = [name for name in wanted if name not in names]
    if missing:
        raise ValueError(
            f"y_err={y_err!r} is no column of X, which has {names or 'no names'}: name those of a "
            f"DataFrame, or pass the errors as an array.{did_you_mean(missing, names)}"
        )
    errors = X[wanted[0]] if len(wanted) == 1 else X[wanted].to_numpy()
    return X.drop(columns=wanted), errors


def name_of(y_err: Any) -> str | None:
    """Return the name of the column in which errors came, None for other errors."""
    name = y_err.name if isinstance(y_err, pd.Series) else None
    return name if isinstance(name, str) else None


def check_errors(
    y_err: Any, y: FloatArray, likelihood: Likelihood, names: tuple[str, ...]
) -> FloatArray:
    """Return errors in the shape of y, in its units.

    Parameters
    ----------
    y_err : float or array-like of the shape of y
        One number: that of every row. NaN is only accepted where y is NaN.
    y : ndarray of shape (n,), or (n, k) of several outputs
    likelihood : Likelihood
    names : tuple of str
        Of the outputs.

    Raises
    ------
    ValueError
        For another shape; for errors that are zero, negative, NaN or infinite; under a likelihood
        without a noise scale.

    Examples
    --------
    >>> from hybridsurrogate.likelihoods import as_likelihood
    >>> check_errors(0.5, np.array([1.0, 2.0]), as_likelihood("normal"), ("y",))
    array([0.5, 0.5])
    """
    if not likelihood.scales_noise:
        raise ValueError(
            f"y_err is the noise of each row, and the {likelihood.name} likelihood has no noise "
            'scale: leave y_err out, or choose likelihood="normal", "lognormal" or "student-t".'
        )
    if y.ndim > 1 and np.ndim(y_err):
        errors = as_several(as_table(y_err, "y_err"), names, "y_err")
    else:
        errors = as_numbers(y_err, "y_err")
    if errors.ndim == 0:
        errors = np.full(y.shape, float(errors))
    if errors.shape == (len(y), 1) and y.ndim == 1:
        errors = errors[:, 0]
    if errors.shape == (len(y), len(y)) and y.ndim == 1:
        raise ValueError(
            "y_err is a covariance: number the rows 0, 1, ... in a column of X, and take "
            'y_err, shared = hs.SharedErrors.of_rows(covariance, "row"), effects=[shared] and '
            'noise="known".'
        )
    if errors.shape != y.shape:
        raise ValueError(
            f"y_err must have the shape of y, {y.shape}, with a standard deviation for each "
            f"measurement, got {errors.shape}."
        )
    there = np.isfinite(y)
    bad = np.argwhere(there & ~(np.isfinite(errors) & (errors > 0)))
    if len(bad):
        worst = errors[tuple(bad[0])]
        hint = (
            "give a row without a known error that of similar rows"
            if not np.isfinite(worst)
            else "a measurement without any error would outweigh all others: give a plausible one"
            if worst == 0
            else "errors are standard deviations, not differences"
        )
        raise ValueError(
            f"y_err must be positive and finite; {len(bad)} values are not, the first is "
            f"{worst:g} in row {bad[0][0] + 1}: {hint}."
        )
    return errors


def new_errors(X: Any, y_err: Any, data: MeasuredData) -> tuple[Any, Any]:
    """Return a new table without the column that held errors in ``fit``, and its errors or None.

    Parameters
    ----------
    X : array-like of shape (n, n_columns)
    y_err : float, str, array-like or None
        None: those in that column, where X has it.
    data : MeasuredData
        Of the fit.

    Raises
    ------
    ValueError
        Where the fit had no errors.
    """
    if y_err is not None and data.errors is None:
        raise ValueError("y_err is for an estimator whose fit had y_err, too.")
    column = data.error_column
    if column not in (list(X.columns) if isinstance(X, pd.DataFrame) else []):
        return taken_out(X, y_err)
    rest, found = taken_out(X, column)
    if y_err is None:
        return rest, found
    return (rest, found) if isinstance(y_err, str) and y_err == column else taken_out(rest, y_err)


def with_new_errors(
    rows: FloatArray, y_err: Any, y: FloatArray, data: MeasuredData, likelihood: Likelihood
) -> FloatArray:
    """Return single rows (m, n_columns) with the errors of measurements there as last column.

    Parameters
    ----------
    rows : ndarray of shape (m, n_columns)
    y_err : float or array-like of shape (n,), or (n, k) of several outputs
    y : ndarray of the same shape
        Measured or expected, to which errors are relative on a logarithmic scale.
    data : MeasuredData
        Of the fit.
    likelihood : Likelihood
    """
    stacking = data.stacking
    errors = check_errors(y_err, y, likelihood, () if stacking is None else stacking.names)
    scatter = likelihood.scatter(errors, y)
    return with_errors(rows, scatter if stacking is None else stacking.values(scatter))


def row_errors(
    kind: str, scatter: FloatArray, stacking: Stacking | None, weights: FloatArray
) -> RowErrors:
    """Return how rows with errors (n,) or (n, k) on the scale of eta scatter."""
    scatter = scatter[weights > 0]
    if stacking is None:
        return RowErrors(kind, (float(np.median(scatter)),))
    return RowErrors(kind, tuple(np.nanmedian(scatter / stacking.scale, axis=0).tolist()))
