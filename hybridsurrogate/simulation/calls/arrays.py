"""One call for all rows: what it returns, which rows fail, and functions that take numbers only."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from hybridsurrogate.simulation.calls.function import Function
from hybridsurrogate.simulation.calls.jobs import in_words
from hybridsurrogate.types import FloatArray


class TakesNumbersError(Exception):
    """A function that works with numbers and not with arrays; ``args[0]`` is what it said."""


def all_at_once(function: Function, points: FloatArray) -> tuple[FloatArray, str | None]:
    """Return outputs (n,) or (n, n_outputs) of rows (n, d), NaN where they fail, and an error.

    Where the call fails and a typical row works as an array, rows are halved until those that fail
    are alone; all others keep their outputs.

    Raises
    ------
    TakesNumbersError
        Where a typical row works as numbers, and not as an array.
    Exception
        What the function raised, where a typical row fails too.
    """
    try:
        return _outputs(function, points), None
    except _ShapeError as wrong:
        _check_for_numbers(function, points, str(wrong))
        raise ValueError(str(wrong)) from None
    except Exception as caught:
        if not len(points):
            raise
        works = _works(function, np.array([function.typical()] * 2))
        if not works:
            _check_for_numbers(function, points, in_words(caught))
            raise
        return _kept(function, points, in_words(caught))


class _ShapeError(ValueError):
    """An array of the wrong shape."""


def _outputs(function: Function, points: FloatArray) -> FloatArray:
    columns = np.ascontiguousarray(points.T)
    value = function.call(**dict(zip(function.names, columns, strict=True)))
    try:
        y = function.read(value)
        function.check_shape(y.shape, (len(points), *function.several))
    except ValueError as error:
        raise _ShapeError(str(error)) from error
    return y


def _kept(function: Function, points: FloatArray, error: str) -> tuple[FloatArray, str]:
    y = np.full((len(points), *function.several), np.nan)
    pending = [(0, len(points))]
    while pending:
        low, high = pending.pop()
        if low > 0 or high < len(points):
            try:
                y[low:high] = _outputs(function, points[low:high])
                continue
            except _ShapeError as wrong:
                raise ValueError(str(wrong)) from None
            except Exception:
                # a simulation may fail in any way, and takes its neighbours with it
                if high - low == 1:
                    continue
        elif high == 1:
            continue
        middle = (low + high) // 2
        pending += [(middle, high), (low, middle)]
    return y, error


def _check_for_numbers(function: Function, points: FloatArray, said: str) -> None:
    """Raise TakesNumbersError where arrays of two rows fail and one row of numbers does not."""
    for point in (np.array(function.typical()), *points[:1]):
        twice = np.array([point, point])
        if _quietly(partial(_of_numbers, function, point)) and not _works(function, twice):
            raise TakesNumbersError(said)


def _of_numbers(function: Function, point: FloatArray) -> FloatArray:
    value = function.call(**dict(zip(function.names, point.tolist(), strict=True)))
    return function.of_run(value, point[:1])


def _works(function: Function, points: FloatArray) -> bool:
    return _quietly(partial(_outputs, function, points))


def _quietly(call: Callable[[], Any]) -> bool:
    try:
        call()
    except Exception:
        return False
    return True
