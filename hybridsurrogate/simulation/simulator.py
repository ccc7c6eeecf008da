"""The simulation as a callable with named arguments."""

from __future__ import annotations

import inspect
import numbers
import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeGuard

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from hybridsurrogate.arguments import (
    accepted_names,
    check_callable,
    check_choice,
    check_flag,
    check_n_jobs,
    check_number,
    state_to_pickle,
)
from hybridsurrogate.exceptions import FailedRunsWarning, RowByRowWarning, did_you_mean
from hybridsurrogate.priors import prior_range
from hybridsurrogate.simulation.arrays import as_numbers, as_table
from hybridsurrogate.simulation.calls import Function, TakesNumbersError
from hybridsurrogate.simulation.design import draw_design, run_with_ends
from hybridsurrogate.simulation.evaluation import OutputCache, Running, evaluate
from hybridsurrogate.simulation.modification import Modification
from hybridsurrogate.simulation.outputs import OUTPUT, OneOutput, by_output, output_names
from hybridsurrogate.simulation.run_store import RunStore
from hybridsurrogate.simulation.simulation_data import SimulationData, check_failed, read_simulation
from hybridsurrogate.simulation.table_file import RUN
from hybridsurrogate.simulation.variables import (
    Assumed,
    Range,
    as_matrix,
    check_finite,
    check_lengths,
    check_ranges,
    describe,
    named_fields,
    priors_of,
)
from hybridsurrogate.types import FloatArray, Prior

# what a function returns; values along the first input where it returns a curve
_RETURNS, _PLACES = ("values", "curve"), 100
_PLAINLY = Running()

__all__ = ["Assumed", "SimulationData", "Simulator", "read_simulation"]


