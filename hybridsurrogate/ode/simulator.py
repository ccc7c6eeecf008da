"""The simulation as an ordinary differential equation, whose dynamics may be at fault."""

from __future__ import annotations

import inspect
import numbers
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from hybridsurrogate.arguments import (
    accepted_names,
    as_names,
    as_real,
    check_callable,
    check_choice,
    check_number,
    described,
)
from hybridsurrogate.ode.function import OdeFunction
from hybridsurrogate.ode.steps import chosen, separate_terms, sized, warn_if_too_long, with_step
from hybridsurrogate.simulation.arrays import as_numbers, as_table
from hybridsurrogate.simulation.evaluation import Running
from hybridsurrogate.simulation.modification import Modification
from hybridsurrogate.simulation.outputs import OUTPUT, by_output, output_names
from hybridsurrogate.simulation.simulator import Simulator
from hybridsurrogate.simulation.variables import Assumed, Range, check_ranges, named_fields
from hybridsurrogate.types import FloatArray, Prior

# solutions that are tried for the length of a step, and times: with half of both one of ten
# equations is off by 0.003 of its size instead of 1e-6
_TRIED, _N_TIMES = 8, 64
_CALLED = {"rhs": "(t, state, rate)", "observe": "(state)"}
_METHODS = ("auto", "rk4", "rosenbrock", "RK45", "RK23", "DOP853", "Radau", "BDF", "LSODA")

Start = Callable[..., Any] | Sequence[Any] | Mapping[str, Any]


