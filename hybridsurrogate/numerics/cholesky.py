"""Cholesky factors: of many matrices at once, and cut short where few columns are enough."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.types import FloatArray

# smallest of the eigenvalues, as a share of the largest, that rounding leaves positive
_SINGULAR = 1e-12


def nudged_cholesky(matrices: FloatArray) -> FloatArray:
    """Return Cholesky factors (J, p, p), nudged where rounding made a matrix indefinite."""
    try:
        return np.linalg.cholesky(matrices)
    except np.linalg.LinAlgError:
        # rounding can make a nearly singular matrix indefinite: nudge by its own size
        size = matrices.shape[-1]
        eigenvalue = np.linalg.eigvalsh(matrices)
        singular = eigenvalue[:, :1] < _SINGULAR * eigenvalue[:, -1:]
        nudge = 1e-10 * np.einsum("jkk->jk", matrices) * singular
        matrices = matrices.copy()
        matrices[:, np.arange(size), np.arange(size)] += nudge
        return np.linalg.cholesky(matrices)


def log_det_of(factors: FloatArray) -> FloatArray:
    """Return the log determinants (J,) of triangular factors (J, p, p)."""
    return np.log(np.diagonal(factors, axis1=1, axis2=2)).sum(axis=1)


def pivoted_cholesky(
    diagonal: FloatArray, column: Callable[[int], FloatArray], least: float, most: int
) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return F (n, r) with F F' the covariance, and the points (r,) that its columns are of.

    Cholesky's factor, largest variance first, cut short: covariances of smooth curves need few
    columns, and only these are asked for (Harbrecht, Peters and Schneider 2012, Applied Numerical
    Mathematics 62:428).

    Parameters
    ----------
    diagonal : ndarray of shape (n,)
        The variances.
    column : callable
        ``column(k) -> (n,)`` of the covariance.
    least : float
        Variances that are not larger may be left.
    most : int
        Columns.
    """
    left = diagonal.copy()
    most = min(most, len(left))
    columns = np.empty((min(most, 32), len(left)))
    chosen: list[int] = []
    for r in range(most):
        k = int(np.argmax(left))
        if left[k] <= least:
            break
        if r == len(columns):  # many points of a smooth curve need no square of their number
            columns = np.concatenate([columns, np.empty_like(columns)])
        columns[r] = (column(k) - columns[:r, k] @ columns[:r]) / np.sqrt(left[k])
        left -= columns[r] ** 2
        chosen.append(k)
    return columns[: len(chosen)].T.copy(), np.array(chosen, dtype=np.intp)
