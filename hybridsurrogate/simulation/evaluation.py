"""The outputs of rows: the calls of the function that they take, at the same time and timed.

Each is stored when it ends; those that are stored are not made again.
"""

from __future__ import annotations

import signal
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pickle import PicklingError
from typing import Any, NamedTuple

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray
from tqdm import tqdm

from hybridsurrogate.exceptions import FailedRunsWarning
from hybridsurrogate.priors import FloatArray
from hybridsurrogate.simulation.files.run_store import RunStore
from hybridsurrogate.simulation.outputs import by_output


@dataclass(frozen=True)
class Function:
    """A simulation's function and how it is called.

    Attributes
    ----------
    call : callable
    name : str
    names : sequence of str
        Its arguments, inputs first.
    outputs : sequence of str
    returns : {"values", "curve"}
    vectorized : bool
    """

    call: Callable[..., Any]
    name: str
    names: Sequence[str]
    outputs: Sequence[str]
    returns: str
    vectorized: bool


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
    if function.vectorized and running.store is None:
        return _all_at_once(function, X, omega), None
    points = np.hstack([X, omega])
    runs = _runs(function, points)
    y, errors = np.full((len(points), *_several(function)), np.nan), {}
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
        y = _all_at_once(function, points[rows], points[rows, :0]) if len(rows) else np.empty(0)
        yield [Outcome(k, value, None, 0.0) for k, value in zip(missing, y, strict=True)]
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
            value = _outputs(function, outcome.value, points[rows, 0])
            outcome = outcome._replace(value=value)
        yield [outcome]


def _several(function: Function) -> tuple[int, ...]:
    """Return the shape of what a row has: () for one output, (k,) for several."""
    return () if len(function.outputs) == 1 else (len(function.outputs),)


def _outputs(function: Function, value: Any, places: FloatArray) -> FloatArray:
    """Return what one call returned as the outputs of its rows."""
    outputs = by_output(value, function.outputs, repr(function.name))
    if function.returns != "curve":
        _check_shape(function, outputs.shape, _several(function))
        return outputs[None]
    different, which = np.unique(places, return_inverse=True)
    _check_shape(function, outputs.shape, (*different.shape, *_several(function)))
    out: FloatArray = outputs[which.ravel()]
    return out


def _all_at_once(function: Function, X: FloatArray, omega: FloatArray) -> FloatArray:
    columns = np.ascontiguousarray(np.concatenate([X.T, omega.T]))
    arguments = dict(zip(function.names, columns, strict=True))
    y = by_output(function.call(**arguments), function.outputs, repr(function.name))
    _check_shape(function, y.shape, (len(X), *_several(function)))
    return y


def _check_shape(function: Function, actual: tuple[int, ...], expected: tuple[int, ...]) -> None:
    if actual == expected:
        return
    hint = f"vectorized={function.vectorized}: "
    hint += "arrays in, an array out" if function.vectorized else "numbers in, a number out"
    if function.returns == "curve":
        hint = 'returns="curve": as many values as the first input has'
    raise ValueError(
        f"{function.name!r} returned an array of shape {actual}, expected {expected} ({hint})."
    )


class Outcome(NamedTuple):
    """What a call came to: which one it was, its value, or its error."""

    which: int
    value: Any
    error: str | None
    seconds: float


def called(
    function: Callable[..., Any],
    arguments: Sequence[Mapping[str, Any]],
    indices: Sequence[int],
    n_jobs: int | None,
    progress: str | None,
    timeout: float | None,
) -> Iterator[Outcome]:
    """Call a function once for each set of arguments, and yield what comes as it comes.

    Parameters
    ----------
    function : callable
    arguments : sequence of dict
    indices : sequence of int
        What to call each.
    n_jobs : int or None
        As in `joblib.Parallel`, with any of its backends.
    progress : str or None
        Title of a progress bar with the time that is left.
    timeout : float or None
        Seconds that a call may take.
    """
    tasks = [
        delayed(_call)(function, own, which, timeout)
        for own, which in zip(arguments, indices, strict=True)
    ]
    outcomes = _sent(_outcomes(tasks, n_jobs), function, n_jobs)
    if progress is not None:
        outcomes = iter(tqdm(outcomes, total=len(tasks), desc=progress))
    yield from outcomes


def _sent(
    outcomes: Iterator[Outcome], function: Callable[..., Any], n_jobs: int | None
) -> Iterator[Outcome]:
    """Yield outcomes; raise PicklingError where other processes cannot be given the function."""
    try:
        yield from outcomes
    except PicklingError as error:
        name = getattr(function, "__name__", type(function).__name__)
        raise PicklingError(
            f"n_jobs={n_jobs} sends the function {name!r} to other processes, and it cannot be "
            "pickled. Write it as `def name(...)` at the top of a module, without open files, "
            "locks or generators around it, and pass that; or use n_jobs=None."
        ) from error


def _outcomes(tasks: Iterable[Any], n_jobs: int | None) -> Iterator[Outcome]:
    try:
        # what is finished comes at once, not after those before it
        parallel = Parallel(n_jobs=n_jobs, return_as="generator_unordered")
    except ValueError:  # a backend that gives all at the end, such as "multiprocessing"
        parallel = Parallel(n_jobs=n_jobs)
    yield from parallel(tasks)


def _call(
    function: Callable[..., Any], arguments: Mapping[str, Any], which: int, timeout: float | None
) -> Outcome:
    start = time.perf_counter()
    try:
        with _limited(timeout):
            value, error = function(**arguments), None
    except Exception as caught:
        # a simulation may fail in any way: the run is dropped, and the message is shown
        value, error = np.nan, " ".join(f"{type(caught).__name__}: {caught}".split())
    return Outcome(which, value, error, time.perf_counter() - start)


@contextmanager
def _limited(seconds: float | None) -> Iterator[None]:
    """Raise TimeoutError in a block that takes longer; RuntimeError where no signal can stop it."""
    if seconds is None:
        yield
        return
    if not hasattr(signal, "SIGALRM") or threading.current_thread() is not threading.main_thread():
        raise RuntimeError(
            "timeout needs signals and the main thread of a process: use processes (joblib's loky) "
            "on Linux or macOS, or a CommandSimulator with a timeout of its own"
        )

    def stop(*_: Any) -> None:
        raise TimeoutError(f"the run took longer than {seconds:g} s and was stopped")

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def warn_of_lost_curves(
    name: str, run: NDArray[np.intp], kept: NDArray[np.bool_], n_places: int, error: str | None
) -> None:
    """Warn of runs without a single output and of single outputs that are missing.

    Raises
    ------
    ValueError
        Where nothing is left.
    """
    n = len(run) // n_places
    if not kept.any():
        raise ValueError(f"All {n} runs of {name!r} failed. First error: {error}")
    if kept.all():
        return
    lost = np.setdiff1d(run, run[kept])
    warnings.warn(
        f"{len(lost)} of {n} runs of {name!r} failed and were dropped, "
        f"{np.sum(~kept) - len(lost) * n_places} further outputs are missing. "
        f"First error: {error or 'they hold NaN or infinity'}.",
        FailedRunsWarning,
        stacklevel=4,
    )
