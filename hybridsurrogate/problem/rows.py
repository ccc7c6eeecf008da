"""Measured rows as an estimator gets them: checked weights, equal rows merged."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hybridsurrogate.priors import FloatArray
from hybridsurrogate.simulation.arrays import as_numbers, check_size


class MeasuredRows(NamedTuple):
    """Distinct measured rows.

    Column names, rows (n, n_columns), outputs (n,) and weights (n,); ``origin`` tells for each row
    that was given which of these it is (-1: none, it had no weight), and ``given`` what weight it
    had itself.
    """

    columns: tuple[str, ...]
    X: FloatArray
    y: FloatArray
    weights: FloatArray
    origin: NDArray[np.intp]
    given: FloatArray


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


def merged_rows(
    columns: tuple[str, ...], X: FloatArray, y: FloatArray, weights: FloatArray
) -> MeasuredRows:
    """Return distinct rows, sorted, with the sums of their weights; rows without weight go.

    A row of weight two and a row given twice are then the same numbers in the same order, and so
    are their fits.
    """
    kept = weights > 0
    table, index = np.unique(np.column_stack([X, y])[kept], axis=0, return_inverse=True)
    total = np.zeros(len(table))
    np.add.at(total, index.ravel(), weights[kept])
    where = np.full(len(y), -1, dtype=np.intp)
    where[kept] = index.ravel()
    return MeasuredRows(columns, table[:, :-1], table[:, -1], total, where, weights)
