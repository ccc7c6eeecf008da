"""Measured data as a fit has them: one record, checked once and read by all that follows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.effects.base import Cause
from hybridsurrogate.effects.noise.known_errors import RowErrors
from hybridsurrogate.model.rows.experiments import Experiments
from hybridsurrogate.model.rows.stacking import Stacking
from hybridsurrogate.simulation.outputs import OUTPUT
from hybridsurrogate.simulation.simulator import SimulationData, Simulator
from hybridsurrogate.types import FloatArray


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
    experiments : Experiments or None
        Which experiment a row is of.
    left_out : ndarray of bool of shape (m,), or None
        Single rows without weight, whatever was given.
    further : SingleRows or None
        Of further measured sets, which train, too.
    share : float
        Of the weights in ``fit``, relative to theirs.
    errors : RowErrors or None
        How rows with known errors scatter.
    y_err, scatter : ndarray of the shape of y, or None
        Known errors in the units of y, and on the scale of eta.
    error_column : str or None
        The column of a DataFrame that held them.
    """

    X: FloatArray
    y: FloatArray
    weights: FloatArray
    names: Any
    order: Sequence[int]
    columns: tuple[str, ...]
    simulation: SimulationData | Simulator | None
    stacking: Stacking | None
    experiments: Experiments | None
    left_out: NDArray[np.bool_] | None = None
    further: SingleRows | None = None
    share: float = 1.0
    errors: RowErrors | None = None
    y_err: FloatArray | None = None
    scatter: FloatArray | None = None
    error_column: str | None = None

    def __repr__(self) -> str:
        return f"MeasuredData({len(self.X)} rows, columns: {', '.join(self.given_columns)})"

    @property
    def given_columns(self) -> tuple[str, ...]:
        """Names of the columns of X."""
        return tuple(name for name in self.columns if name != OUTPUT)

    def effects(self) -> tuple[Cause, ...]:
        """Return what gives each experiment its own value of the parameters that differ."""
        return () if self.experiments is None else self.experiments.effects()

    def simulated_by(self, simulation: SimulationData) -> MeasuredData:
        """Return the data with runs in place of the simulation."""
        if self.stacking is not None:
            simulation = simulation.single_output(self.stacking.scale)
        return replace(self, simulation=simulation)

    @cached_property
    def single(self) -> SingleRows:
        """What was measured, row by row."""
        rows = _single(self.X, self.y, self.weights, self.stacking, self.scatter)
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
) -> SingleRows:
    """Return rows of one output each."""
    if stacking is None:
        return SingleRows(with_errors(X, scatter), y, weights)
    values = stacking.values(y)
    long = with_errors(stacking.rows(X), None if scatter is None else stacking.values(scatter))
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
