"""Large batches cut into blocks."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hybridsurrogate.types import FloatArray

# numbers in one block: what is made on the way stays in the processor's cache, and its memory is
# not asked of the system again and again
BLOCK = 200_000
# where a block is a call that costs much however few its numbers are, such as a run of the
# simulation: as many as memory may hold at once, 32 MB
LARGE_BLOCK = 20 * BLOCK


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