@dataclass(frozen=True, init=False, repr=False, eq=False)
class Simulator:
    """A simulation that can be called.

    Parameters
    ----------
    function : callable
        Takes inputs, parameters and assumed constants as keyword arguments, arrays of n values
        each, and returns an array of n outputs; of several outputs a dict or tuple of such arrays,
        or an array of shape (n, n_outputs).
    inputs : dict of name to (low, high)
        The inputs that are known for every measurement, and the range to simulate.
    parameters : dict of name to scipy.stats frozen distribution, optional
        The inputs that are unknown, and their priors.
    assumed : dict of name to Assumed, optional
        The constants that the modeller fixed.
    output : str or sequence of str
        What the function returns, for labels; several names for several outputs.
    vectorized : bool, default=True
        False if the function does one run at a time: numbers in, a number out, as with `math.exp`
        and ``if``. A function that turns out to take numbers only is called row by row, with a
        `RowByRowWarning`, and the attribute becomes False.
    returns : {"values", "curve"}, default="values"
        "curve": one call is one run. The function gets all values of the first input as an array
        of shape (n_places,), numbers for all else, and returns an array of shape (n_places,), or a
        dict with one under the name of each output.

    Attributes
    ----------
    output : str
        The label; of several outputs their names, separated by commas.
    outputs : tuple of str
    input_names, parameter_names, assumed_names : tuple of str
    input_ranges : dict of name to (low, high)
    parameter_ranges : dict of name to (low, high)
        Of the parameters, then of the assumed constants: the support of the prior, with an
        infinite end replaced by the 0.1 % quantile.
    rates : tuple of str
        Those parameters and constants of which a right-hand side is known; see `OdeSimulator`.
    starts : tuple of str
        Those parameters that are known to set the initial state and nothing else.

    Examples
    --------
    >>> import hybridsurrogate as hs
    >>> def height(t, gravity):
    ...     return 100 - gravity / 2 * t**2
    >>> simulator = hs.Simulator(
    ...     height, inputs={"t": (0, 4)}, parameters={"gravity": hs.truncated_normal(9.8, 1, 5, 15)}
    ... )
    >>> simulator([1.0, 2.0], [10.0, 10.0])
    array([95., 80.])
    >>> simulator.run(50, random_state=0)
    SimulationData(50 runs of height: t -> y, parameters: gravity)
    """

    function: Callable[..., Any]
    parameters: dict[str, Prior]
    assumed: dict[str, Assumed]
    output: str
    outputs: tuple[str, ...]
    vectorized: bool
    returns: str
    input_names: tuple[str, ...]
    parameter_names: tuple[str, ...]
    assumed_names: tuple[str, ...]
    input_ranges: dict[str, Range]
    parameter_ranges: dict[str, Range]
    rates: tuple[str, ...]
    starts: tuple[str, ...]
    cache: OutputCache
    # whether the first input is time, along which there is a before and an after
    is_in_time = False

    def __init__(
        self,
        function: Callable[..., Any],
        inputs: Mapping[str, Range],
        parameters: Mapping[str, Prior] | None = None,
        assumed: Mapping[str, Assumed] | None = None,
        output: str | Sequence[str] = "y",
        vectorized: bool = True,
        returns: str = "values",
    ) -> None:
        check_callable(function, "function", "def simulation(t, rate)")
        check_choice(returns, "returns", _RETURNS)
        ranges = check_ranges(inputs)
        fields = named_fields(tuple(ranges), parameters, assumed)
        priors = priors_of(fields["parameters"], fields["assumed"])
        outputs = output_names(output)
        fields |= {
            "function": function,
            "output": ", ".join(outputs),
            "outputs": outputs,
            "vectorized": check_flag(vectorized, "vectorized") and returns == "values",
            "returns": returns,
            "input_ranges": ranges,
            "parameter_ranges": {name: prior_range(prior) for name, prior in priors.items()},
            "rates": (),
            "starts": (),
            "cache": OutputCache(),
        }
        self.__dict__.update(fields)
        names = (*self.input_names, *self.parameter_ranges)
        unknown = sorted({*names} - {*accepted_names(function, repr(self.name), names)})
        if unknown:
            raise TypeError(
                f"{self.name!r} has no argument {', '.join(unknown)}: inputs, parameters and "
                "assumed constants are passed to it by name."
                f"{did_you_mean(unknown, inspect.signature(function).parameters)}"
            )

    @property
    def name(self) -> str:
        """The name of the function."""
        return str(getattr(self.function, "__name__", type(self.function).__name__))

    @property
    def simulator(self) -> Simulator:
        """Itself: runs and a callable simulation can be asked for it alike."""
        return self

    def typical_states(self, X: FloatArray) -> dict[str, float]:
        """Return sizes of the states inside, which a function does not show: none."""
        return {}

    @property
    def resolved(self) -> float:
        """The shortest time that a solver inside resolves: a function has none."""
        return 0.0

    @property
    def terms(self) -> dict[str, dict[str, bool]]:
        """Terms of slopes inside, which a function does not show: none."""
        return {}

    @property
    def remembers(self) -> bool:
        """Whether there is a right-hand side that can use earlier states: no."""
        return False

    def held(self, X: FloatArray) -> FloatArray:
        """Return inputs (n, n_inputs), with those before the start moved to the start."""
        return X

    def modified(
        self,
        modifications: Sequence[Modification],
        parameters: Mapping[str, Prior] | None = None,
    ) -> Simulator:
        """Return the simulator with changed dynamics; only an `OdeSimulator` has any."""
        raise ValueError(
            f"{self.name!r} shows no right-hand side to change: only an OdeSimulator does."
        )

    def single_output(self, scale: FloatArray) -> Simulator:
        """Return the simulation with one output a row, `OUTPUT` its last input.

        Parameters
        ----------
        scale : ndarray of shape (n_outputs,)
            By which outputs are divided.
        """
        names = (*self.input_names, *self.parameter_ranges)
        function = OneOutput(self, names, len(self.input_names), scale)
        inputs = {**self.input_ranges, OUTPUT: (0.0, len(self.outputs) - 1.0)}
        return Simulator(function, inputs, self.parameters, self.assumed, self.output)

    def __sklearn_clone__(self) -> Simulator:
        return self

    def __getstate__(self) -> dict[str, Any]:
        return state_to_pickle(self.__dict__, f"the simulation {self.name!r}")

    def __repr__(self) -> str:
        names = (self.input_names, self.parameter_names, self.assumed_names)
        return f"{type(self).__name__}({describe(self.name, *names, self.output)})"

    @property
    def is_quick(self) -> bool:
        """Whether many runs take hardly longer than one: a function of arrays, no ODE."""
        if isinstance(self.function, OneOutput):
            return self.function.simulator.is_quick
        return self.vectorized and not self.is_in_time

    @property
    def solves_together(self) -> bool:
        """Whether many solutions are followed at once, so that one more takes no time."""
        return isinstance(self.function, OneOutput) and self.function.simulator.solves_together

    def __call__(
        self, X: ArrayLike, omega: ArrayLike | None = None, n_jobs: int | None = None
    ) -> FloatArray:
        """Run the simulation.

        Parameters
        ----------
        X : array-like of shape (n, n_inputs)
        omega : array-like of shape (n, n_parameters) or (n, n_parameters + n_assumed)
            Without the columns of the assumed constants, these take their assumed values.
        n_jobs : int, optional
            Processes that share the runs if the function does one at a time; a vectorised
            function gets all rows in one call.

        Returns
        -------
        ndarray of shape (n,), or (n, n_outputs) of several
            NaN where a run raised an exception.

        Raises
        ------
        ValueError
            For points that hold NaN or infinity, or have another shape.
        Exception
            What a function of arrays raised, where it fails in the middle of the ranges too.

        Warns
        -----
        RowByRowWarning
            At the first call of a function that was to take arrays, and takes numbers only.
        """
        X, omega = self._check_points(X, omega)
        check_finite(X, "X", self.input_names)
        check_finite(omega, "omega", self._omega_names)
        return self._evaluate(X, omega, Running(check_n_jobs(n_jobs)))[0]

    def evaluate(self, X: FloatArray, omega: FloatArray | None) -> FloatArray:
        """As calling it; points that hold NaN or infinity are passed on as they are.

        Samplers propose parameters that overflow. Their outputs are impossible, which is no error.

        Parameters
        ----------
        X : ndarray of shape (n, n_inputs)
        omega : ndarray of shape (n, n_parameters + n_assumed), or None

        Returns
        -------
        ndarray of shape (n,), or (n, n_outputs) of several
        """
        return self._evaluate(*self._check_points(X, omega))[0]

    def tried(self, X: FloatArray, omega: FloatArray) -> tuple[FloatArray, str | None]:
        """As `evaluate`, with what the first run that raised said, None where none did.

        Parameters
        ----------
        X : ndarray of shape (n, n_inputs)
        omega : ndarray of shape (n, n_parameters + n_assumed)

        Returns
        -------
        outputs : ndarray of shape (n,), or (n, n_outputs) of several
        error : str or None
        """
        return self._evaluate(*self._check_points(X, omega))

    def cached(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Run the simulation in a search; outputs of rows that were run before are cached.

        Not of solutions that are followed at once: a search asks 3 % of its batches again, and
        looking them up takes an eighth of its time.

        Parameters
        ----------
        X, omega : ndarray
            As in a call, with the columns of assumed constants.

        Returns
        -------
        ndarray of shape (n,) or (n, n_outputs)
        """
        if X.ndim != 2 or omega.ndim != 2 or self.solves_together:
            return self.evaluate(X, omega)
        k = len(self.input_names)
        points = np.concatenate([X.T, omega.T]).T
        outputs = self.cache.outputs_if_slow if self.is_quick else self.cache.outputs
        return outputs(lambda new: self.evaluate(new[:, :k], new[:, k:]), points)

    def run(
        self,
        n_runs: int,
        design: str = "sobol",
        random_state: Any = None,
        n_jobs: int | None = None,
        progress: bool = False,
        ends: float = 0.02,
        along: int | ArrayLike | None = None,
        store: str | os.PathLike[str] | None = None,
        timeout: float | None = None,
    ) -> SimulationData:
        """Run the simulation over the ranges of inputs, parameters and assumed constants.

        Parameters
        ----------
        n_runs : int
            A power of two fills the ranges most evenly.
        design : {"sobol", "latin-hypercube"}
            Either is uniform over the ranges: the priors do not shape it.
        random_state : None, int, numpy Generator or RandomState
            The same number gives the same runs, whatever ``n_jobs`` is.
        n_jobs : int, optional
            As in calling the simulator.
        progress : bool
            Show a progress bar if the function does one run at a time.
        ends : float
            Share of the runs, from 0 to 0.1, that are moved to each end of the range of each input.
            Runs near a steep end, such as a source or a start, do not determine the output there.
            At most a quarter of all runs are moved, and none of fewer than 25. None is moved to an
            end where the simulation fails, or is further beyond all other runs than these are
            apart.
        along : int, array-like of shape (n_places,) or None, default=None
            Each run is a curve along the first input: so many values over its range, or these.
            None: each run has one output, but 100 values where the function returns a curve.
        store : str, path or None, default=None
            Folder to which each finished run is written at once, one line an output. The same
            call goes on with what is there after an interrupt or a kill; runs that failed are kept
            with their error and not tried again. A function that has changed needs a new folder:
            runs go by the function's name, inputs and parameters.
        timeout : float or None, default=None
            Seconds that one run may take. A Python function is stopped when it next returns to
            Python. This needs signals and the main thread of a process; elsewhere the runs fail
            with this reason. `CommandSimulator` stops its program at once, anywhere.

        Returns
        -------
        SimulationData

        Raises
        ------
        ValueError, TypeError
            For a number of runs, a design or a share that is not valid.

        Warns
        -----
        FailedRunsWarning
            If runs gave NaN, infinity or an exception; the others are kept.
        """
        ranges = [*self.input_ranges.values(), *self.parameter_ranges.values()]
        check_number(ends, "ends", numbers.Real, min_val=0, max_val=0.1)
        k = len(self.input_names)
        running = self._running(n_jobs, progress, store, timeout)
        if along is not None or self.returns == "curve":
            places = self._places(_PLACES if along is None else along)
            points = draw_design(ranges[1:], n_runs, design, random_state)
            return self._curves(points, places, running)

        def outputs(points: FloatArray) -> tuple[FloatArray, str | None]:
            return self._evaluate(points[:, :k], points[:, k:], running)

        points = draw_design(ranges, n_runs, design, random_state)
        points, y, error = run_with_ends(outputs, points, ranges[:k], ends)
        X, omega = np.split(points, [k], axis=1)
        done = check_failed(X, omega, y, f"runs of {self.name!r}", error)
        return self._runs(X[done], omega[done], y[done], failed=points[~done])

    def run_at(
        self,
        runs: Any,
        along: int | ArrayLike | None = None,
        n_jobs: int | None = None,
        progress: bool = False,
        store: str | os.PathLike[str] | None = None,
        timeout: float | None = None,
    ) -> pd.DataFrame:
        """Run the simulation for given parameters.

        Parameters
        ----------
        runs : DataFrame
            Inputs, parameters and assumed constants by name, one row a run; without the first
            input where a run is a curve along it. `DiscrepancyDiagnosis.next_runs` returns one.
        along : int, array-like of shape (n_places,) or None, default=None
            Of curves, as in `run`.
        n_jobs, progress, store, timeout
            As in `run`.

        Returns
        -------
        pandas.DataFrame
            Inputs, parameters, constants and outputs, and of curves which run a row is of;
            NaN where a run failed. `SimulationData.with_rows` takes it.

        Raises
        ------
        ValueError
            For runs that hold NaN or infinity, or lack a column.
        """
        first, *others = self.input_names
        names = [*others, *self.parameter_ranges]
        if along is None and self.returns == "values":
            points = as_matrix(runs, "runs", (first, *names))
            check_finite(points, "runs", (first, *names))
            run, X, omega = None, points[:, : 1 + len(others)], points[:, 1 + len(others) :]
        else:
            places = self._places(_PLACES if along is None else along)
            points = as_matrix(runs, "runs", tuple(names))
            check_finite(points, "runs", names)
            run, X, omega = self._curve_rows(points, places)
        frame = pd.DataFrame(np.hstack([X, omega]), columns=[first, *names])
        running = self._running(n_jobs, progress, store, timeout)
        frame[list(self.outputs)] = self._evaluate(X, omega, running)[0].reshape(len(X), -1)
        if run is not None:
            frame.insert(0, RUN, run)
        return frame

    def _places(self, along: int | ArrayLike) -> FloatArray:
        """Return the values of the first input at which each run is wanted."""
        name = self.input_names[0]
        low, high = self.input_ranges[name]
        if isinstance(along, numbers.Integral):
            check_number(along, "along", numbers.Integral, min_val=5)
            return np.linspace(low, high, int(along))
        places = np.unique(as_numbers(along, "along"))
        if len(places) < 5 or not low <= places[0] <= places[-1] <= high:
            raise ValueError(
                f"along must be at least 5 different values of {name!r} from {low:g} to {high:g}."
            )
        return places

    def _curve_rows(
        self, points: FloatArray, places: FloatArray
    ) -> tuple[NDArray[np.intp], FloatArray, FloatArray]:
        """Return run, inputs and omega of all rows of runs (n_runs, d) over places."""
        n, k = len(points), len(self.input_names) - 1
        run = np.repeat(np.arange(n), len(places))
        X = np.column_stack([np.tile(places, n), points[run, :k]])
        return run, X, points[run, k:]

    def _curves(self, points: FloatArray, places: FloatArray, running: Running) -> SimulationData:
        """Return runs (n_runs, d) of the other inputs and of omega as curves over places."""
        run, X, omega = self._curve_rows(points, places)
        y, error = self._evaluate(X, omega, running)
        kept = np.asarray(np.isfinite(y).reshape(len(y), -1).any(axis=1))
        if not kept.any():
            raise ValueError(
                f"All {len(points)} runs of {self.name!r} failed. First error: {error}"
            )
        lost = np.setdiff1d(run, run[kept])
        failed = np.insert(points[lost], 0, places[0], axis=1)
        if not kept.all():
            warnings.warn(
                f"{len(lost)} of {len(points)} runs of {self.name!r} failed and were dropped, "
                f"{np.sum(~kept) - len(lost) * len(places)} further outputs are missing. "
                f"First error: {error or 'they hold NaN or infinity'}.",
                FailedRunsWarning,
                stacklevel=3,
            )
        return self._runs(X[kept], omega[kept], y[kept], run[kept], failed)

    def _runs(
        self,
        X: FloatArray,
        omega: FloatArray,
        y: FloatArray,
        run: NDArray[np.intp] | None = None,
        failed: FloatArray | None = None,
    ) -> SimulationData:
        named = self.input_ranges, self.parameters, self.assumed, self.outputs
        return SimulationData(X, omega, y, *named, self, run, failed)

    @property
    def _omega_names(self) -> tuple[str, ...]:
        return tuple(self.parameter_ranges)

    def _check_points(self, X: ArrayLike, omega: ArrayLike | None) -> tuple[FloatArray, FloatArray]:
        # most calls of a simulation: thousands in a search; what runs it makes its own columns
        if _is_matrix(X, len(self.input_names)) and _is_matrix(omega, len(self.parameter_ranges)):
            check_lengths({"X": X, "omega": omega})
            return X, omega
        X = as_matrix(X, "X", self.input_names)
        table = as_table(np.empty((len(X), 0)) if omega is None else omega, "omega")
        names = tuple(self.parameter_ranges)
        if isinstance(table, pd.DataFrame):
            complete = set(self.assumed_names) <= set(table.columns)
        else:
            table = table[:, None] if table.ndim == 1 else table
            complete = table.shape[1:] == (len(names),)
        if complete:
            points = as_matrix(table, "omega", names)
        else:
            points = as_matrix(table, "omega", self.parameter_names)
            values = [constant.value for constant in self.assumed.values()]
            points = np.column_stack([points, np.tile(values, (len(points), 1))])
        check_lengths({"X": X, "omega": points})
        return X, points

    def _evaluate(
        self, X: FloatArray, omega: FloatArray, running: Running = _PLAINLY
    ) -> tuple[FloatArray, str | None]:
        # the outputs, NaN where a run raised, and what the first such run said
        try:
            return evaluate(self._called, X, omega, running)
        except TakesNumbersError as said:
            warnings.warn(
                f"{self.name!r} takes numbers, not arrays ({said}): it is called row by row, which "
                "is slower. Write it with numpy (np.exp for math.exp, np.where for if), or pass "
                "vectorized=False to accept this.",
                RowByRowWarning,
                stacklevel=3,
            )
        self.__dict__["vectorized"] = False
        return evaluate(self._called, X, omega, running)

    @property
    def _called(self) -> Function:
        names = (*self.input_names, *self.parameter_ranges)
        return Function(
            self.function,
            self.name,
            names,
            self.outputs,
            self.returns,
            self.vectorized,
            self._typical_point,
            partial(by_output, names=self.outputs, title=repr(self.name)),
        )

    def _typical_point(self) -> list[float]:
        """Return the middle of the inputs, medians of the priors, and assumed values."""
        return [
            *((low + high) / 2 for low, high in self.input_ranges.values()),
            *(float(self.parameters[name].median()) for name in self.parameter_names),
            *(constant.value for constant in self.assumed.values()),
        ]

    def _running(
        self,
        n_jobs: int | None,
        progress: bool,
        store: str | os.PathLike[str] | None,
        timeout: float | None,
    ) -> Running:
        if timeout is not None:
            check_number(timeout, "timeout", numbers.Real, min_val=0, include_boundaries="neither")
            if self.vectorized:
                raise ValueError(
                    "timeout is for one run: a vectorized function gets all of them in one call."
                )
        names = (*self.input_names, *self.parameter_ranges, *self.outputs)
        kept = None
        if store is not None:
            kept = RunStore(store, self.name, names, len(self.outputs))
        progress = check_flag(progress, "progress")
        return Running(
            check_n_jobs(n_jobs), progress, kept, None if timeout is None else float(timeout)
        )


def _is_matrix(values: ArrayLike | None, n_columns: int) -> TypeGuard[FloatArray]:
    """Return whether values are a plain array of doubles with so many columns."""
    return (
        type(values) is np.ndarray
        and values.dtype == np.float64
        and values.shape[1:] == (n_columns,)
    )
