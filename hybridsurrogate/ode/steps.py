"""What solutions that are tried show: the longest step, a stiff equation, the terms of slopes."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.exceptions import SolverWarning
from hybridsurrogate.numerics.linear_algebra import SINGULAR
from hybridsurrogate.ode.function import OdeFunction, StateColumns
from hybridsurrogate.ode.integration import extent
from hybridsurrogate.types import FloatArray

# steps over the range of time: from 400 instead of 100 on diagnoses take 2.3 times as long, and
# evidences are the same to 0.01 nats (eight blind cases of three equations)
MIN_STEPS, _MOST = 100, 6400
# steps from which those of a method for stiff equations, about as many times dearer, are tried
_STIFF_FROM = 1600
# in which the sizes of states settle
_N_SIZE_ROUNDS = 4
# errors of a state in shares of its extent. Where a right-hand side jumps, errors are of
# first order in the step, and small ones are not to be had
_SMOOTH_ERROR, _JUMP_ERROR, _DOUBTFUL_ERROR = 1e-4, 3e-3, 1e-2
# of the method: half a step leaves a sixteenth of the error (Hairer, Norsett and Wanner 1993,
# section II.4), or so. Of a lower order, as across a jump: half of it or more
_ORDER = 4


def chosen(function: OdeFunction, columns: StateColumns, span: float) -> OdeFunction:
    """Return the function with a step, or with the method for stiff equations where none will do.

    Parameters
    ----------
    columns, span
        As in `with_step`.

    Warns
    -----
    SolverWarning
        As in `with_step`, and where a part of the solutions fails.
    """
    found = _ladder(function, columns, span, _STIFF_FROM)
    if found.good and found.known.all():
        return replace(function, step=span / found.n_steps)
    stiff = replace(function, method="rosenbrock", max_steps=min(_STIFF_FROM, function.max_steps))
    stiff = sized(stiff, columns)
    known = _known(_solved(stiff, columns)) if stiff.sizes else np.zeros(1, dtype=bool)
    if not known[0]:
        return with_step(function, columns, span)
    if found.good and known.sum() <= found.known.sum():
        return replace(function, step=span / found.n_steps)
    lost = ~known
    if lost.any():
        warnings.warn(
            f"Of {len(lost)} solutions from the priors {int(lost.sum())} were not finished in "
            f"{stiff.max_steps} steps: parameters like theirs count as impossible. Narrow the "
            "priors, or give more max_steps.",
            SolverWarning,
            stacklevel=4,
        )
    return replace(stiff, max_steps=function.max_steps)


def sized(function: OdeFunction, columns: StateColumns) -> OdeFunction:
    """Return a function of the method "rosenbrock" with the sizes of its states.

    Sizes are how far states go at the medians of the priors; none where that solution fails.
    """
    n_times = _shape(function, columns)[1]
    first = {name: values[:n_times] for name, values in columns.items()}
    start = np.abs(function.solution({name: values[:1] for name, values in first.items()})[:, 0])
    size = np.full(len(start), np.max(start, initial=0.0) or 1.0)
    for _ in range(_N_SIZE_ROUNDS):
        fine = _solved(replace(function, sizes=tuple(map(float, size))), first)[:, 0]
        if not np.isfinite(fine).all():
            return replace(function, sizes=())
        before, size = size, _sizes_of(fine)
        if np.all(np.abs(np.log10(size / before)) < 1):
            break
    return replace(function, sizes=tuple(map(float, size)))


def with_step(function: OdeFunction, columns: StateColumns, span: float) -> OdeFunction:
    """Return the function with the longest step that solutions allow.

    Parameters
    ----------
    columns : dict of name to ndarray of shape (n_solutions * n_times,)
        Solutions to try, the typical one first, each at the same times.
    span : float
        Length of the range of time.

    Warns
    -----
    SolverWarning
        Where the shortest step is too long.
    """
    found = _ladder(function, columns, span, _MOST)
    if found.known[0]:
        _warn(found.error, span / found.n_steps, "The shortest step that is tried")
    else:
        warnings.warn(
            "The solution at the medians of the priors is not finite, even with steps of "
            f'{span / _MOST:g}. If it should be, the equation is stiff: take method="rosenbrock" '
            'or "LSODA", which choose their own steps.',
            SolverWarning,
            stacklevel=3,
        )
    return replace(function, step=span / found.n_steps)


class _Found(NamedTuple):
    """A number of steps, the error that it leaves, and which solutions are known."""

    n_steps: int
    error: float
    good: bool
    known: NDArray[np.bool_]


def _ladder(function: OdeFunction, columns: StateColumns, span: float, most: int) -> _Found:
    """Return the fewest steps with small errors, up to the most."""

    def solved(n_steps: int) -> FloatArray:
        return _solved(replace(function, step=span / n_steps), columns)

    n_steps, before = MIN_STEPS, np.inf
    coarse, fine = solved(n_steps // 2), solved(n_steps)
    # a solution that fails may need shorter steps, or break down whatever the step
    known = _known(fine)
    if not known.all():
        known = _known(solved(most))
    while True:
        change = _change(coarse, fine, known)
        smooth = change * 2 ** (_ORDER - 1) < before
        error = change / (2**_ORDER - 1) if smooth else change
        good = error < (_SMOOTH_ERROR if smooth else _JUMP_ERROR)
        if good or n_steps >= most:
            return _Found(n_steps, error, good, known)
        n_steps, before, coarse = 2 * n_steps, change, fine
        fine = solved(n_steps)


def _solved(function: OdeFunction, columns: StateColumns) -> FloatArray:
    """Return solutions (n_states, n_solutions, n_times)."""
    out = function.solution(columns)
    return out.reshape(len(out), *_shape(function, columns))


def warn_if_too_long(function: OdeFunction, columns: StateColumns) -> None:
    """Warn where solutions, as in `with_step`, change when the step is halved."""
    coarse, fine = (
        _solved(f, columns) for f in (function, replace(function, step=function.step / 2))
    )
    _warn(_change(coarse, fine, _known(fine)), function.step, "max_step")


def _shape(function: OdeFunction, columns: StateColumns) -> tuple[int, int]:
    """Return the numbers of solutions and of times."""
    times = columns[function.time]
    n_solutions = int(np.sum(times == times[0]))
    return n_solutions, len(times) // n_solutions


# times at which terms are looked for, and the share of a slope's size that is rounding
_N_TIMES_OF_TERMS, _ROUNDING = 8, 1e-6
# a state that is smaller by such a share stays where the equation holds
_SMALLER = 0.1


def separate_terms(
    function: OdeFunction, columns: StateColumns, names: Sequence[str]
) -> dict[str, dict[str, bool]]:
    """Return of each state the parameters of single terms of its slope that fall as it grows.

    Such a term, as a loss, draws the state to where it comes to rest, and so it can draw a store.
    The parameter p multiplies the term or divides it: the right-hand side f is linear in p, or in
    1 / p, and f(p = 0), or f(p = infinity), is what it is without the term. Of the parameters of
    one term the first counts.

    Parameters
    ----------
    columns : dict of name to ndarray of shape (n_solutions * n_times,)
        As in `with_step`.
    names : sequence of str
        Parameters of the right-hand side.

    Returns
    -------
    dict of state to dict of parameter to bool
        Whether it divides the term.
    """
    found: dict[str, dict[str, bool]] = {state: {} for state in function.states}
    solved, terms = _solved(function, columns), list[FloatArray]()
    for name in names:
        with np.errstate(all="ignore"):
            divides, slopes, term = _term(
                *(_slopes(function, columns, solved, name, k) for k in (0.0, 1.0, 2.0, np.inf))
            )
        size = _size(slopes)
        if any(np.all(np.abs(term - other) <= size[..., None]) for other in terms):
            continue
        terms.append(term)
        size = size[:, 0]
        change = np.einsum("iij->ij", term[:, 1:] - term[:, :1])
        falls = (change.max(axis=-1) > size) & (change.min(axis=-1) >= -size)
        is_part = np.abs(slopes - term)[:, 0].max(axis=-1) > size
        for k in np.flatnonzero(falls & is_part):
            found[function.states[k]][name] = divides
    return found


def _term(
    none: FloatArray, one: FloatArray, two: FloatArray, far: FloatArray
) -> tuple[bool, FloatArray, FloatArray]:
    """Return whether a parameter divides its term, slopes, and that term in them: zero if none is.

    Slopes are those without the parameter, with it, and with twice and infinitely much of it.
    """
    known = np.isfinite([one, two]).all(axis=(0, 1, 2))
    none, one, two, far = (np.where(known, slopes, 0.0) for slopes in (none, one, two, far))
    for divides, rest, same in ((False, none, two - one), (True, far, 2 * (one - two))):
        if np.all(np.abs(one - rest - same) <= _size(one)[..., None]):
            return divides, one, one - rest
    return False, one, np.zeros_like(one)


def _size(slopes: FloatArray) -> FloatArray:
    """Return how much of the slopes of each state is rounding, (n_states, 1)."""
    return _ROUNDING * np.abs(slopes).max(axis=(1, 2), initial=0.0)[:, None]


def _slopes(
    function: OdeFunction, columns: StateColumns, solved: FloatArray, name: str, factor: float
) -> FloatArray:
    """Return slopes with a factor on a parameter, NaN where the right-hand side fails.

    Parameters
    ----------
    solved : ndarray of shape (n_states, n_solutions, n_times)

    Returns
    -------
    ndarray of shape (n_states, 1 + n_states, n)
        At these states, and with each of them smaller.
    """
    n, m, n_times = solved.shape
    each = {key: values.reshape(m, n_times) for key, values in columns.items()}
    smaller = _SMALLER * np.eye(n, n + 1, 1)[..., None]
    out = []
    for k in range(0, n_times, max(1, n_times // _N_TIMES_OF_TERMS)):
        given = {one: np.tile(each[one][:, k], n + 1) for one in function.rate_names}
        given[name] = given[name] * factor
        state = solved[:, None, :, k]
        state = (state - smaller * np.abs(state)).reshape(n, -1)
        try:
            slopes = np.asarray(function.rhs(float(each[function.time][0, k]), state, **given))
        except Exception:
            # it may refuse such a value in any way
            slopes = np.full(state.shape, np.nan)
        out.append(slopes.reshape(n, n + 1, m))
    return np.concatenate(out, axis=-1)


def _known(solutions: FloatArray) -> NDArray[np.bool_]:
    """Return which solutions (n_states, n_solutions, n_times) are finite."""
    return np.asarray(np.isfinite(solutions).all(axis=(0, 2)))


def _sizes_of(solutions: FloatArray) -> FloatArray:
    """Return the extent of states (..., n) over n times, (...), of none less than rounding."""
    size = extent(solutions)
    return np.maximum(size, max(SINGULAR * float(np.max(size)), np.finfo(float).tiny))


def _change(coarse: FloatArray, fine: FloatArray, known: NDArray[np.bool_]) -> float:
    """Return the largest difference of known solutions, in shares of each state's extent."""
    coarse, fine = coarse[:, known], fine[:, known]
    if not fine.size:
        return 0.0
    with np.errstate(all="ignore"):
        change = np.abs(coarse - fine) / _sizes_of(fine)[..., None]
    return float(np.max(np.where(np.isfinite(change), change, np.inf)))


def _warn(error: float, step: float, which: str) -> None:
    if not error > _DOUBTFUL_ERROR:
        return
    how_much = f"{100 * error:.0f} % of its size" if error < 1 else "more than its size"
    warnings.warn(
        f"{which}, {step:g}, is too long for the right-hand side: a state is off by about "
        f"{how_much}. What a diagnosis finds may be this error. Use a shorter max_step, or "
        'method="rosenbrock" or "LSODA", which choose their own steps.',
        SolverWarning,
        stacklevel=4,
    )
