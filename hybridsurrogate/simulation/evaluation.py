"""The outputs of rows: the calls of the function that they take, at the same time and timed.

Each is stored when it ends; those that are stored are not made again.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from joblib import effective_n_jobs
from numpy.typing import NDArray

from hybridsurrogate.exceptions import FailedRunsWarning
from hybridsurrogate.simulation.calls.arrays import TakesNumbersError, all_at_once
from hybridsurrogate.simulation.calls.function import Function
from hybridsurrogate.simulation.calls.jobs import Outcome, called
from hybridsurrogate.simulation.calls.rows import row_by_row
from hybridsurrogate.simulation.files.run_store import RunStore
from hybridsurrogate.types import FloatArray

# Of so many rows for each process the first are called here, for so many seconds: processes take
# about a second to start, and share the others where these take longer
_MANY, _ALONE, _SHARED = 32, 0.1, 2.0

__all__ = ["Function", "Running", "TakesNumbersError", "evaluate", "warn_of_lost_curves"]


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
    if len(points) < _MANY * n_jobs:
        return _by_run(function, points, running)
    y, error, n = row_by_row(function, points, _ALONE)
    if n == len(points):
        return y, error
    left = points[n:]
    if len(left) * _ALONE / n < _SHARED:
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
