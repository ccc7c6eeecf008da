"""Outputs of rows that were computed before, in a table of bounded size."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.priors import FloatArray

_BYTES = 64 * 2**20
# odd, of mixed bits (Steele, Lea and Flood 2014, the constants of SplitMix64)
_GOLDEN, _MIX = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xBF58476D1CE4E5B9)


class OutputCache:
    """A table of rows and their outputs; of two rows with one place in it the later one stays.

    Parameters
    ----------
    n_bytes : int, default=2**26
        Its size at most.

    Examples
    --------
    >>> import numpy as np
    >>> from hybridsurrogate.simulation.calls.output_cache import OutputCache
    >>> cache, asked = OutputCache(), []
    >>> def double(points):
    ...     asked.append(len(points))
    ...     return 2 * points[:, 0]
    >>> cache.outputs(double, np.array([[1.0], [2.0], [1.0]]))
    array([2., 4., 2.])
    >>> cache.outputs(double, np.array([[2.0], [3.0]]))
    array([4., 6.])
    >>> asked
    [2, 1]
    """

    def __init__(self, n_bytes: int = _BYTES) -> None:
        self.n_bytes = n_bytes
        self._table: tuple[NDArray[np.uint64], FloatArray, NDArray[np.bool_]] | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        # another process begins with an empty table
        return OutputCache, (self.n_bytes,)

    def outputs(
        self, function: Callable[[FloatArray], FloatArray], points: FloatArray
    ) -> FloatArray:
        """Return the outputs (n,) or (n, k) of rows (n, d); the function gets those not known."""
        bits = np.ascontiguousarray(points, dtype=float).view(np.uint64)
        if not bits.size:
            return function(points)
        mixed = _mixed(bits)
        if self._table is None:
            y, where = _once(function, points, bits, mixed)
            self._table = self._empty(bits.shape[1], y.shape[1:])
            self._add(bits[where], y[where], mixed[where])
            return y
        keys, values, filled = self._table
        place = self._place(mixed)
        known = filled[place] & (keys[place] == bits).all(axis=1)
        y = values[place]
        new = np.flatnonzero(~known)
        if new.size:
            y[new], where = _once(function, points[new], bits[new], mixed[new])
            where = new[where]
            self._add(bits[where], y[where], mixed[where])
        return y

    def _empty(
        self, d: int, several: tuple[int, ...]
    ) -> tuple[NDArray[np.uint64], FloatArray, NDArray[np.bool_]]:
        each = 8 * (d + int(np.prod(several))) + 1
        n = 1 << max(1, int(np.log2(self.n_bytes / each)))
        # zeros take memory only where they are written to
        keys = np.zeros((n, d), dtype=np.uint64)
        return keys, np.zeros((n, *several)), np.zeros(n, dtype=bool)

    def _place(self, mixed: NDArray[np.uint64]) -> NDArray[np.intp]:
        assert self._table is not None
        return (mixed & np.uint64(len(self._table[2]) - 1)).astype(np.intp)

    def _add(self, bits: NDArray[np.uint64], y: FloatArray, mixed: NDArray[np.uint64]) -> None:
        assert self._table is not None
        keys, values, filled = self._table
        # of rows with one place the last, in all three arrays alike
        place, last = np.unique(self._place(mixed)[::-1], return_index=True)
        last = len(mixed) - 1 - last
        keys[place], values[place], filled[place] = bits[last], y[last], True


def _once(
    function: Callable[[FloatArray], FloatArray],
    points: FloatArray,
    bits: NDArray[np.uint64],
    mixed: NDArray[np.uint64],
) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return the outputs of rows, equal rows called once, and which rows were called."""
    _, first, which = np.unique(mixed, return_index=True, return_inverse=True)
    first, same = first, first[which.ravel()]
    # different rows with one number: all of them are called
    if (bits[same] != bits).any():
        first = same = np.arange(len(bits))
    # in the order of the rows: neighbours may share a solution
    first = np.sort(first)
    y = function(points[first])
    return y[np.searchsorted(first, same)], first


def _mixed(bits: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return one number (n,) for each row (n, d) of bits."""
    mixed = np.zeros(len(bits), dtype=np.uint64)
    for column in bits.T:
        mixed = (mixed ^ column) * _GOLDEN
        mixed ^= mixed >> np.uint64(29)
        mixed *= _MIX
        mixed ^= mixed >> np.uint64(32)
    return mixed
