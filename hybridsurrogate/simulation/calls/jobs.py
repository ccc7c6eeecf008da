"""Calls that are timed and limited, one after another or at the same time."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pickle import PicklingError
from typing import Any, NamedTuple

import numpy as np
from joblib import Parallel, delayed, effective_n_jobs

from hybridsurrogate.notebook.bars import counted


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
    calls = list(zip(arguments, indices, strict=True))
    outcomes: Iterator[Outcome]
    if effective_n_jobs(n_jobs) == 1:
        outcomes = iter(_call(function, own, which, timeout) for own, which in calls)
    else:
        tasks = [delayed(_call)(function, own, which, timeout) for own, which in calls]
        outcomes = _sent(_outcomes(tasks, n_jobs), function, n_jobs)
    if progress is not None:
        outcomes = iter(counted(outcomes, progress, True, len(calls)))
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


def in_words(error: Exception) -> str:
    """Return kind and message of an error on one line."""
    return " ".join(f"{type(error).__name__}: {error}".split())


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
        value, error = np.nan, in_words(caught)
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
            "on Linux or macOS, or a CommandSimulator with its timeout argument"
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
