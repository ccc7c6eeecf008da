"""A slow simulation replaced by an emulator: runs over the priors, then near the posterior.

The first runs fill the ranges of the priors. Further ones are at draws of the posterior that are
furthest from all runs, until the emulator's error is small compared with the noise.
"""

from __future__ import annotations

import copy
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import pandas as pd
from joblib import effective_n_jobs, parallel_config
from numpy.typing import NDArray

from hybridsurrogate.estimators.checked_estimator import CheckedEstimator
from hybridsurrogate.exceptions import (
    EmulationWarning,
    FailedRunsWarning,
    HybridSurrogateWarning,
)
from hybridsurrogate.likelihoods import Likelihood
from hybridsurrogate.model.posterior import Posterior
from hybridsurrogate.model.rows.columns import check_reach, warn_elsewhere
from hybridsurrogate.model.rows.measured_data import MeasuredData
from hybridsurrogate.numerics.digits import number
from hybridsurrogate.simulation.design import draw_design
from hybridsurrogate.simulation.simulator import SimulationData, Simulator
from hybridsurrogate.simulation.table_file import RUN
from hybridsurrogate.surrogates.families.kriging import Kriging
from hybridsurrogate.types import FloatArray

# seconds of a set of parameters from which runs are made beforehand; the most sets that are timed,
# and the share of its time that each takes of four times as many where more are tried
_SLOW_SECONDS, _MAX_TIMED, _BATCHING_GAIN = 1e-3, 256, 0.6
# share of the time that a simulation is busy below which it waits for other programs
_WAITING = 0.25
# sets that a fit asks for: 3,400 to 6,700 with one to five parameters
_FIT_SETS = 5000
# runs for each dimension (Loeppky, Sacks and Welch 2009, Technometrics 51:366)
_RUNS_EACH = 10
# places of a run: those that were measured, at most so many, and so many evenly over the range
_MAX_PLACES, _EVEN_PLACES = 200, 25
# rounds of further runs, half as many as the first ones, while more of the noise is left open
_ROUNDS, _MAX_LEFT_OPEN = 4, 0.1
# seconds of which the user is warned before
LONG_SECONDS = 150.0

E = TypeVar("E", bound=CheckedEstimator)


@dataclass(frozen=True)
class Emulation:
    """The emulator by which a fit replaced a slow simulation.

    Attributes
    ----------
    runs : SimulationData
        Those that were made: curves along the first input.
    seconds : float
        That the simulation takes for one set of parameters at the measured rows.
    left_open : float
        Standard deviation of the emulator at these rows: root mean square over them and the
        posterior, in standard deviations of the noise.
    """

    runs: SimulationData
    seconds: float
    left_open: float

    def __sklearn_clone__(self) -> Emulation:
        """Return itself: it is a value."""
        return self

    @property
    def origin(self) -> str:
        """What takes the place of the simulation, and why."""
        return (
            f"The simulation takes {_duration(self.seconds)} for one set of parameters, "
            f"and was emulated by Kriging() from {self.runs.n_runs} runs of it."
        )

    def __str__(self) -> str:
        return (
            f"{self.origin} The emulator's standard deviation at the measured rows is "
            f"{number(self.left_open, 2)} times the noise."
        )


