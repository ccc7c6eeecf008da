"""Solutions of ODEs for many parameters at once: free functions on arrays."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from hybridsurrogate.types import FloatArray


def equal_runs(columns: Sequence[FloatArray], n: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return where runs of equal rows begin (m,), and the run of each of the n rows (n,)."""
    changes = np.zeros(n, dtype=bool)
    changes[:1] = True
    for column in columns:
        changes[1:] |= column[1:] != column[:-1]
    return np.flatnonzero(changes), np.cumsum(changes) - 1


def together(
    columns: Sequence[FloatArray], first: NDArray[np.intp], member: NDArray[np.intp]
) -> NDArray[np.intp] | None:
    """Return an order of the n rows in which equal runs are one; None where they are already.

    Parameters
    ----------
    first, member : ndarray of int
        As from `equal_runs`.
    """
    if len(first) < 2 or not columns:
        return None
    _, group = np.unique(np.stack([c[first] for c in columns]), axis=1, return_inverse=True)
    group = group.ravel()
    if group.max() + 1 == len(first):
        return None
    return np.argsort(group[member], kind="stable")


def runge_kutta(
    slope: Callable[[int, FloatArray, FloatArray, FloatArray, int], FloatArray],
    state: FloatArray,
    n_steps: int,
    step: float,
) -> tuple[FloatArray, FloatArray]:
    """Follow m solutions at once by the classical fourth-order method with a fixed step.

    Parameters
    ----------
    slope : callable
        ``slope(k, state, states, slopes, known) -> (n_states, m)`` at k half steps after the start;
        states are known up to there, slopes at so many whole steps.
    state : ndarray of shape (n_states, m)
        At the start.

    Returns
    -------
    states, slopes : ndarray of shape (n_steps + 1, n_states, m)
    """
    states = np.empty((n_steps + 1, *state.shape))
    slopes = np.empty_like(states)
    states[0] = state
    for k in range(n_steps):
        a = slope(2 * k, state, states, slopes, k)
        slopes[k] = a
        b = slope(2 * k + 1, state + step / 2 * a, states, slopes, k + 1)
        c = slope(2 * k + 1, state + step / 2 * b, states, slopes, k + 1)
        d = slope(2 * k + 2, state + step * c, states, slopes, k + 1)
        state = state + step / 6 * (a + 2 * (b + c) + d)
        states[k + 1] = state
    slopes[-1] = slope(2 * n_steps, state, states, slopes, n_steps)
    return states, slopes


def past(
    states: FloatArray,
    slopes: FloatArray,
    step: float,
    position: FloatArray,
    newest: FloatArray,
    at: float,
) -> FloatArray:
    """Return one state of m solutions at times gone by; before the start what it is there.

    Whole steps are cubics. From the last known slope to the newest state it is a parabola: a cubic
    continued beyond its step would make fast rates with short lags unstable.

    Parameters
    ----------
    states, slopes : ndarray of shape (k, m)
        At the steps so far of which slopes are known.
    position : ndarray of shape (m,)
        Time since the start in steps.
    newest : ndarray of shape (m,)
        The state at time ``at`` in steps, within one of the last known slope.

    Returns
    -------
    ndarray of shape (m,)
        NaN for NaN, and for what is still to come.
    """
    last, column = len(slopes) - 1, np.arange(len(position))
    # of rounding at most, where a lag is zero
    possible = position <= at + 1e-9
    position = np.clip(np.where(possible, position, 0.0), 0.0, at)
    u, d = position - last, at - last
    left, rise = states[last], slopes[last]
    recent = left + step * u * rise + (newest - left - step * d * rise) * (u / d) ** 2
    values = np.where(possible, recent, np.nan)
    old = np.flatnonzero(possible & (position < last))
    if old.size:
        index = position[old].astype(np.intp)
        pair = np.stack([index, index + 1]), column[old]
        values[old] = cubic(states[pair], slopes[pair], step, position[old] - index)
    return values


def cubic(states: FloatArray, slopes: FloatArray, step: float, t: FloatArray) -> FloatArray:
    """Interpolate between two steps, states and slopes (2, ...), at shares t of the distance."""
    s = 1 - t
    values = states[0] * (s * s * (1 + 2 * t)) + states[1] * (t * t * (1 + 2 * s))
    values += (step * t * s) * (slopes[0] * s - slopes[1] * t)
    return values


def hermite(
    states: FloatArray,
    slopes: FloatArray,
    step: float,
    position: FloatArray,
    column: NDArray[np.intp],
) -> FloatArray:
    """Interpolate solutions between their steps by cubics that share states and slopes.

    Parameters
    ----------
    states, slopes : ndarray of shape (n_steps + 1, n_states, m)
    position : ndarray of shape (n,)
        Time since the start in steps; NaN gives NaN.
    column : ndarray of shape (n,)
        Which of the m solutions.

    Returns
    -------
    ndarray of shape (n_states, n)
    """
    known = np.where(np.isfinite(position), position, 0.0)
    index = np.minimum(known, len(states) - 2).astype(np.intp)
    pair = np.stack([index, index + 1]), slice(None), column
    t = (position - index)[:, None]
    return cubic(states[pair], slopes[pair], step, t).T


def adaptive(
    slope: Callable[[float, FloatArray], FloatArray],
    state: FloatArray,
    times: FloatArray,
    start: float,
    method: str,
    max_step: float,
) -> FloatArray:
    """Follow one solution by a method of `scipy.integrate.solve_ivp`.

    Parameters
    ----------
    slope : callable
        ``slope(t, state) -> (n_states,)``
    state : ndarray of shape (n_states,)
    times : ndarray of shape (n,)

    Returns
    -------
    ndarray of shape (n_states, n)
        NaN where the method fails or the time is NaN.
    """
    out = np.full((len(state), len(times)), np.nan)
    out[:, times == start] = state[:, None]
    later = times > start
    if not later.any() or not np.isfinite(state).all():
        return out
    span = (start, float(times[later].max()))
    size, origin = 1 + np.abs(state), np.zeros(len(state))
    while True:
        found = solve_ivp(
            lambda t, state, origin=origin: slope(t, state + origin),
            span,
            state - origin,
            method=method,
            dense_output=True,
            max_step=max_step,
            rtol=1e-8,
            # slopes know a state far from zero no better than it is rounded
            atol=np.maximum(1e-10 * size, np.spacing(np.abs(origin))),
        )
        # what was reached before a failure is not kept: a solution that breaks down is no solution
        if not (found.success and found.sol is not None and np.isfinite(found.y).all()):
            return out
        # states in units that make them small need as many digits
        reached = np.max(np.abs(found.y), axis=1)
        changed = extent(found.y)
        # a tolerance in shares of a level far from zero would be more than all that happens there
        far = changed < reached
        coarse = (reached > 0) & (reached < 0.01 * size)
        if not (coarse | far).any():
            break
        size = np.where(far, changed, np.where(coarse, reached, size))
        origin = np.where(far, state, origin)
    out[:, later] = found.sol(times[later]) + origin[:, None]
    return out


def extent(states: FloatArray) -> FloatArray:
    """Return the largest size of states (..., n) over n times, (...), of which errors are shares.

    Of states that stay far from zero it is how much they change.
    """
    largest, change = np.max(np.abs(states), axis=-1), np.ptp(states, axis=-1)
    # what hardly changes is rounding
    far = (change < 0.01 * largest) & (change > 1e-10 * largest)
    return np.where(far, change, largest)