@dataclass(frozen=True, init=False, repr=False, eq=False)
class OdeSimulator(Simulator):
    """A simulation that solves an ordinary differential equation.

    A `Simulator` whose right-hand side is known, so that causes inside the dynamics
    (`DynamicDrift`, `DynamicTerm`, `DynamicDelay`) can be compared with those outside.

    Parameters
    ----------
    rhs : callable
        ``rhs(t, state, **parameters) -> (n_states, m)``, the slopes of m solutions at once: t is
        a number, state (n_states, m), parameters (m,) each.
    initial_state : callable, sequence or dict of state to number
        ``initial_state(**parameters)``, or what it returns: for every state a number or (m,).
    observe : callable
        ``observe(state, **parameters) -> (m,)``, the output; of several a dict or tuple of these,
        or an array of shape (n_outputs, m).
    inputs : dict of name to (low, high)
        The first is time, and the solution starts where its range does. Others are constant while
        a solution runs, and are passed on like parameters.
    parameters : dict of name to scipy.stats frozen distribution, optional
    assumed : dict of name to Assumed, optional
    states : tuple of str
        Names of the states, in their order.
    output : str or sequence of str
    method : str, default="auto"
        "rk4": Runge-Kutta of fourth order with a fixed step, for all solutions at once.
        "rosenbrock": RODAS (Hairer and Wanner 1996, section IV.7), for stiff equations, for all
        solutions at once, each with adaptive steps. "auto": the first, or the second where 1,600
        steps are not enough for the first; the attribute is the one that was chosen. Or a method of
        `scipy.integrate.solve_ivp`, such as "LSODA" or "Radau", one solution after another.
    max_step : float, optional
        The step of "rk4", by default the longest that leaves solutions as they are when it is
        halved, from 1/100 to 1/6400 of the range of time; the largest step of scipy's methods,
        which have no limit by default. With "auto" it is that of "rk4".
    max_steps : int, default=1000
        Of one solution, by any method but "rk4"; of scipy's methods a hundred times as many calls
        of rhs. A solution that takes more counts as failed.
    sizes : sequence of float, optional
        Of the states, for "rosenbrock": smaller values need not be exact in shares of themselves.
        By default how far states go at the medians of the priors.
    modifications : sequence of Modification
        Changes of the right-hand side, see `modified`.

    Attributes
    ----------
    modifiers : dict of name to float
        Numbers of the modifications that are no parameters, at values that change nothing. In a
        call they may follow the assumed constants as columns of omega.
    rates : tuple of str
        Those parameters and assumed constants that the right-hand side takes.
    starts : tuple of str
        Those parameters that the initial state takes, and neither rhs nor observe.
    terms : dict of str to dict of str to bool
        Of each state those rates that multiply or divide one of several terms of its slope which
        falls as the state grows, as a loss does; and whether they divide it.

    Notes
    -----
    Each function is passed those inputs, parameters and assumed constants that it names, or all of
    them where it takes ``**parameters``. They are tried out when the simulator is made, at the
    medians of the priors. Later on a solution that is not finite or raises an exception is NaN.

    Rows that follow each other with equal parameters share one solution; between its steps states
    are interpolated by cubics. ``n_jobs`` has no effect.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> def epidemic(t, state, contact, recovery):
    ...     new = contact * state[0] * state[1]
    ...     return np.stack([-new, new - recovery * state[1]])
    >>> simulator = hs.OdeSimulator(
    ...     epidemic, initial_state={"s": 0.99, "i": 0.01}, observe=lambda state: state[1],
    ...     inputs={"t": (0, 30)}, states=("s", "i"),
    ...     parameters={"contact": hs.truncated_normal(0.6, 0.2, 0.1, 2)},
    ...     assumed={"recovery": hs.Assumed(0.2, hs.truncated_normal(0.2, 0.1, 0.05, 0.5))},
    ... )
    >>> simulator([0.0, 10.0, 20.0], np.full((3, 1), 0.6)).round(3)
    array([0.01 , 0.24 , 0.178])
    """

    function: OdeFunction
    rhs: Callable[..., Any]
    initial_state: Start
    observe: Callable[..., Any]
    states: tuple[str, ...]
    method: str
    max_step: float | None
    max_steps: int
    modifications: tuple[Modification, ...]
    modifiers: dict[str, float]
    rates: tuple[str, ...]
    starts: tuple[str, ...]

    is_in_time = True

    def __init__(
        self,
        rhs: Callable[..., Any],
        initial_state: Start,
        observe: Callable[..., Any],
        inputs: Mapping[str, Range],
        parameters: Mapping[str, Prior] | None = None,
        assumed: Mapping[str, Assumed] | None = None,
        states: Sequence[str] = (),
        output: str | Sequence[str] = "y",
        method: str = "auto",
        max_step: float | None = None,
        modifications: Sequence[Modification] = (),
        max_steps: int = 1000,
        sizes: Sequence[float] = (),
    ) -> None:
        states = as_names(states, "states", '("s", "i")')
        if not states or len(set(states)) < len(states):
            raise ValueError(f"states must be the different names of the states, got {states!r}.")
        check_choice(method, "method", _METHODS)
        if max_step is not None and not as_real(max_step, "max_step") > 0:
            raise ValueError(f"max_step must be positive, got {max_step!r}.")
        for name, function in {"rhs": rhs, "observe": observe}.items():
            check_callable(function, name, "def " + name + _CALLED[name])
        if len(sizes) and not (len(sizes) == len(states) and min(sizes) > 0):
            raise ValueError(f"sizes must be a positive number for each state, got {sizes!r}.")
        check_number(max_steps, "max_steps", numbers.Integral, min_val=1)
        wanted, method = method, "rk4" if method == "auto" else method
        ranges = check_ranges(inputs)
        unknown = named_fields(tuple(ranges), parameters, assumed)
        time, *others = ranges
        start, stop = ranges[time]
        changing = _numbers(modifications)
        names = (*others, *unknown["parameters"], *unknown["assumed"])
        names = tuple(name for name in names if name not in changing)
        rates = accepted_names(rhs, "rhs", names, 2)
        first = accepted_names(initial_state, "initial_state", names)
        seen = accepted_names(observe, "observe", names, 1)
        for change in modifications:
            change.check(rates, states)
            if change.looks_back and method != "rk4":
                raise ValueError(
                    f'{type(change).__name__} needs method="rk4", which stores earlier states; '
                    f"the simulator has {method!r}."
                )
        function = OdeFunction(
            rhs,
            initial_state,
            observe,
            states,
            rates,
            first,
            seen,
            time,
            start,
            stop - start if max_step is None else max_step,
            method,
            np.inf if max_step is None else max_step,
            tuple(modifications),
            output_names(output),
            stop - start,
            int(max_steps),
            tuple(map(float, sizes)),
        )
        unused = [name for name in names if name not in {*rates, *first, *seen}]
        if unused:
            raise TypeError(
                f"{', '.join(unused)}: neither rhs nor initial_state nor observe has an argument "
                "of that name."
            )
        super().__init__(function, ranges, parameters, assumed, output)
        own = {
            "rhs": rhs,
            "initial_state": initial_state,
            "observe": observe,
            "states": states,
            "method": method,
            "max_step": max_step,
            "max_steps": int(max_steps),
            "modifications": tuple(modifications),
            "modifiers": {k: v for k, v in changing.items() if k not in self.parameter_ranges},
            "rates": tuple(name for name in rates if name in self.parameter_ranges),
            "starts": tuple(n for n in first if n in self.parameters and n not in {*rates, *seen}),
        }
        self.__dict__.update(own)
        function.check(self._medians(2))
        if wanted == "auto" and max_step is None:
            function = chosen(function, self._typical(), stop - start)
        elif method == "rk4" and max_step is None:
            function = with_step(function, self._typical(), stop - start)
        elif method == "rosenbrock" and not len(sizes):
            function = sized(function, self._typical())
        elif method == "rk4" and not modifications:
            warn_if_too_long(function, self._typical())
        self.__dict__.update(function=function, method=function.method)

    def modified(
        self,
        modifications: Sequence[Modification],
        parameters: Mapping[str, Prior] | None = None,
    ) -> OdeSimulator:
        """Return the simulator with a changed right-hand side.

        Parameters
        ----------
        modifications : sequence of Modification
            Their numbers become columns of omega after the assumed constants, by full name; where
            these are left out they take values that change nothing.
        parameters : dict of name to scipy.stats frozen distribution, optional
            Priors of those numbers that are to be unknown parameters instead.

        Examples
        --------
        >>> import hybridsurrogate as hs
        >>> from hybridsurrogate.ode.dynamics import TimeVaryingParameter
        >>> decay = hs.OdeSimulator(
        ...     lambda t, state, rate: -rate * state, initial_state=[1.0],
        ...     observe=lambda state: state[0], inputs={"t": (0, 4)}, states="n",
        ...     parameters={"rate": hs.truncated_normal(1, 0.2, 0, 2)})
        >>> stops = decay.modified([TimeVaryingParameter("rate", "step")])
        >>> stops.modifiers
        {'rate_step_amount': 0.0, 'rate_step_location': 0.0}
        >>> stops([1.0, 4.0], [[1.0, -1.0, 2.0], [1.0, -1.0, 2.0]]).round(3)
        array([0.368, 0.135])
        """
        return self._like(
            parameters={**self.parameters, **(parameters or {})},
            modifications=(*self.modifications, *modifications),
        )

    def _like(self, **changes: Any) -> OdeSimulator:
        """Return a simulator with the settings of this one but for some."""
        settings: dict[str, Any] = {
            "rhs": self.rhs,
            "initial_state": self.initial_state,
            "observe": self.observe,
            "inputs": self.input_ranges,
            "parameters": self.parameters,
            "assumed": self.assumed,
            "states": self.states,
            "output": self.outputs,
            "method": self.method,
            "max_step": self.function.step if self.method == "rk4" else self.max_step,
            "modifications": self.modifications,
            "max_steps": self.max_steps,
            "sizes": self.function.sizes,
        }
        return OdeSimulator(**settings | changes)

    def single_output(self, scale: FloatArray) -> OdeSimulator:
        """Return the simulation with one output a row, `OUTPUT` its last input.

        Parameters
        ----------
        scale : ndarray of shape (n_outputs,)
            By which outputs are divided.
        """
        observe = ObserveOne(self.observe, self.function.observe_names, self.outputs, scale)
        inputs = {**self.input_ranges, OUTPUT: (0.0, len(self.outputs) - 1.0)}
        return self._like(observe=observe, inputs=inputs, output=self.output)

    def solution(self, X: ArrayLike, omega: ArrayLike | None = None) -> FloatArray:
        """Return the states (n_states, n) for rows as in calling the simulator."""
        return self.function.solution(self._columns(*self._check_points(X, omega)))

    @property
    def solves_together(self) -> bool:
        """Whether many solutions are followed at once: with "rk4" alone."""
        return self.method == "rk4"

    @property
    def remembers(self) -> bool:
        """Whether the right-hand side can use earlier states: with "rk4" alone."""
        return self.method == "rk4"

    def held(self, X: FloatArray) -> FloatArray:
        """Return inputs (n, n_inputs) with times before the start at the start.

        A cause that shifts time, such as a delay, meets the initial state there.
        """
        # NaN stays NaN
        time = np.maximum(X[:, :1], self.function.start)
        return np.hstack([time, X[:, 1:]])

    def typical_states(self, X: FloatArray) -> dict[str, float]:
        """Return the root mean square of each state at the medians of the priors.

        Parameters
        ----------
        X : ndarray of shape (n, n_inputs)
        """
        columns = self._medians(len(X)) | self._columns(X, np.empty((len(X), 0)))
        square = np.nanmean(self.function.solution(columns) ** 2, axis=1)
        sizes = np.where(square > 0, np.sqrt(square), 1.0)
        return dict(zip(self.states, map(float, sizes), strict=True))

    @property
    def resolved(self) -> float:
        """The shortest time in which something may decay: half a step of "rk4".

        With less than 1 / 2.8 of a step it is unstable (Hairer and Wanner 1996, section IV.2).
        Other methods have no limit.
        """
        return self.function.step / 2 if self.method == "rk4" else 0.0

    @cached_property
    def terms(self) -> dict[str, dict[str, bool]]:
        """Of each state the rates that multiply or divide a term, and whether they divide it."""
        return separate_terms(self.function, self._typical(), self.rates)

    def _medians(self, n: int) -> dict[str, FloatArray]:
        """Return n equal rows in the middle of the inputs and at the medians of the priors."""
        names = (*self.input_names, *self.parameter_ranges)
        middle = zip(names, self._typical_point(), strict=True)
        return {name: np.full(n, value) for name, value in middle}

    def _typical(self) -> dict[str, FloatArray]:
        """Return solutions at the medians of the priors and over nine tenths of them, by times."""
        time, *others = self.input_names
        random = np.random.default_rng(0)
        ends = {name: self.input_ranges[name] for name in others}
        ends |= {name: prior.ppf([0.05, 0.95]) for name, prior in self.parameters.items()}
        columns = {}
        for name, middle in self._medians(1).items():
            tried = random.uniform(*ends[name], _TRIED) if name in ends else np.tile(middle, _TRIED)
            columns[name] = np.repeat(np.append(middle, tried), _N_TIMES)
        start, stop = self.input_ranges[time]
        times = np.append(start, np.sort(random.uniform(start, stop, _N_TIMES - 1)))
        columns[time] = np.tile(times, 1 + _TRIED)
        return columns

    def _columns(self, X: FloatArray, omega: FloatArray) -> dict[str, FloatArray]:
        names = (*self.input_names, *self.parameter_ranges, *self.modifiers)
        points = np.hstack([X, omega])
        return dict(zip(names, np.ascontiguousarray(points.T), strict=False))

    @property
    def _omega_names(self) -> tuple[str, ...]:
        return (*self.parameter_ranges, *self.modifiers)

    def _check_points(self, X: ArrayLike, omega: ArrayLike | None) -> tuple[FloatArray, FloatArray]:
        names = self._omega_names
        omega = None if omega is None else as_table(omega, "omega")
        if isinstance(omega, pd.DataFrame):
            if not set(names) <= set(omega.columns):
                return super()._check_points(X, omega)
            omega = omega[list(names)]
        values = np.empty((0, 0)) if omega is None else as_numbers(omega, "omega")
        if not self.modifiers or values.shape[1:] != (len(names),):
            return super()._check_points(X, omega)
        own, numbers = np.split(values, [len(self.parameter_ranges)], axis=1)
        X, own = super()._check_points(X, own)
        return X, np.hstack([own, numbers])

    def _evaluate(
        self, X: FloatArray, omega: FloatArray, running: Running | None = None
    ) -> tuple[FloatArray, str | None]:
        if running is None or running.store is None:
            outputs, error = self.function.outputs(self._columns(X, omega))
            return outputs.T, error
        return super()._evaluate(X, omega, running)


