"""Stiff equations: a Rosenbrock method for many solutions at once, each with adaptive steps."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.types import FloatArray

# RODAS of Hairer and Wanner (1996, section IV.7), order 4, stiffly accurate: stages
_GAMMA = 0.25
_A = (
    (),
    (1.544,),
    (0.9466785280815826, 0.2557011698983284),
    (3.314825187068521, 2.896124015972201, 0.9986419139977817),
    (1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950),
    (1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950, 1.0),
)
_C = (
    (),
    (-5.6688,),
    (-2.430093356833875, -0.2063599157091915),
    (-0.1073529058151375, -9.594562251023355, -20.47028614809616),
    (7.496443313967647, -10.24680431464352, -33.99990352819905, 11.70890893206160),
    (
        8.083246795921522,
        -7.981132988064893,
        -31.52159432874371,
        16.31930543123136,
        -6.058818238834054,
    ),
)
# where its stages are in a step, and what each takes of the slope over time
_TIMES = ((0.0, 0.25), (0.386, -0.1043), (0.21, 0.1035), (0.63, -0.0362), (1.0, 0.0), (1.0, 0.0))
# and what is between two steps
_DENSE_OUTPUT = (
    (
        10.12623508344586,
        -7.487995877610167,
        -34.80091861555747,
        -7.992771707568823,
        1.025137723295662,
    ),
    (
        -0.6762803392801253,
        6.087714651680015,
        16.43084320892478,
        24.76722511418386,
        -6.594389125716872,
    ),
)
# steps are the range of time halved so often; solutions begin with a short one
# and take none so long that what is between its ends is no better known than to third order
_MAX_LEVEL, _FIRST_LEVEL, _MIN_LEVEL = 44, 12, 6
# errors of a step in shares of a state; of a small one in shares of its size
_RTOL, _ATOL = 1e-4, 3e-4
# how often the step changes by two at a time
_MAX_HALVINGS, _MAX_DOUBLINGS = 12, 3

# slopes (n_states, k) at times (k,), of states (n_states, k) of the solutions (k,) that are named
Slope = Callable[[FloatArray, FloatArray, NDArray[np.intp]], FloatArray]


def rosenbrock(
    slope: Slope,
    state: FloatArray,
    times: FloatArray,
    member: NDArray[np.intp],
    start: float,
    span: float,
    sizes: FloatArray,
    max_steps: int,
    at_one_time: bool,
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Follow m solutions; what a solution gives does not depend on the others.

    Parameters
    ----------
    slope : callable
        ``slope(t, state, which) -> (n_states, k)``, t of shape (k,)
    state : ndarray of shape (n_states, m)
        At the start.
    times, member : ndarray of shape (n,)
        When states are wanted, and of which solution.
    start, span : float
        Steps are ``span`` halved, again and again, and begin at multiples of themselves.
    sizes : ndarray of shape (n_states,)
        Of the states, of which small ones have errors in shares.
    max_steps : int
        Of one solution, those that are taken back included.
    at_one_time : bool
        Whether the times in a call of slope must be equal, which takes many more calls.

    Returns
    -------
    states : ndarray of shape (n_states, n)
        NaN where a solution took more steps or broke down.
    failed : ndarray of bool of shape (m,)
    """
    m = state.shape[1]
    failed = np.zeros(m, dtype=bool)
    out = np.where(times == start, state[:, member], np.nan)
    latest = np.full(m, start)
    np.maximum.at(latest, member, np.where(np.isfinite(times), times, start))
    first, state, tried = state, state.copy(), np.zeros(m, dtype=np.intp)
    position, level = np.zeros(m, dtype=np.int64), np.full(m, _FIRST_LEVEL)
    again = np.zeros(m, dtype=bool)
    running = (latest > start) & np.isfinite(state).all(axis=0)
    while running.any():
        which = np.flatnonzero(running)
        if at_one_time:
            which = which[position[which] == position[which].min()]
            which = which[level[which] == level[which].max()]
        own, before = level[which], position[which]
        t, h = start + span * (before / 2.0**_MAX_LEVEL), span / 2.0**own
        old = state[:, which]
        new, error, bends = _step(slope, t, h, old, which, sizes)
        # of a level far from zero a share is more than all that happens there
        moved = np.maximum(np.abs(new - first[:, which]), sizes[:, None])
        scale = np.minimum(np.maximum(np.abs(old), np.abs(new)), moved)
        share = np.max(np.abs(error) / (_RTOL * (scale + _ATOL * sizes[:, None])), axis=0)
        share = np.where(np.isfinite(share), share, np.inf)
        good = share <= 1
        done = which[good]
        column = np.full(m, -1)
        column[done] = np.flatnonzero(good)
        at = column[member]
        rows = np.flatnonzero((at >= 0) & (times > t[at]) & (times <= t[at] + h[at]))
        if rows.size:
            at = at[rows]
            s = (times[rows] - t[at]) / h[at]
            out[:, rows] = _between(old[:, at], new[:, at], [bend[:, at] for bend in bends], s)
        state[:, done] = new[:, good]
        position[done] = reached = before[good] + (1 << (_MAX_LEVEL - own[good]))
        # steps begin at multiples of themselves: the lowest bit that is set is the longest
        lowest = np.log2(reached & -reached).astype(np.int64)
        longest = np.maximum(_MIN_LEVEL, _MAX_LEVEL - lowest)
        level[done] = np.maximum(own[good] - _doublings(share[good]), longest)
        # an error that is left after the first time is not of fourth order: a jump
        worse = share[~good]
        level[which[~good]] += _halvings(worse, np.where(again[which[~good]], 1, 4))
        again[which] = ~good
        tried[which] += 1
        failed |= running & ((tried > max_steps) | (level > _MAX_LEVEL - 2))
        running &= ~failed & (start + span * (position / 2.0**_MAX_LEVEL) < latest)
    out[:, failed[member]] = np.nan
    return out, failed


