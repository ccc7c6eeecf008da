"""Measured data as a fit has them: one record, checked once and read by all that follows."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from sklearn.utils import _safe_indexing

from hybridsurrogate.effects.base import CORRELATION, MEASURED, MEASUREMENT, Cause
from hybridsurrogate.effects.noise.known_errors import RowErrors, correlations
from hybridsurrogate.exceptions import MissingMeasurementWarning, did_you_mean
from hybridsurrogate.likelihoods import Likelihood
from hybridsurrogate.model.rows.columns import Experiments
from hybridsurrogate.model.rows.stacking import Stacking, as_several
from hybridsurrogate.simulation.arrays import as_numbers, as_table, check_size
from hybridsurrogate.simulation.outputs import OUTPUT
from hybridsurrogate.simulation.simulator import SimulationData, Simulator
from hybridsurrogate.types import FloatArray


@dataclass(frozen=True)
class ObservedRows:
    """Rows with a likelihood: observed values and the powers of their densities.

    Attributes
    ----------
    y, weights : ndarray of shape (n,)
    """

    y: FloatArray
    weights: FloatArray


@dataclass(frozen=True)
class SimulatedRows(ObservedRows):
    """Simulation runs: inputs (n, n_inputs), parameters (n, n_parameters) and values."""

    X: FloatArray
    omega: FloatArray


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


def is_covariance(y_err: Any, y: FloatArray) -> bool:
    """Return whether errors of several outputs y (n, k) are covariances: (n, k, k), or (k, k).

    Examples
    --------
    >>> is_covariance(np.eye(2), np.zeros((9, 2))), is_covariance(np.ones((9, 2)), np.zeros((9, 2)))
    (True, False)
    """
    k = y.shape[-1]
    several = y.ndim > 1 and not isinstance(y_err, pd.DataFrame)
    return several and (np.ndim(y_err) > 2 or (np.shape(y_err) == (k, k) and len(y) != k))


def errors_of_rows(y_err: Any, y: FloatArray) -> FloatArray:
    """Return errors of outputs y, those of each row: in the shape of y, or (n, k, k).

    Examples
    --------
    >>> y = np.zeros((9, 2))
    >>> errors_of_rows(0.5, y).shape, errors_of_rows(np.eye(2), y).shape
    ((9, 2), (9, 2, 2))
    """
    shape = (*y.shape, y.shape[1]) if is_covariance(y_err, y) else y.shape
    return np.broadcast_to(as_numbers(y_err, "y_err"), shape)


def check_covariances(
    y_err: Any, y: FloatArray, likelihood: Likelihood, names: tuple[str, ...]
) -> tuple[FloatArray, FloatArray | None]:
    """Return errors in the shape of y, and correlations (n, k, k) of those of a row, or None.

    Parameters
    ----------
    y_err : float or array-like
        As for `check_errors`, or covariances of several outputs.
    y, likelihood, names
        As for `check_errors`.

    Raises
    ------
    ValueError
        Also for what is no covariance, and where the likelihood is not normal on its scale.
    """
    if not is_covariance(y_err, y):
        return check_errors(y_err, y, likelihood, names), None
    if not likelihood.gaussian:
        raise ValueError(
            "y_err is a covariance, which needs a likelihood that is normal on its scale, "
            f'"normal" or "lognormal", not a {likelihood.name} one: give standard deviations.'
        )
    sd, matrices = correlations(y_err, np.isfinite(y), names)
    return np.where(np.isfinite(y), sd, np.nan), matrices


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
    names = () if stacking is None else stacking.names
    k = len(names)
    if data.carried is not None and np.shape(y_err) == (k, k) and data.carried.shape[1] > 2:
        # as in ``fit``, however many rows these are
        y_err = np.broadcast_to(y_err, (len(y), k, k))
    errors, correlation = check_covariances(y_err, y, likelihood, names)
    scatter = likelihood.scatter(errors, y)
    rows = with_errors(rows, scatter if stacking is None else stacking.values(scatter))
    return data.as_measured(rows, correlation)


def row_errors(
    kind: str, scatter: FloatArray, stacking: Stacking | None, weights: FloatArray
) -> RowErrors:
    """Return how rows with errors (n,) or (n, k) on the scale of eta scatter."""
    scatter = scatter[weights > 0]
    if stacking is None:
        return RowErrors(kind, (float(np.median(scatter)),))
    return RowErrors(kind, tuple(np.nanmedian(scatter / stacking.scale, axis=0).tolist()))


class SingleRows(NamedTuple):
    """Rows X (m, n_columns) of one output y (m,) each, and their weights (m,).

    Known errors are one more column of X, the last.
    """

    X: FloatArray
    y: FloatArray
    weights: FloatArray


class DistinctRows(NamedTuple):
    """Distinct rows that train.

    Rows (n, n_columns), outputs (n,) and weights (n,). For each single row ``origin`` is the index
    of its distinct row (-1: none, it had no weight).
    """

    X: FloatArray
    y: FloatArray
    weights: FloatArray
    origin: NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class MeasuredData:
    """Measured data of a fit.

    Attributes
    ----------
    X, y, weights : ndarray of shape (n, n_columns), (n,) or (n, n_outputs), (n,)
        As given, the simulation's inputs first.
    names : ndarray of str of shape (n_columns,), or None
        Columns in the order of ``fit``, where X had names.
    order : sequence of int
        Position in ``fit`` of each column of X.
    columns : tuple of str
        Of single rows: those of X, and of several outputs `OUTPUT`.
    simulation : SimulationData, Simulator or None
        Of several outputs with one output a row.
    stacking : Stacking or None
        How several outputs are laid out.
    experiments : Experiments
        Which experiment a row is of, and the names in columns of text.
    left_out : ndarray of bool of shape (m,), or None
        Single rows without weight, whatever was given.
    further : SingleRows or None
        Of further measured sets, which train, too.
    share : float
        Of the weights in ``fit``, relative to theirs.
    errors : RowErrors or None
        How rows with known errors scatter.
    y_err, scatter : ndarray of the shape of y, or None
        Known errors in the units of y, or covariances (n, k, k), and errors on the scale of eta.
    error_column : str or None
        The column of a DataFrame that held them.
    carried : ndarray of shape (n k, 2) or (n k, 2 + k), or None
        Where errors of k outputs are correlated, what stacked rows carry: see `MEASUREMENT`.
    """

    X: FloatArray
    y: FloatArray
    weights: FloatArray
    names: Any
    order: Sequence[int]
    columns: tuple[str, ...]
    simulation: SimulationData | Simulator | None
    stacking: Stacking | None
    experiments: Experiments
    left_out: NDArray[np.bool_] | None = None
    further: SingleRows | None = None
    share: float = 1.0
    errors: RowErrors | None = None
    y_err: FloatArray | None = None
    scatter: FloatArray | None = None
    error_column: str | None = None
    carried: FloatArray | None = None

    def __repr__(self) -> str:
        return f"MeasuredData({len(self.X)} rows, columns: {', '.join(self.given_columns)})"

    @property
    def given_columns(self) -> tuple[str, ...]:
        """Names of the columns of X."""
        return tuple(name for name in self.columns if name != OUTPUT)

    def simulated_by(self, simulation: SimulationData) -> MeasuredData:
        """Return the data with runs in place of the simulation."""
        if self.stacking is not None:
            simulation = simulation.single_output(self.stacking.scale)
        return replace(self, simulation=simulation)

    @property
    def carried_names(self) -> tuple[str, ...]:
        """What single rows carry after known errors."""
        if self.carried is None:
            return ()
        known = range(self.carried.shape[1] - 2)
        return MEASUREMENT, MEASURED, *(f"{CORRELATION} {k}" for k in known)

    @property
    def _usual_correlation(self) -> FloatArray:
        """Mean of the known correlations, (k, k)."""
        assert self.carried is not None
        k = self.carried.shape[1] - 2
        whole = np.isfinite(self.y).all(axis=1)
        matrices = self.carried[:, 2:].reshape(-1, k, k)
        return np.asarray((matrices[whole] if whole.any() else matrices).mean(axis=0))

    @property
    def usual_errors(self) -> FloatArray:
        """Median known errors, of several outputs (k,), or their covariance (k, k)."""
        assert self.y_err is not None
        if self.y_err.ndim < 3:
            return np.asarray(np.nanmedian(self.y_err, axis=0))
        sd = np.nanmedian(np.sqrt(np.diagonal(self.y_err, axis1=1, axis2=2)), axis=0)
        return self._usual_correlation * np.outer(sd, sd)

    def as_measured(self, rows: FloatArray, correlation: FloatArray | None = None) -> FloatArray:
        """Return stacked rows with all that those of ``fit`` carry, but for what is measured.

        Without known errors and correlations (n, k, k) with usual ones.
        """
        if self.carried is None or self.stacking is None:
            return rows
        k, columns = len(self.stacking.names), [rows]
        if self.errors is not None and rows.shape[1] == len(self.columns):
            named = dict(zip(self.columns, rows.T, strict=True))
            columns.append(self.errors.of_rows(named, len(rows)))
        number = np.repeat(np.arange(len(rows) / k), k)
        columns += [number, np.full(len(rows), np.nan)]
        if self.carried.shape[1] > 2:
            matrices = self._usual_correlation if correlation is None else correlation
            shape = len(rows) // k, k, k
            columns.append(np.broadcast_to(matrices, shape).reshape(-1, k))
        return np.column_stack(columns)

    @property
    def measured_at(self) -> int:
        """Position of the column `MEASURED`."""
        return len(self.columns) + (self.errors is not None) + 1

    @cached_property
    def single(self) -> SingleRows:
        """What was measured, row by row."""
        rows = _single(self.X, self.y, self.weights, self.stacking, self.scatter, self.carried)
        if self.left_out is None:
            return rows
        return rows._replace(weights=np.where(self.left_out, 0.0, rows.weights))

    @cached_property
    def distinct(self) -> DistinctRows:
        """The same and further sets, equal rows merged."""
        own = merged_rows(self.single)
        if self.further is None:
            return own
        both = zip((own.X, own.y, self.share * own.weights), self.further, strict=True)
        merged = merged_rows(SingleRows(*map(np.concatenate, both)))
        origin = np.where(own.origin < 0, -1, merged.origin[own.origin])
        return merged._replace(origin=origin)

    def leaving_out(self, effects: Sequence[Cause]) -> MeasuredData:
        """Return the data without weight in the rows that effects leave out."""
        X, y, _ = self.single
        rows = dict(zip(self.columns, X.T, strict=False))
        masks = [some for one in effects if (some := one.leaves_out(rows, y)) is not None]
        if not masks and self.left_out is None:
            return self
        return replace(self, left_out=np.any(masks, axis=0) if masks else None)

    def joined(
        self, sets: Sequence[tuple[SingleRows, FloatArray | None]], share: float
    ) -> MeasuredData:
        """Return the data with further measured sets, and a share of the weights in ``fit``.

        Their outputs (n,) or (n, k) are as measured, NaN where one was not; known errors of the
        same shape are on the scale of eta.
        """
        rows = [_single(*one, self.stacking, scatter) for one, scatter in sets]
        further = SingleRows(*map(np.concatenate, zip(*rows, strict=True)))
        return replace(self, further=further, share=share)


def _single(
    X: FloatArray,
    y: FloatArray,
    weights: FloatArray,
    stacking: Stacking | None,
    scatter: FloatArray | None,
    carried: FloatArray | None = None,
) -> SingleRows:
    """Return rows of one output each."""
    if stacking is None:
        return SingleRows(with_errors(X, scatter), y, weights)
    values = stacking.values(y)
    long = with_errors(stacking.rows(X), None if scatter is None else stacking.values(scatter))
    long = long if carried is None else np.column_stack([long, carried])
    there = np.isfinite(values)
    return SingleRows(long[there], values[there], np.repeat(weights, y.shape[1])[there])


def with_errors(X: FloatArray, scatter: FloatArray | None) -> FloatArray:
    """Return single rows X (m, n_columns) with their errors (m,), if any, as the last column."""
    return X if scatter is None else np.column_stack([X, scatter])


def merged_rows(rows: SingleRows) -> DistinctRows:
    """Return distinct rows, sorted, with the sums of their weights; rows without weight go.

    A row of weight two and a row given twice are then the same numbers in the same order, and so
    are their fits.
    """
    X, y, weights = rows
    kept = weights > 0
    table, index = np.unique(np.column_stack([X, y])[kept], axis=0, return_inverse=True)
    total = np.zeros(len(table))
    np.add.at(total, index.ravel(), weights[kept])
    where = np.full(len(y), -1, dtype=np.intp)
    where[kept] = index.ravel()
    return DistinctRows(table[:, :-1], table[:, -1], total, where)


class GivenRows(NamedTuple):
    """Measured rows as a user gives them, with their weights and known errors where they have some.

    Attributes
    ----------
    X, y : array-like of shape (n, n_columns), (n,) or (n, n_outputs)
    weights : ndarray of shape (n,) or None
    y_err : ndarray of the shape of y, or None
    """

    X: Any
    y: Any
    weights: FloatArray | None = None
    y_err: Any = None

    def take(self, some: Any) -> GivenRows:
        """Return rows by their numbers or as a slice; what is none for each row stays."""
        each: list[Any] = [*self]
        n = len(each[0])
        return GivenRows(
            *(_safe_indexing(one, some) if np.ndim(one) and len(one) == n else one for one in each)
        )
