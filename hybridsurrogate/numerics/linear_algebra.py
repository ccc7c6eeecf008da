"""Linear algebra under numpy: blocks of large batches, Cholesky factors, threads."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpstrf
from threadpoolctl import ThreadpoolController

from hybridsurrogate.types import FloatArray

# numbers in one block: what is made on the way stays in the processor's cache, and its memory is
# not asked of the system again and again
BLOCK = 200_000
# where a block is a call that costs much however few its numbers are, such as a run of the
# simulation: as many as memory may hold at once, 32 MB
LARGE_BLOCK = 20 * BLOCK

# rows or columns of a covariance that is formed whole, at most: its time grows with their square
MAX_DENSE = 1000
# in the time of a call for one column: for errors between places of curves 6,400, of fields 5,000
_NUMBERS_A_CALL = 6000


def blocks(n: int, numbers: int, most: int = BLOCK) -> list[slice]:
    """Cut n things of so many numbers each into blocks of at most ``most`` numbers.

    Examples
    --------
    >>> blocks(5, 100, 250)
    [slice(0, 2, None), slice(2, 4, None), slice(4, 5, None)]
    """
    length = max(1, most // max(numbers, 1))
    return [slice(start, min(start + length, n)) for start in range(0, n, length)]


def in_blocks(
    run: Callable[[FloatArray], tuple[FloatArray, ...]], values: FloatArray, numbers: int
) -> list[FloatArray]:
    """Return what ``run`` returns for all draws (J, d), running some of them at a time.

    ``numbers`` is how many numbers one draw makes.
    """
    first, *others = blocks(len(values), numbers) or [slice(0, 0)]
    pieces = run(values[first])
    if not others:
        return list(pieces)
    out = [np.empty((len(values), *piece.shape[1:])) for piece in pieces]
    for block in (first, *others):
        pieces = pieces if block is first else run(values[block])
        for whole, piece in zip(out, pieces, strict=True):
            whole[block] = piece
    return out


def in_turn(features: FloatArray, c: FloatArray) -> FloatArray:
    """Return the products (n,) of rows (n, p) with c (J, p), the first for the first n / J rows."""
    groups = features.reshape(len(c), len(features) // len(c), features.shape[1])
    return (groups @ c[..., None]).ravel()


def each_with_each(X: FloatArray, omega: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return rows of n inputs for each of J parameters, (J n, ...)."""
    # columns in one piece, as simulations take them
    return np.tile(X.T, (1, len(omega))).T, np.repeat(omega.T, len(X), axis=1).T


# smallest of the eigenvalues, as a share of the largest, that rounding leaves positive
SINGULAR = 1e-12
# of the largest variance, or of a range: what is less changes no digit that is read. Of the spread
# of the output it stands for the rounding of the numbers, and keeps sigma away from zero: a fit can
# be exact to the last digit (a polynomial fitted to a polynomial)
NEGLIGIBLE = 1e-6


def nudged_cholesky(matrices: FloatArray) -> FloatArray:
    """Return Cholesky factors (J, p, p), nudged where rounding made a matrix indefinite."""
    try:
        return np.linalg.cholesky(matrices)
    except np.linalg.LinAlgError:
        # rounding can make a nearly singular matrix indefinite: nudge by its own size
        size = matrices.shape[-1]
        eigenvalue = np.linalg.eigvalsh(matrices)
        singular = eigenvalue[:, :1] < SINGULAR * eigenvalue[:, -1:]
        nudge = 1e-10 * np.einsum("jkk->jk", matrices) * singular
        matrices = matrices.copy()
        matrices[:, np.arange(size), np.arange(size)] += nudge
        return np.linalg.cholesky(matrices)


def log_det_of(factors: FloatArray) -> FloatArray:
    """Return the log determinants (J,) of triangular factors (J, p, p)."""
    return np.log(np.diagonal(factors, axis1=1, axis2=2)).sum(axis=1)


def pivoted_factor(covariance: FloatArray, least: float) -> FloatArray:
    """Return F (n, r) with F F' the covariance (n, n), as `pivoted_cholesky`, which is known."""
    lower, order, r, _ = dpstrf(covariance, tol=least, lower=1)
    factor = np.empty((len(covariance), r))
    factor[order - 1] = np.tril(lower[:, :r])
    return factor


def factor_by_columns(
    diagonal: FloatArray, columns: Callable[[slice], FloatArray], least: float, most: int
) -> FloatArray:
    """Return F (n, r) with F F' the covariance (n, n), of which ``columns(some)`` are (n, m).

    As `pivoted_cholesky`; but where so many columns are needed that all of them are made as soon
    together, they are: at most twice as slow as the faster of both.
    """
    n = len(diagonal)
    dense = n <= MAX_DENSE
    few = n**2 // _NUMBERS_A_CALL if dense else most
    factor, chosen = pivoted_cholesky(
        diagonal, lambda k: columns(slice(k, k + 1))[:, 0], least, few
    )
    return pivoted_factor(columns(slice(None)), least) if dense and len(chosen) == few else factor


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


def one_blas_thread() -> Any:
    """Return a context in which BLAS has one thread.

    Fits are many products of small matrices: threads wait for each other longer than they work, and
    where other processes run, twenty times as long.

    Examples
    --------
    >>> with one_blas_thread():
    ...     all(pool["num_threads"] == 1 for pool in _controller().select(user_api="blas").info())
    True
    """
    return _controller().limit(limits=1, user_api="blas")


@lru_cache(maxsize=1)
def _controller() -> ThreadpoolController:
    # it takes milliseconds to look through the libraries that are loaded
    return ThreadpoolController()