def _doublings(share: FloatArray) -> NDArray[np.intp]:
    """Return how often a step may be doubled whose error of fourth order is a share of the limit.

    Half of the limit is left as it is.
    """
    often = np.floor((-np.log2(np.maximum(share, 2.0**-60)) - 1) / 4)
    return np.clip(often, 0, _MAX_DOUBLINGS).astype(np.intp)


def _halvings(share: FloatArray, order: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return how often a step must be halved whose error is more than the limit."""
    often = np.ceil(np.log2(np.minimum(share, 2.0**60)) / order)
    return np.clip(often, 1, _MAX_HALVINGS // order).astype(np.intp)


def _step(
    slope: Slope,
    t: FloatArray,
    h: FloatArray,
    state: FloatArray,
    which: NDArray[np.intp],
    sizes: FloatArray,
) -> tuple[FloatArray, FloatArray, list[FloatArray]]:
    """Return states (n_states, k) after a step, their errors, and how they bend between."""
    n, k = state.shape
    small = np.sqrt(np.finfo(float).eps)
    change = small * np.maximum(np.abs(state), 1e-3 * sizes[:, None])
    moved = np.repeat(state[:, None], n + 1, axis=1)
    moved[np.arange(n), np.arange(1, n + 1)] += change
    change = moved[np.arange(n), np.arange(1, n + 1)] - state
    slopes = slope(np.tile(t, n + 1), moved.reshape(n, -1), np.tile(which, n + 1))
    slopes = slopes.reshape(n, n + 1, k)
    first = slopes[:, 0]
    jacobian = ((slopes[:, 1:] - slopes[:, :1]) / change).transpose(2, 0, 1)
    later = t + small * h
    by_time = (slope(later, state, which) - first) / np.where(later > t, later - t, np.inf)
    try:
        inverse = np.linalg.inv(np.eye(n) / (_GAMMA * h)[:, None, None] - jacobian)
    except np.linalg.LinAlgError:
        return state, np.full_like(state, np.inf), []
    stages: list[FloatArray] = []
    for a, c, (at, part) in zip(_A, _C, _TIMES, strict=True):
        at_stage = state + _sum(a, stages) if a else state
        right = slope(t + at * h, at_stage, which) if a else first
        if c:
            right = right + _sum(c, stages) / h
        if part:
            right = right + h * part * by_time
        stages.append(np.matmul(inverse, right.T[:, :, None])[:, :, 0].T)
    return at_stage + stages[-1], stages[-1], [_sum(b, stages) for b in _DENSE_OUTPUT]


def _sum(factors: tuple[float, ...], stages: list[FloatArray]) -> FloatArray:
    total = factors[0] * stages[0]
    for factor, stage in zip(factors[1:], stages[1:], strict=False):
        total += factor * stage
    return total


def _between(
    old: FloatArray, new: FloatArray, bends: list[FloatArray], s: FloatArray
) -> FloatArray:
    """Return states at shares s of a step."""
    bend: FloatArray = bends[0] + s * bends[1]
    out: FloatArray = old * (1 - s) + s * (new + (1 - s) * bend)
    return out