def emulated(estimator: E, data: MeasuredData) -> E | None:
    """Return the estimator fitted to runs of its simulation; None where it needs no emulator.

    That is where a surrogate was chosen, there is nothing to run, or a run takes no time.

    Parameters
    ----------
    estimator : SurrogateEstimator
    data : MeasuredData

    Returns
    -------
    SurrogateEstimator or None
        Another one: `take` keeps what it found.

    Warns
    -----
    EmulationWarning
        That the simulation was emulated, from how many runs, and how well.
    """
    simulator = estimator.simulation
    if estimator.surrogate is not None or not isinstance(simulator, Simulator):
        return None
    if not simulator.parameter_ranges:
        return None
    likelihood = estimator.checked_settings()[1]
    inputs = data.X[data.weights > 0][:, : len(simulator.input_names)]
    seconds = seconds_a_set(simulator, inputs)
    if seconds < _SLOW_SECONDS:
        return None
    places = _places(simulator, inputs[:, 0])
    n_first = _RUNS_EACH * (len(simulator.parameter_ranges) + inputs.shape[1] - 1)
    each = max(1.0, len(places) / len(inputs))
    if n_first * each > _FIT_SETS:
        return None
    _warn_if_long(simulator, n_first, len(places), seconds * each)
    # whatever the seed of the fit: fits to the same rows have the same runs
    runs = _possible(simulator.run(n_first, random_state=0, along=places), likelihood)
    random = np.random.RandomState(0)
    for left in range(_ROUNDS, -1, -1):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", HybridSurrogateWarning)
            check_reach(data.given_columns, data.X, runs)
            warn_elsewhere(data.y, runs)
            fitted = copy.copy(estimator).set_params(simulation=runs, surrogate=Kriging())
            fitted.fit_data(data.simulated_by(runs))
        rows = data.distinct
        found = left_open(posterior_of_simulation(fitted), rows.X, rows.weights)
        if found < _MAX_LEFT_OPEN or not left:
            break
        further = _further(fitted, simulator, n_first // 2, random)
        runs = _possible(_with_further(runs, simulator, further, places), likelihood)
    for warning in caught:
        warnings.warn(warning.message, warning.category, stacklevel=3)
    fitted.emulation_ = Emulation(runs, seconds, found)
    warnings.warn(
        f"{fitted.emulation_} surrogate=ExactSurrogate() runs the simulation itself, some "
        f"{_FIT_SETS:,} sets of parameters a fit: {_duration(_FIT_SETS * seconds)}.",
        EmulationWarning,
        stacklevel=3,
    )
    return fitted


def take(estimator: E, fitted: E) -> E:
    """Return an estimator with the fitted attributes of another one of its class."""
    parameters = estimator.get_params(deep=False)
    for name in set(vars(estimator)) - set(parameters):
        delattr(estimator, name)
    for name, value in vars(fitted).items():
        if name not in parameters:
            setattr(estimator, name, value)
    return estimator


def as_given(estimator: E) -> E:
    """Return a fitted estimator as if it had been given the runs that its fit made."""
    if estimator.emulation_ is None:
        return estimator
    out = copy.copy(estimator)
    return out.set_params(simulation=estimator.emulation_.runs, surrogate=estimator.surrogate_)


def seconds_a_set(simulator: Simulator, X: FloatArray) -> float:
    """Return the seconds that a simulation takes for one set of parameters at rows X (n, k).

    Of several at once where these take less: more are tried while each takes far less of them.
    """
    ranges = [*simulator.parameter_ranges.values()]
    none = np.empty((_MAX_TIMED, 0))
    omega = draw_design(ranges, _MAX_TIMED, random_state=0) if ranges else none
    # the first call may find out that a function takes numbers, and compile or import what it needs
    with parallel_config(n_jobs=1):
        simulator.evaluate(X[:1], omega[:1])

    def run(n: int) -> None:
        simulator.evaluate(np.tile(X, (n, 1)), np.repeat(omega[:n], len(X), axis=0))

    clocks = time.perf_counter, time.process_time
    began = [clock() for clock in clocks]
    each = seconds_of_each(run, time.perf_counter, _MAX_TIMED if simulator.vectorized else 1)
    passed, busy = (clock() - start for clock, start in zip(clocks, began, strict=True))
    # what other programs take of the machine must not decide how a fit is made; a simulation that
    # waits for one, such as a code that it starts, takes hardly any of the processor itself
    return each * busy / passed if _WAITING * passed < busy < passed else each


def seconds_of_each(
    run: Callable[[int], object], clock: Callable[[], float], most: int = _MAX_TIMED
) -> float:
    """Return the seconds that ``run(n)`` takes for each of n sets of parameters, n at most."""
    n, each = 1, np.inf
    while True:
        start = clock()
        with parallel_config(n_jobs=1):  # processes take a second to start
            run(n)
        before, each = each, (clock() - start) / n
        if each < _SLOW_SECONDS or each > _BATCHING_GAIN * before or n == most:
            return min(each, before)
        n *= 4


def left_open(posterior: Posterior, X: FloatArray, weights: FloatArray) -> float:
    """Return the standard deviation of an emulator at measured rows, in units of the noise.

    Parameters
    ----------
    posterior : Posterior
    X, weights : ndarray of shape (n, n_columns), (n,)
        Rows, those of no weight ignored.

    Returns
    -------
    float
        Root mean square over rows and draws.
    """
    some = posterior.thinned()
    X = X[weights > 0]
    features = some.model.simulated(X, some.values)[1]
    open_ = np.sum((features * some.model.basis.coefficient_sd) ** 2, axis=-1)
    eta, noise = some.eta(X)
    # of any likelihood the information about eta is one over the variance of its noise
    information = some.likelihood.information(eta, noise)
    return float(np.sqrt(np.mean(open_ * information)))


def posterior_of_simulation(estimator: CheckedEstimator) -> Posterior:
    """Return the posterior based on the simulation, without effects drawn from priors alone."""
    fit: Any = estimator.inference_
    found: Posterior = (fit["simulation"] if isinstance(fit, dict) else fit).second
    return found


def _places(simulator: Simulator, measured: FloatArray) -> FloatArray:
    """Return the values of the first input that a run has: the measured ones, and evenly some."""
    low, high = simulator.input_ranges[simulator.input_names[0]]
    own = np.unique(measured[(measured >= low) & (measured <= high)])
    if len(own) > _MAX_PLACES:
        own = own[np.linspace(0, len(own) - 1, _MAX_PLACES).astype(int)]
    return np.union1d(own, np.linspace(low, high, _EVEN_PLACES))


def _possible(runs: SimulationData, likelihood: Likelihood) -> SimulationData:
    """Return runs without the outputs that no measured value can have: these failed."""
    try:
        likelihood.check_training(runs.y[np.isfinite(runs.y)], "simulated")
        return runs
    except ValueError as error:
        with np.errstate(invalid="ignore", divide="ignore"):
            y = np.where(np.isfinite(likelihood.link(runs.y)), runs.y, np.nan)
        if not np.isfinite(y).any():
            raise
        lost = int(np.isnan(y).sum() - np.isnan(runs.y).sum())
        if lost:
            warnings.warn(
                f"{lost} of {runs.y.size} outputs of the runs were dropped: {error}",
                FailedRunsWarning,
                stacklevel=4,
            )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FailedRunsWarning)
        return runs.with_data(runs.X, runs.omega, y, runs.run)