class ObserveOne:
    """What an ODE shows of several outputs, as one output a row: `OUTPUT` says which.

    Parameters
    ----------
    observe : callable
    names : sequence of str
        What it is passed in addition to the states.
    outputs : sequence of str
    scale : ndarray of shape (n_outputs,)
        By which outputs are divided.
    """

    def __init__(
        self,
        observe: Callable[..., Any],
        names: Sequence[str],
        outputs: Sequence[str],
        scale: FloatArray,
    ) -> None:
        self.observe, self.outputs, self.scale = observe, tuple(outputs), scale
        kind = inspect.Parameter.POSITIONAL_OR_KEYWORD
        asked = [inspect.Parameter(name, kind) for name in ("state", *names, OUTPUT)]
        self.__signature__ = inspect.Signature(asked)

    def __call__(self, state: FloatArray, **given: FloatArray) -> FloatArray:
        """Return the output of each row, (n,)."""
        which = given.pop(OUTPUT).astype(np.intp)
        outputs = by_output(self.observe(state, **given), self.outputs, "observe", axis=0)
        return np.asarray((outputs / self.scale)[np.arange(len(which)), which])


def _numbers(modifications: Sequence[Modification]) -> dict[str, float]:
    numbers: dict[str, float] = {}
    if not isinstance(modifications, list | tuple):
        raise TypeError(f"modifications must be a list of them, got {described(modifications)}.")
    for change in modifications:
        if not isinstance(change, Modification):
            raise TypeError(
                "modifications must hold Modification objects, such as "
                f'TimeVaryingParameter("rate", "step"), got {described(change)}.'
            )
        twice = sorted(numbers.keys() & change.constants.keys())
        if twice:
            raise ValueError(
                f"Two changes of the dynamics have the number {twice[0]!r}: give one of them "
                "another prefix."
            )
        numbers |= change.constants
    return numbers
