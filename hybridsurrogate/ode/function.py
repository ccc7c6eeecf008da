"""The function behind an OdeSimulator: columns by name in, outputs out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.numerics.linear_algebra import LARGE_BLOCK
from hybridsurrogate.ode.integration import (
    adaptive,
    equal_runs,
    hermite,
    past,
    runge_kutta,
    together,
)
from hybridsurrogate.ode.rosenbrock import rosenbrock
from hybridsurrogate.simulation.calls import WrongShapeError
from hybridsurrogate.simulation.modification import Active, Drive, Modification, drive_of, lags
from hybridsurrogate.simulation.outputs import by_output
from hybridsurrogate.types import FloatArray


def checked_array(values: Any, title: str, shape: tuple[int, ...], meaning: str) -> FloatArray:
    """Return what a function returned as an array; raise WrongShapeError where it does not fit."""
    try:
        array = np.asarray(values, dtype=float)
    except ValueError as error:
        raise WrongShapeError(
            f"{title} must return an array of shape {shape} ({meaning}); what it returned is no "
            f"array: {error}."
        ) from error
    if array.shape != shape:
        raise WrongShapeError(
            f"{title} must return an array of shape {shape} ({meaning}), got {array.shape}."
        )
    return array


StateColumns = Mapping[str, FloatArray]
# calls of a right-hand side that a step takes by methods of scipy
_CALLS_PER_STEP = 100
_NO_DRIVE = Drive({}, {})
# times at which a right-hand side is asked whether it takes several
_N_TIMES_TRIED = 9


@dataclass(frozen=True, eq=False)
class OdeFunction:
    """An ODE as a function of columns; the attributes are those of `OdeSimulator`.

    Attributes
    ----------
    rate_names, start_names, observe_names : tuple of str
        What rhs, initial_state and observe are passed.
    time : str
    start : float
        Time at which solutions start.
    step, max_step : float
        Of "rk4", and of the methods of scipy.
    outputs_seen : tuple of str
        What observe returns.
    span : float
        Length of the range of time.
    max_steps : int
        Of one solution, by any method but "rk4".
    sizes : tuple of float
        Of the states, for "rosenbrock".
    """

    rhs: Callable[..., Any]
    initial_state: Any
    observe: Callable[..., Any]
    states: tuple[str, ...]
    rate_names: tuple[str, ...]
    start_names: tuple[str, ...]
    observe_names: tuple[str, ...]
    time: str
    start: float
    step: float
    method: str
    max_step: float
    modifications: tuple[Modification, ...]
    outputs_seen: tuple[str, ...]
    span: float
    max_steps: int
    sizes: tuple[float, ...] = ()

    @property
    def __name__(self) -> str:
        return str(getattr(self.rhs, "__name__", type(self.rhs).__name__))

    def __call__(self, **columns: FloatArray) -> FloatArray:
        """Return the outputs, (n,) or (n, n_outputs)."""
        return self.outputs(columns)[0].T

    def outputs(self, columns: StateColumns) -> tuple[FloatArray, str | None]:
        """Return the outputs (n,), NaN where a solution failed, and the first error's words.

        Of several outputs (n_outputs, n).
        """

        def observed(solutions: _Solutions, columns: StateColumns, rows: slice) -> FloatArray:
            return self._observed(
                solutions.at_rows(rows), {name: columns[name][rows] for name in self.observe_names}
            )

        k = len(self.outputs_seen)
        return self._in_batches(columns, observed, (k,) if k > 1 else ())

    def _observed(self, states: FloatArray, given: StateColumns) -> FloatArray:
        """Return what observe makes of states (n_states, m): (m,), of several outputs (k, m)."""
        values = self.observe(states, **given)
        shape: tuple[int, ...] = (states.shape[1],)
        if len(self.outputs_seen) > 1:
            try:
                values = by_output(values, self.outputs_seen, "observe", axis=0).T
            except ValueError as error:
                raise WrongShapeError(str(error)) from error
            shape = len(self.outputs_seen), *shape
        return checked_array(values, "observe", shape, "a number for each solution")

    def solution(self, columns: StateColumns) -> FloatArray:
        """Return the states (n_states, n), NaN where a solution failed."""

        def states(solutions: _Solutions, columns: StateColumns, rows: slice) -> FloatArray:
            return solutions.at_rows(rows)

        return self._in_batches(columns, states, (len(self.states),))[0]

    def check(self, columns: StateColumns) -> None:
        """Try the functions out, and raise what is wrong with them."""
        solutions = self._solutions(columns)
        state = solutions.initial()
        # solutions that differ only in name: rhs is asked for two at once
        solutions.slope(self.start, state)
        with np.errstate(all="ignore"):
            seen = state[: len(self.states)]
            self._observed(seen, {name: columns[name] for name in self.observe_names})

    # ------------------------------------------------------------------------------ batches

    def _in_batches(
        self,
        columns: StateColumns,
        take: Callable[[_Solutions, StateColumns, slice], FloatArray],
        shape: tuple[int, ...],
    ) -> tuple[FloatArray, str | None]:
        times = columns[self.time]
        self._check_times(times)
        # rows that differ only in how they are observed are of one solution
        solved = {*self.rate_names, *self.start_names}
        solved.update(change.full(name) for change in self.modifications for name in change.neutral)
        keys = [values for name, values in columns.items() if name in solved - {self.time}]
        first, member = equal_runs(keys, len(times))
        out = np.full((*shape, len(times)), np.nan)
        if not len(times):
            return out, None
        order = together(keys, first, member)
        if order is not None:
            sorted_columns = {name: values[order] for name, values in columns.items()}
            out[..., order], error = self._in_batches(sorted_columns, take, shape)
            return out, error
        solutions = self._solutions(columns, first, member)
        ends = np.append(first, len(times))
        pending = list(reversed(solutions.batches(LARGE_BLOCK)))
        error = None
        while pending:
            low, high = pending.pop()
            rows = slice(ends[low], ends[high])
            try:
                with np.errstate(all="ignore"):
                    values = take(solutions.some(slice(low, high), low), columns, rows)
                out[..., rows] = np.where(np.isfinite(values), values, np.nan)
            except WrongShapeError:
                raise
            except Exception as failure:
                # a solution may fail in any way, and takes its batch with it: halve until alone
                error = error or f"{type(failure).__name__}: {failure}"
                middle = (low + high) // 2
                if high - low > 1:
                    pending += [(middle, high), (low, middle)]
        return out, error or next(iter(solutions.said), None)

    def _check_times(self, times: FloatArray) -> None:
        early = np.flatnonzero(times < self.start - 1e-9 * max(abs(self.start), self.step))
        if early.size:
            raise ValueError(
                f"{early.size} of {times.size} rows have {self.time!r} before the start of the "
                f"simulation at {self.start:g} (first at row {early[0]}: {times[early[0]]:g}). "
                "The solution starts at the low end of the range of the first input."
            )

    def _solutions(
        self,
        columns: StateColumns,
        first: NDArray[np.intp] | None = None,
        member: NDArray[np.intp] | None = None,
    ) -> _Solutions:
        n = len(columns[self.time])
        first = np.arange(n) if first is None else first
        member = first if member is None else member
        names = {*self.rate_names, *self.start_names, *self.observe_names}
        used = {name: columns[name][first] for name in names}
        active = []
        for change in self.modifications:
            numbers = {
                name: columns[change.full(name)][first]
                for name in change.neutral
                if change.full(name) in columns
            }
            moved = (np.any(numbers[s] != change.neutral[s]) for s in change.sizes if s in numbers)
            if any(moved):
                neutral = {name: np.full(len(first), v) for name, v in change.neutral.items()}
                active.append((change, neutral | numbers))
        times = np.maximum(columns[self.time], self.start)
        return _Solutions(self, used, active, times, member, 0)


@dataclass(frozen=True)
class _Moving:
    """A term that acts on unseen states: its parameter, and the value of that without the term.

    Solutions that are idle (m,) keep the term. Stores are positions of unseen states, and rows of
    the states that they couple to.
    """

    name: str
    without: float
    idle: NDArray[np.bool_]
    stores: list[tuple[int, int]]
    given: dict[str, FloatArray]

    @cached_property
    def plain(self) -> dict[str, FloatArray]:
        """The parameters three times where nothing drives them: they are the same at all times."""
        return self.thrice(self.given)

    def thrice(self, given: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Return parameters (m,) three times, (3 m,): without the term, with and without it."""
        gone = np.where(self.idle, given[self.name], self.without)
        each = {name: np.concatenate([values] * 3) for name, values in given.items()}
        return each | {self.name: np.concatenate([gone, given[self.name], gone])}