def _with_further(
    runs: SimulationData, simulator: Simulator, points: pd.DataFrame, places: FloatArray
) -> SimulationData:
    """Return runs and further ones at points, without those that failed."""
    table = simulator.run_at(points, places)
    done = table[table[list(runs.outputs)].notna().any(axis=1)]
    lost = len(points) - done[RUN].nunique()
    if lost:
        warnings.warn(
            f"{lost} of {len(points)} further runs of {simulator.name!r} failed and were dropped.",
            FailedRunsWarning,
            stacklevel=4,
        )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FailedRunsWarning)
        return runs.with_rows(table)


def _warn_if_long(simulator: Simulator, n: int, n_places: int, seconds: float) -> None:
    """Warn before runs that take minutes, of so many seconds each."""
    if n * seconds > LONG_SECONDS * effective_n_jobs():
        warnings.warn(
            f"The simulation {simulator.name!r} takes {_duration(seconds)} for one set of "
            f"parameters, and is run at least {n} times before the fit: {_duration(n * seconds)}. "
            f"simulator.run({n}, along={n_places}, n_jobs=-1, store='runs') makes runs that are "
            "kept, for surrogate=Kriging().",
            EmulationWarning,
            stacklevel=4,
        )


def _duration(seconds: float) -> str:
    """Return a time in words."""
    for unit, size in (("days", 86_400.0), ("hours", 3600.0), ("minutes", 60.0)):
        if seconds >= 2 * size:
            return f"{number(seconds / size, 2)} {unit}"
    return f"{number(seconds, 2)} seconds" if seconds >= 1 else f"{number(1000 * seconds, 2)} ms"


def _further(
    fitted: CheckedEstimator, simulator: Simulator, n: int, random: np.random.RandomState
) -> pd.DataFrame:
    """Return points at which draws of the posterior are furthest from all runs and each other."""
    posterior, X = posterior_of_simulation(fitted), fitted.data_.distinct.X
    inputs, omega = posterior.model.places(X, posterior.values)
    # each draw at one of the rows
    n_draws = posterior.n_draws
    at = np.arange(n_draws) * len(X) + random.randint(len(X), size=n_draws)
    k = len(simulator.input_names)
    candidates = np.hstack([inputs[at, 1:k], omega[at]])
    names = [*simulator.input_names[1:], *simulator.parameter_ranges]
    runs = fitted.simulation.to_frame()[[RUN, *names]].drop_duplicates(RUN)[names].to_numpy()
    scale = np.std(candidates, axis=0)
    scale[scale == 0] = 1.0
    chosen = _furthest(candidates / scale, runs / scale, n)
    return pd.DataFrame(candidates[chosen], columns=names)


def _furthest(points: FloatArray, known: FloatArray, n: int) -> NDArray[np.intp]:
    """Return n of the points (m, d), each the furthest from the known and those before it."""
    distance = np.min(np.sum((points[:, None] - known) ** 2, axis=2), axis=1)
    chosen = []
    for _ in range(min(n, len(points))):
        k = int(np.argmax(distance))
        chosen.append(k)
        distance = np.minimum(distance, np.sum((points - points[k]) ** 2, axis=1))
    return np.array(chosen)
