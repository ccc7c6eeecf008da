"""The outputs of rows: computed at the same time, timed, and kept in a table of bounded size.

Each output is stored when its call ends; a call whose output is stored is not made again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from threading import Lock
from time import perf_counter
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import pandas as pd
from joblib import effective_n_jobs
from numpy.typing import NDArray

from hybridsurrogate.simulation.calls import (
    Function,
    Outcome,
    all_at_once,
    called,
    row_by_row,
)
from hybridsurrogate.simulation.run_store import RunStore
from hybridsurrogate.types import FloatArray

# of the runs that one simulation keeps: a bound on memory
_MAX_BYTES = 64 * 2**20
# A diagnosis of an ODE has a simulation, and so a table, for each of some forty causes, in each
# fold. Those that were used last may have as much together
_MAX_BYTES_OF_ALL = 8 * _MAX_BYTES
# To find a row takes about 0.4 us: a function of arrays that takes less is called again. Of fewer
# rows the time is that of the call
_QUICK_SECONDS, _MIN_TIMED_ROWS, _N_TIMED_CALLS = 1e-6, 1000, 3

_Table = tuple[NDArray[np.uint64], FloatArray, NDArray[np.bool_]]


class OutputCache:
    """A table of rows and their outputs; of two rows with one place in it the later one stays.

    All tables of a process share half a gigabyte: where a new one does not fit, those that were not
    used for longest are dropped.

    Parameters
    ----------
    n_bytes : int, default=2**26
        Its size at most.

    Examples
    --------
    >>> import numpy as np
    >>> from hybridsurrogate.simulation.evaluation import OutputCache
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

    def __init__(self, n_bytes: int = _MAX_BYTES) -> None:
        self.n_bytes = n_bytes
        self._table: _Table | None = None
        self._seconds, self._calls = np.inf, 0

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
        # in the order of the rows: neighbours may share a solution
        which, mixed, first = _distinct(mixed)
        # different rows with one number: all of them are called
        if len(first) < len(bits) and (bits[first][which] != bits).any():
            return function(points)
        bits = bits[first]
        table = self._table
        if table is None:
            y = function(points[first])
            table = self._empty(bits.shape[1], y.shape[1:])
            _add(table, bits, y, mixed)
            self._table = table
            self._share()
            return y[which]
        self._share()
        keys, values, filled = table
        place = _place(table, mixed)
        known = filled[place] & (keys[place] == bits).all(axis=1)
        y = values[place]
        new = np.flatnonzero(~known)
        if new.size:
            y[new] = function(points[first[new]])
            _add(table, bits[new], y[new], mixed[new])
        return y[which]

    def outputs_if_slow(
        self, function: Callable[[FloatArray], FloatArray], points: FloatArray
    ) -> FloatArray:
        """Return what `outputs` does; a function of many rows at once is called for all, if quick.

        The quickest of its first calls decides: on a busy machine others have to wait.
        """
        if self._calls >= _N_TIMED_CALLS and self._seconds > _QUICK_SECONDS:
            return self.outputs(function, points)
        if self._calls >= _N_TIMED_CALLS or len(points) < _MIN_TIMED_ROWS:
            return function(points)
        start = perf_counter()
        y = function(points)
        self._seconds = min(self._seconds, (perf_counter() - start) / len(points))
        self._calls += 1
        return y

    def _share(self) -> None:
        """Become the one that was used last, and drop the tables that are too many."""
        with _LOCK:
            _USED.pop(self, None)
            _USED[self] = self.n_bytes
            total = sum(_USED.values())
            for cache, n_bytes in list(_USED.items())[:-1]:
                if total <= _MAX_BYTES_OF_ALL:
                    break
                cache._table = None
                del _USED[cache]
                total -= n_bytes

    def _empty(self, d: int, several: tuple[int, ...]) -> _Table:
        each = 8 * (d + int(np.prod(several))) + 1
        n = 1 << max(1, int(np.log2(self.n_bytes / each)))
        # zeros take memory only where they are written to
        keys = np.zeros((n, d), dtype=np.uint64)
        return keys, np.zeros((n, *several)), np.zeros(n, dtype=bool)


# caches with a table, those that were used last at the end, and its bytes at most
_USED: WeakKeyDictionary[OutputCache, int] = WeakKeyDictionary()
_LOCK = Lock()


def _place(table: _Table, mixed: NDArray[np.uint64]) -> NDArray[np.intp]:
    return (mixed & np.uint64(len(table[2]) - 1)).astype(np.intp)


def _add(table: _Table, bits: NDArray[np.uint64], y: FloatArray, mixed: NDArray[np.uint64]) -> None:
    keys, values, filled = table
    # of rows with one place the first, in all three arrays alike
    place, first = _distinct(_place(table, mixed))[1:]
    keys[place], values[place], filled[place] = bits[first], y[first], True


