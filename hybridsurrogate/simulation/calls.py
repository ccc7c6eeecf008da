"""Calls of the function behind a simulation: all rows at once or one a row, timed and limited."""

from __future__ import annotations

import inspect
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pickle import PicklingError
from typing import Any, NamedTuple

import numpy as np
from joblib import Parallel, delayed, effective_n_jobs

from hybridsurrogate.notebook import counted
from hybridsurrogate.types import FloatArray


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
    typical : callable
        Returns arguments at which the function should work.
    read : callable
        Makes an array (..., n_outputs), (...) of a single one, of what the function returned.
    """

    call: Callable[..., Any]
    name: str
    names: Sequence[str]
    outputs: Sequence[str]
    returns: str
    vectorized: bool
    typical: Callable[[], Sequence[float]]
    read: Callable[[Any], FloatArray]

    @property
    def several(self) -> tuple[int, ...]:
        """The shape of what a row has: () for one output, (k,) for several."""
        return () if len(self.outputs) == 1 else (len(self.outputs),)

    def of_run(self, value: Any, places: FloatArray) -> FloatArray:
        """Return what one call returned as the outputs of its rows, at places of a curve."""
        outputs = self.read(value)
        if self.returns != "curve":
            self.check_shape(outputs.shape, self.several)
            return outputs[None]
        different, which = np.unique(places, return_inverse=True)
        self.check_shape(outputs.shape, (*different.shape, *self.several))
        out: FloatArray = outputs[which.ravel()]
        return out

    def check_shape(self, actual: tuple[int, ...], expected: tuple[int, ...]) -> None:
        """Raise ValueError where the shapes differ."""
        if actual == expected:
            return
        hint = f"vectorized={self.vectorized}: "
        hint += "arrays in, an array out" if self.vectorized else "numbers in, a number out"
        if self.returns == "curve":
            hint = 'returns="curve": as many values as the first input has'
        raise ValueError(
            f"{self.name!r} returned an array of shape {actual}, expected {expected} ({hint})."
        )


class WrongShapeError(ValueError):
    """A function of the user's that returns an array of the wrong shape, whatever the row."""


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
    except WrongShapeError as wrong:
        _check_for_numbers(function, points, str(wrong))
        raise
    except Exception as caught:
        if not len(points):
            raise
        if not _works(_outputs, function, np.array([function.typical()] * 2)):
            _check_for_numbers(function, points, in_words(caught))
            raise
        return _kept(function, points, in_words(caught))


def _outputs(function: Function, points: FloatArray) -> FloatArray:
    columns = np.ascontiguousarray(points.T)
    value = function.call(**dict(zip(function.names, columns, strict=True)))
    try:
        y = function.read(value)
        function.check_shape(y.shape, (len(points), *function.several))
    except ValueError as error:
        raise WrongShapeError(str(error)) from error
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
            except WrongShapeError:
                raise
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
        if _works(_of_numbers, function, point) and not _works(_outputs, function, twice):
            raise TakesNumbersError(said)


def _of_numbers(function: Function, point: FloatArray) -> FloatArray:
    value = function.call(**dict(zip(function.names, point.tolist(), strict=True)))
    return function.of_run(value, point[:1])


def _works(call: Callable[..., Any], *arguments: Any) -> bool:
    try:
        call(*arguments)
    except Exception:
        return False
    return True


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
        outcomes = _outcomes(tasks, function, n_jobs)
    if progress is not None:
        outcomes = iter(counted(outcomes, progress, True, len(calls)))
    yield from outcomes


def in_words(error: Exception) -> str:
    """Return kind and message of an error on one line."""
    return " ".join(f"{type(error).__name__}: {error}".split())


def _outcomes(
    tasks: Iterable[Any], function: Callable[..., Any], n_jobs: int | None
) -> Iterator[Outcome]:
    """Yield outcomes; raise PicklingError where other processes cannot be given the function."""
    try:
        # what is finished comes at once, not after those before it
        parallel = Parallel(n_jobs=n_jobs, return_as="generator_unordered")
    except ValueError:  # a backend that gives all at the end, such as "multiprocessing"
        parallel = Parallel(n_jobs=n_jobs)
    try:
        yield from parallel(tasks)
    except PicklingError as error:
        name = getattr(function, "__name__", type(function).__name__)
        raise PicklingError(
            f"n_jobs={n_jobs} sends the function {name!r} to other processes, and it cannot be "
            "pickled. Write it as `def name(...)` at the top of a module, without open files, "
            "locks or generators around it, and pass that; or use n_jobs=None."
        ) from error


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
    call = _by_position(function.call, function.names)
    # a list takes a number in a third of the time of an array
    found: list[Any] = [np.full(function.several, np.nan)] * len(points)
    error, n, limited, stop = None, len(points), seconds < np.inf, time.perf_counter() + seconds
    # Python's numbers: arithmetic with numpy's takes three times as long
    for row, own in enumerate(zip(*points.T.tolist(), strict=True)):
        if limited and row and time.perf_counter() > stop:
            n = row
            break
        try:
            value = _value(call, own, points[row])
        except Exception as caught:
            # a simulation may fail in any way: the run is dropped, and the message is shown
            error = error or in_words(caught)
            continue
        is_number = isinstance(value, float | int) and not function.several
        found[row] = value if is_number else function.of_run(value, points[row, :1])[0]
    return np.array(found[:n], dtype=float).reshape(n, *function.several), error, n


def _by_position(function: Callable[..., Any], names: Sequence[str]) -> Callable[..., Any]:
    """Return a function of arguments in the order of names."""
    kind = inspect.Parameter.POSITIONAL_OR_KEYWORD
    try:
        own = [a.name for a in inspect.signature(function).parameters.values() if a.kind is kind]
    except ValueError:  # some compiled functions have no signature
        own = []
    if own[: len(names)] == list(names):
        return function
    return lambda *values: function(**dict(zip(names, values, strict=True)))


def _value(call: Callable[..., Any], own: tuple[float, ...], point: FloatArray) -> Any:
    """Return the value of a row for Python's numbers, or for numpy's where these fail."""
    try:
        value = call(*own)
    except _OF_PLAIN_NUMBERS:
        return call(*point)
    return call(*point) if type(value) is complex else value
