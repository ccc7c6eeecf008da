"""One call a row: what costs time is the function, not what surrounds it."""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from hybridsurrogate.simulation.calls.function import Function
from hybridsurrogate.simulation.calls.jobs import in_words
from hybridsurrogate.types import FloatArray

# errors of Python's numbers where numpy's give infinity or NaN, or have a method
_OF_PLAIN_NUMBERS = (ArithmeticError, AttributeError, TypeError)


def row_by_row(
    function: Function, points: FloatArray, seconds: float = np.inf
) -> tuple[FloatArray, str | None, int]:
    """Call a function once for each row.

    Parameters
    ----------
    function : Function
        One that returns values.
    points : ndarray of shape (n, n_arguments)
    seconds : float
        After which to stop.

    Returns
    -------
    y : ndarray of shape (m,) or (m, n_outputs)
        NaN where the function raised.
    error : str or None
        Of the first row that failed.
    m : int
        Rows that were called.
    """
    call = by_position(function.call, function.names)
    y = np.full((len(points), *function.several), np.nan)
    # a list takes a number in a third of the time of an array
    found = [np.nan] * len(points)
    error, n, limited, stop = None, len(points), seconds < np.inf, time.perf_counter() + seconds
    # Python's numbers: arithmetic with numpy's takes three times as long
    for row, own in enumerate(zip(*points.T.tolist(), strict=True)):
        if limited and row and time.perf_counter() > stop:
            n = row
            break
        try:
            value = call(*own)
            if type(value) is complex:
                value = call(*points[row])
        except _OF_PLAIN_NUMBERS:
            value, failure = _with_numpy(call, points[row])
            if failure is not None:
                error = error or failure
                continue
        except Exception as caught:
            # a simulation may fail in any way: the run is dropped, and the message is shown
            error = error or in_words(caught)
            continue
        if isinstance(value, float | int) and not function.several:
            found[row] = value
        else:
            y[row] = function.of_run(value, points[row, :1])[0]
            if not function.several:
                found[row] = float(y[row])
    return y[:n] if function.several else np.array(found[:n], dtype=float), error, n


def by_position(function: Callable[..., Any], names: Sequence[str]) -> Callable[..., Any]:
    """Return a function of arguments in the order of names."""
    kind = inspect.Parameter.POSITIONAL_OR_KEYWORD
    try:
        own = [a.name for a in inspect.signature(function).parameters.values() if a.kind is kind]
    except ValueError:  # some compiled functions have no signature
        own = []
    if own[: len(names)] == list(names):
        return function
    return lambda *values: function(**dict(zip(names, values, strict=True)))


def _with_numpy(call: Callable[..., Any], point: FloatArray) -> tuple[Any, str | None]:
    """Return the value of a row for numpy's numbers, or the error where they fail alike."""
    try:
        return call(*point), None
    except Exception as caught:
        return None, in_words(caught)