def _distinct(
    numbers: NDArray[Any],
) -> tuple[NDArray[np.intp], NDArray[Any], NDArray[np.intp]]:
    """Return which distinct number each one is, these, and where each comes first, in order."""
    which, distinct = pd.factorize(numbers)
    first = np.empty(len(distinct), dtype=np.intp)
    first[which[::-1]] = np.arange(len(numbers))[::-1]
    return which, np.asarray(distinct), first


def _mixed(bits: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return one number (n,) for each row (n, d) of bits."""
    mixed = np.zeros(len(bits), dtype=np.uint64)
    for column in bits.T:
        mixed = pd.util.hash_array(mixed ^ column)
    return mixed


# Of so many rows for each process the first are called here, for so many seconds: processes take
# about a second to start, and share the others where these take longer
_ROWS_PER_PROCESS, _SECONDS_ALONE, _SECONDS_SHARED = 32, 0.1, 2.0


@dataclass(frozen=True)
class Running:
    """How runs are made.

    Attributes
    ----------
    n_jobs : int or None
    progress : bool
    store : RunStore or None
    timeout : float or None
        Seconds for one run.
    """

    n_jobs: int | None = None
    progress: bool = False
    store: RunStore | None = None
    timeout: float | None = None


def evaluate(
    function: Function, X: FloatArray, omega: FloatArray, running: Running
) -> tuple[FloatArray, str | None]:
    """Return outputs (n,), NaN where a run failed, and what the first such run said.

    Of k outputs (n, k).
    """
    points = np.hstack([X, omega])
    if function.vectorized and running.store is None:
        return all_at_once(function, points)
    if function.returns == "values" and running == Running(running.n_jobs):
        return _by_row(function, points, running)
    return _by_run(function, points, running)


def _by_row(
    function: Function, points: FloatArray, running: Running
) -> tuple[FloatArray, str | None]:
    n_jobs = effective_n_jobs(running.n_jobs)
    if n_jobs == 1:
        return row_by_row(function, points)[:2]
    if len(points) < _ROWS_PER_PROCESS * n_jobs:
        return _by_run(function, points, running)
    y, error, n = row_by_row(function, points, _SECONDS_ALONE)
    if n == len(points):
        return y, error
    left = points[n:]
    if len(left) * _SECONDS_ALONE / n < _SECONDS_SHARED:
        others, another, _ = row_by_row(function, left)
    else:
        others, another = _by_run(function, left, running)
    return np.concatenate([y, others]), error or another


def _by_run(
    function: Function, points: FloatArray, running: Running
) -> tuple[FloatArray, str | None]:
    runs = _runs(function, points)
    y, errors = np.full((len(points), *function.several), np.nan), {}
    missing = []
    for k, rows in enumerate(runs):
        known = None if running.store is None else running.store.known(points[rows])
        if known is None:
            missing.append(k)
        else:
            y[rows], error = known
            if error:
                errors[k] = error
    for outcomes in _made(function, points, runs, missing, running):
        for outcome in outcomes:
            if outcome.error is None:
                y[runs[outcome.which]] = outcome.value
            else:
                errors[outcome.which] = outcome.error
        if running.store is not None:
            running.store.add(
                (points[runs[k]], y[runs[k]], error, seconds) for k, _, error, seconds in outcomes
            )
    return y, errors[min(errors)] if errors else None


def _runs(function: Function, points: FloatArray) -> list[NDArray[np.intp]]:
    """Return the rows of each run, along a curve in the order of the first input."""
    if function.returns != "curve":
        return [np.array([row]) for row in range(len(points))]
    # the order of the points, not of their values: a design that grows begins the same
    _, first, run = np.unique(points[:, 1:], axis=0, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))[run.ravel()]
    order = np.lexsort((points[:, 0], rank))
    return np.split(order, np.cumsum(np.bincount(rank))[:-1])


def _made(
    function: Function,
    points: FloatArray,
    runs: Sequence[NDArray[np.intp]],
    missing: Sequence[int],
    running: Running,
) -> Iterator[list[Outcome]]:
    """Yield the outcomes that come together, their values as arrays of their outputs."""
    if function.vectorized:
        rows = np.concatenate([runs[k] for k in missing] or [np.empty(0, dtype=np.intp)])
        if not len(rows):
            yield []
            return
        y, error = all_at_once(function, points[rows])
        failed = np.asarray(np.isnan(y).reshape(len(y), -1).all(axis=1))
        yield [
            Outcome(k, value, error if lost else None, 0.0)
            for k, value, lost in zip(missing, y, failed, strict=True)
        ]
        return
    curve = function.returns == "curve"
    arguments = []
    for k in missing:
        rows = runs[k]
        own: dict[str, Any] = dict(zip(function.names, points[rows[0]], strict=False))
        if curve:
            own[function.names[0]] = np.unique(points[rows, 0])
        arguments.append(own)
    title = function.name if running.progress else None
    outcomes = called(function.call, arguments, missing, running.n_jobs, title, running.timeout)
    for outcome in outcomes:
        if outcome.error is None:
            rows = runs[outcome.which]
            value = function.of_run(outcome.value, points[rows, 0])
            outcome = outcome._replace(value=value)
        yield [outcome]