@dataclass(frozen=True)
class _Solutions:
    """Solutions with their parameters (m,), and the rows (n,) that read values off them."""

    ode: OdeFunction
    values: dict[str, FloatArray]
    active: Active
    times: FloatArray
    member: NDArray[np.intp]
    first: int
    # why some of them failed
    said: list[str] = field(default_factory=list)

    def some(self, which: slice | NDArray[np.intp], first: int = 0) -> _Solutions:
        """Return solutions by number, a number perhaps several times; the first of them."""

        def taken(columns: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
            return {name: column[which] for name, column in columns.items()}

        active = [(change, taken(numbers)) for change, numbers in self.active]
        return replace(self, values=taken(self.values), active=active, first=first)

    def __len__(self) -> int:
        return len(next(iter(self.values.values()))) if self.values else int(self.member[-1]) + 1

    def batches(self, block: int) -> list[tuple[int, int]]:
        """Cut the solutions so that the states of one piece stay small."""
        n = len(self.ode.states)
        if self.ode.method == "rosenbrock":
            width = 8 * n * (n + 2)
        elif self.ode.method == "rk4":
            width = (self._n_steps(self.times) + 1) * 2 * (n + len(self.active))
        else:
            width = block
        length = max(1, block // width)
        return [(k, min(k + length, len(self))) for k in range(0, len(self), length)]

    def _n_steps(self, times: FloatArray) -> int:
        latest = np.max(times, where=np.isfinite(times), initial=self.ode.start)
        return max(1, int(np.ceil((latest - self.ode.start) / self.ode.step - 1e-9)))

    def initial(self) -> FloatArray:
        """Return the initial state, (n_states, m), that of unseen states last."""
        state = self._seen_at_start()
        rows = [change.begins(state[row], numbers) for change, numbers, row in self._coupled]
        return np.vstack([state, *rows]) if rows else state

    @cached_property
    def _coupled(self) -> list[tuple[Modification, dict[str, FloatArray], int]]:
        """Changes with an unseen state, their numbers, and the row of the state it couples to."""
        return [
            (change, numbers, self.ode.states.index(change.couples_to))
            for change, numbers in self.active
            if change.couples_to is not None
        ]

    def _seen_at_start(self) -> FloatArray:
        ode, m = self.ode, len(self)
        value = ode.initial_state
        if callable(value):
            value = value(**{name: self.values[name] for name in ode.start_names})
        if isinstance(value, Mapping):
            if set(value) != set(ode.states):
                raise WrongShapeError(
                    f"initial_state has {sorted(value)}, the states are {list(ode.states)}."
                )
            value = [value[name] for name in ode.states]
        shape = (len(ode.states), m)
        if len(value) == len(ode.states) and all(np.shape(v) in ((), (m,)) for v in value):
            return np.stack([np.broadcast_to(np.asarray(v, dtype=float), m) for v in value])
        return checked_array(value, "initial_state", shape, "states by solutions")

    def slope(
        self,
        t: float | FloatArray,
        state: FloatArray,
        drive: Drive | None = None,
        late: Mapping[str, FloatArray] | None = None,
    ) -> FloatArray:
        """Return the right-hand side for all solutions, what drives it at t given or not.

        ``late`` are states that it sees instead of those at t. Unseen states come last.
        """
        ode, given, coupled, whole = self.ode, self._given, self._coupled, state
        if coupled:
            state = state[: len(ode.states)]
        seen = state
        if drive is None:
            drive = drive_of(self.active, np.array([t]), ode.step).at(0)
        if drive.factors:
            given = given | {name: given[name] * f for name, f in drive.factors.items()}
        if late:
            seen = state.copy()
            for name, values in late.items():
                seen[ode.states.index(name)] = values
        slopes = checked_array(ode.rhs(t, seen, **given), "rhs", state.shape, "states by solutions")
        plain = slopes
        if drive.added or self._adding or coupled:
            slopes = slopes.copy()
            for name, term in drive.added.items():
                slopes[ode.states.index(name)] += term
            named = dict(zip(ode.states, state, strict=True))
            for change, numbers in self._adding:
                for name, term in change.terms(named, numbers).items():
                    slopes[ode.states.index(name)] += term
        if not coupled:
            return slopes
        unseen, own = whole[len(ode.states) :], [slopes]
        acting = self._moved(t, seen, unseen, given, plain, slopes)
        for (change, numbers, row), other, acts in zip(coupled, unseen, acting, strict=True):
            added, slope = change.exchange(state[row], other, numbers, acts)
            slopes[row] += added
            own.append(slope[None])
        return np.concatenate(own)

    def _moved(
        self,
        t: float | FloatArray,
        state: FloatArray,
        unseen: FloatArray,
        given: Mapping[str, FloatArray],
        plain: FloatArray,
        slopes: FloatArray,
    ) -> list[FloatArray | float]:
        """Return the terms that act on unseen states, of each, and move them from the slopes.

        A term is what is gone from the right-hand side, ``plain``, where its parameter is.
        """
        m = state.shape[1]
        terms: list[FloatArray | float] = [0.0] * len(unseen)
        for moving in self._moving:
            there = state.copy()
            for k, row in moving.stores:
                there[row] = unseen[k]
            # in one call: without it at the state, with and without it at the store
            each = moving.plain if given is moving.given else moving.thrice(given)
            states = np.concatenate([state, there, there], axis=1)
            values = np.asarray(self.ode.rhs(t, states, **each))
            rest, added = values[:, :m], values[:, m : 2 * m] - values[:, 2 * m :]
            for k, row in moving.stores:
                terms[k] = added[row].copy()
                added[row] = 0.0
            slopes += added - (plain - rest)
        return terms

    @cached_property
    def _moving(self) -> list[_Moving]:
        taken = [change.takes_over for change, *_ in self._coupled]
        out = []
        for name, without in dict.fromkeys(filter(None, taken)):
            stores = [k for k, one in enumerate(taken) if one == (name, without)]
            idle = np.ones(len(self), dtype=bool)
            for change, numbers, _ in (self._coupled[k] for k in stores):
                for size in change.sizes:
                    idle &= numbers[size] == change.neutral[size]
            rows = [(k, self._coupled[k][2]) for k in stores]
            out.append(_Moving(name, without, idle, rows, self._given))
        return out

    @cached_property
    def _given(self) -> dict[str, FloatArray]:
        return {name: self.values[name] for name in self.ode.rate_names}

    @cached_property
    def _adding(self) -> Active:
        return [a for a in self.active if type(a[0]).terms is not Modification.terms]

    @cached_property
    def _lags(self) -> dict[str, FloatArray]:
        return lags(self.active)

    def _late(
        self, k: int, state: FloatArray, states: FloatArray, slopes: FloatArray, known: int
    ) -> dict[str, FloatArray]:
        """Return the states that the right-hand side sees late, k half steps after the start."""
        late = {}
        for name, lag in self._lags.items():
            row, position = self.ode.states.index(name), k / 2 - lag / self.ode.step
            if known:
                before = states[:known, row], slopes[:known, row]
                late[name] = past(*before, self.ode.step, position, state[row], k / 2)
            else:
                late[name] = np.where(position <= 0, state[row], np.nan)
        return late

    def at_rows(self, rows: slice) -> FloatArray:
        """Return the states (n_states, n) at the rows of these solutions, without unseen ones."""
        return self._all_at_rows(rows)[: len(self.ode.states)]

    def _all_at_rows(self, rows: slice) -> FloatArray:
        ode, times, member = self.ode, self.times[rows], self.member[rows] - self.first
        if ode.method == "rosenbrock":
            return self._rosenbrock(times, member)
        if ode.method != "rk4":
            start, asked = self.initial(), count(1)

            def slope(t: float, state: FloatArray) -> FloatArray:
                if next(asked) > _CALLS_PER_STEP * ode.max_steps:
                    raise RuntimeError(self._too_many)
                return self.slope(t, state[:, None])[:, 0]

            return adaptive(slope, start[:, 0], times, ode.start, ode.method, ode.max_step)
        n_steps = self._n_steps(times)
        clock = ode.start + ode.step / 2 * np.arange(2 * n_steps + 1)
        # all at once: exponentials are the dearer part of a changing parameter
        table = drive_of(self.active, clock, ode.step)
        ticks = clock.tolist()

        driven = bool(table.factors or table.added)

        def slope_at(
            k: int, state: FloatArray, states: FloatArray, slopes: FloatArray, known: int
        ) -> FloatArray:
            late = self._late(k, state, states, slopes, known) if self._lags else None
            return self.slope(ticks[k], state, table.at(k) if driven else table, late)

        states, slopes = runge_kutta(slope_at, self.initial(), n_steps, ode.step)
        return hermite(states, slopes, ode.step, (times - ode.start) / ode.step, member)

    def _takes_times(self) -> bool:
        """Whether the right-hand side gives for times (k,) what it gives for each of them."""
        several = np.linspace(self.ode.start, self.ode.start + self.ode.span, _N_TIMES_TRIED)
        which = np.arange(_N_TIMES_TRIED) % len(self)
        state, some = self.initial()[:, which], self.some(which)
        try:
            at_once = some.slope(several, state, _NO_DRIVE)
            each = [some.slope(t, state, _NO_DRIVE)[:, k] for k, t in enumerate(several.tolist())]
        except Exception:
            # a function of one time may fail in any way
            return False
        # array kernels round otherwise
        return np.allclose(at_once, np.stack(each, axis=1), rtol=1e-10, atol=0, equal_nan=True)

    @property
    def _too_many(self) -> str:
        return f"a solution by {self.ode.method!r} took more than max_steps={self.ode.max_steps}"

    def _rosenbrock(self, times: FloatArray, member: NDArray[np.intp]) -> FloatArray:
        ode = self.ode
        sizes = np.array([*ode.sizes, *(ode.sizes[row] for _, _, row in self._coupled)])
        together = not self.active and self._takes_times()

        def slope(t: FloatArray, state: FloatArray, which: NDArray[np.intp]) -> FloatArray:
            time = t if together else float(t[0])
            return self.some(which).slope(time, state, None if self.active else _NO_DRIVE)

        start = self.initial()
        states, stopped = rosenbrock(
            slope, start, times, member, ode.start, ode.span, sizes, ode.max_steps, not together
        )
        if stopped.any():
            self.said.append(self._too_many)
        return states
