"""What a simulation and its runs allow: cost of a search, error of the emulator, roughness."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from time import perf_counter
from typing import NamedTuple

import numpy as np

from hybridsurrogate.diagnosis.checks.caution import SETTINGS, Caution
from hybridsurrogate.diagnosis.search.search import Search
from hybridsurrogate.emulators.failures import Failures
from hybridsurrogate.estimators.emulation import LONG_SECONDS, seconds_of_each
from hybridsurrogate.exceptions import DiagnosisWarning
from hybridsurrogate.model.context import LONGEST_STEP, around, output
from hybridsurrogate.model.posterior import Posterior
from hybridsurrogate.model.problem import Problem
from hybridsurrogate.model.statistics import emulator_posterior
from hybridsurrogate.numerics.digits import number
from hybridsurrogate.simulation.arrays import is_whole
from hybridsurrogate.simulation.outputs import OUTPUT
from hybridsurrogate.simulation.simulator import SimulationData
from hybridsurrogate.surrogates import Kriging
from hybridsurrogate.surrogates.basis import Basis, Surrogate
from hybridsurrogate.types import FloatArray


def seconds_a_run(problem: Problem) -> float:
    """Return the seconds that the simulation takes for one set of parameters at the measured rows.

    Zero for an emulator.
    """
    model = problem.model
    if not model.basis.is_simulation:
        return 0.0

    def run(n: int) -> None:
        # other sets each time: outputs that are known already take no time
        z = np.random.RandomState().standard_normal((n, model.n_unknowns))
        model.simulated(problem.X, model.values(z))

    return seconds_of_each(run, perf_counter)


def warn_if_slow(problem: Problem, n_folds: int | None = None) -> None:
    """Warn the caller of ``fit`` where the simulation is too slow to be run in a search.

    Parameters
    ----------
    problem : Problem
    n_folds : int or None, default=None
        Of the cross-validation, each with a separate search.
    """
    each = seconds_a_run(problem)
    folds = 0 if n_folds is None else n_folds
    sets = SETTINGS.search_runs * (1 + SETTINGS.fold_share * folds)
    if each * sets < LONG_SECONDS:
        return
    thousands = round(sets, -3)
    without = "" if n_folds is None else " cv=None leaves the folds out."
    warnings.warn(
        f"The simulation takes {number(1000 * each, 2)} ms for one set of parameters, and this "
        f"diagnosis runs about {thousands:,.0f} of them, {thousands * len(problem.y):,.0f}"
        f" rows: about {number(each * sets / 60, 2)} minutes. With "
        "surrogate=None runs of it are made and searched in seconds, as with "
        f"simulation=simulator.run(200, n_jobs=-1) and surrogate=Kriging().{without}",
        DiagnosisWarning,
        stacklevel=4,
    )


# more than the noise hides, in its standard deviations; measured rows mend some of what is missed
MAX_LEFT_OPEN, MAX_MISSED = 1.0, 2.0
# of runs that are whole numbers: 24 nats of a jump were lost where they left 0.35 open, and
# rounding took 0.24
_MAX_LEFT_OPEN_OF_WHOLE = 0.3


def advice_on_runs(surrogate: Surrogate | None) -> str:
    """Return what to do about a surrogate that misses the simulation."""
    return "give more runs" if isinstance(surrogate, Kriging) else "try Kriging() or more runs"


class EmulatorCheck(NamedTuple):
    """How well the runs and the surrogate determine the simulation at the measured rows.

    Root mean squares over these rows, in standard deviations of the noise, and rows beyond.

    Attributes
    ----------
    left_open : float
        The uncertainty of the simulation given the runs. It is part of every comparison of the
        search.
    missed : float
        The error of the surrogate, trained on the runs alone, where the runs determine the
        simulation. The search does without it; the estimators predict with it.
    beyond : dict of str to int
        Measured rows that lie further out along an input than every run, by its name.
    between : float
        The part of ``left_open`` that lies between the places of runs that are curves: finer places
        close it, and more runs do not.
    scatter : float
        By how much repeated runs of a stochastic simulation differ as curves. A measured system is
        one run: the comparisons of the search count it, ``left_open`` does not.
    along : str or None
        The input along which runs are curves; of fields both.
    rounding : float or None
        What rounding to whole numbers takes from an expected count at the measured rows, where runs
        of counts are whole numbers; None where they are not.
    unrepeated : float
        The part of ``left_open`` by which runs that are curves differ from those of near
        parameters: noise of a stochastic simulation, or jumps; repeated runs distinguish them.
    """

    left_open: float
    missed: float
    beyond: dict[str, int]
    between: float
    scatter: float
    along: str | None = None
    rounding: float | None = None
    unrepeated: float = 0.0

    @property
    def hidden(self) -> float:
        """How large an effect the runs may hide, in units of the noise; 0 where that is little.

        More than the noise is much. Of runs that are whole numbers less is: rounded means are
        stairs, all zero below one half, and an emulator of stairs is rough.
        """
        left_open = math.hypot(self.left_open, self.rounding or 0.0)
        most = MAX_LEFT_OPEN if self.rounding is None else _MAX_LEFT_OPEN_OF_WHOLE
        return left_open if left_open > most else 0.0

    @property
    def between_runs(self) -> float:
        """The part of ``left_open`` that more runs close."""
        return math.sqrt(max(self.left_open**2 - self.between**2, 0.0))

    @property
    def needs_places(self) -> bool:
        """Whether finer places of the runs close more than further runs do."""
        return self.between > self.between_runs

    @property
    def needs_repeats(self) -> bool:
        """Whether repeated runs show more than further ones do."""
        return self.unrepeated**2 > self.left_open**2 / 2

    @property
    def needs_runs(self) -> bool:
        """Whether further runs of the same kind are what would decide."""
        return self.rounding is None and not self.needs_places and not self.needs_repeats

    @property
    def remedy(self) -> str:
        """What to do about ``left_open``."""
        itself = "or the simulation itself with surrogate=ExactSurrogate()"
        if self.rounding is not None:
            return f"Give the expected counts as runs, not rounded ones or draws, {itself}."
        if self.needs_repeats:
            return (
                "Runs of near parameters differ by most of what is open. If the simulation draws "
                "random numbers, run some points twice or more, such as 20 of them: how a run "
                f"scatters is then no error. If it jumps, give many more runs, {itself}."
            )
        if not self.needs_places:
            return f"Give more runs, {itself}."
        share = "All of it" if self.between_runs < 0.1 * self.between else "Most of it"
        return (
            f"{share} lies between the places of the runs along {self.along}, and more runs do not "
            f"close it. Give runs with finer places along {self.along}, {itself}."
        )

    def cautions(self, surrogate: Surrogate) -> list[Caution]:
        """Return what the noise does not hide."""
        out = []
        if self.left_open > MAX_LEFT_OPEN:
            out.append(
                f"At the measured rows the runs leave the simulation open by {self.left_open:.1f} "
                f"times the noise: effects that are not larger cannot be detected. {self.remedy}"
            )
        if self.missed > MAX_MISSED:
            out.append(
                f"At the measured rows {type(surrogate).__name__}, trained on the runs alone, "
                f"misses the simulation by {self.missed:.1f} times the noise. The search does "
                f"without it, but what is predicted rests on it: {advice_on_runs(surrogate)}."
            )
        return [Caution("runs", sentence) for sentence in out]


def check_emulator(result: Search, surrogate: Basis, runs: SimulationData) -> EmulatorCheck | None:
    """Return how well the surrogate's basis predicts the simulation at the best fit of all.

    None where the simulation itself is run, or its emulator has no uncertainty.
    """
    problem = result.problem
    if not problem.model.basis.leaves_open:
        return None
    w = result.candidates[int(np.argmax(result.probability))]
    values = w.fit.values
    U = w.fit.model.emulator_error(problem.X, values, result.context.emulator.factor)
    outputs, _, noise = w.fit.model.simulated(problem.X, values, result.context.emulator.mean)
    own = emulator_posterior(surrogate, problem.simulation).mean
    alone = replace(w.fit.model, basis=surrogate, reference=own)
    missed = alone.simulated(problem.X, values, own)[0] - outputs
    # outputs, rows and counts have separate noise: of counts sigma is one
    unit = noise[0]
    left_open = np.sum(U**2, axis=1) / unit**2
    inputs, points = w.fit.model.places(problem.X, values)
    basis = problem.model.basis
    error = np.sum(basis.error(inputs, points) ** 2, axis=1)
    # causes that respond to the output stretch all alike
    parts = basis.scatter(inputs, points), basis.between(inputs), basis.unrepeated(inputs)
    each = np.array(parts)
    scatter, between, near = left_open * np.minimum(each**2 / np.maximum(error, 1e-300), 1.0)
    squares = left_open - scatter, (missed / unit) ** 2, between, scatter, near
    rms = np.sqrt([np.mean(each) for each in squares]) / w.fit.sigma
    X = problem.X[:, : runs.X.shape[1]]
    low, high = runs.X.min(axis=0), runs.X.max(axis=0)
    outside = np.sum((low > X) | (high < X), axis=0).tolist()
    beyond = {name: k for name, k in zip(runs.input_names, outside, strict=True) if k}
    of_runs = basis.of_runs(np.arange(float(inputs.shape[1]))[None])[0]
    names = [name for k, name in enumerate(runs.input_names) if k not in of_runs]
    along = [name for name in names if name != OUTPUT]
    rounding = None
    if problem.likelihood.means_as_runs and is_whole(runs.y):
        errors = problem.likelihood.rounding(outputs[0])
        rounding = float(np.sqrt(np.mean((errors / unit) ** 2)))
    left_open, missed, between, scatter, near = rms.tolist()
    curves = " and ".join(along) or None
    return EmulatorCheck(left_open, missed, beyond, between, scatter, curves, rounding, near)


def cautions_of_failures(runs: object, posterior: Posterior, X: FloatArray) -> list[Caution]:
    """Return a caution where most runs at the measured rows would fail, over the posterior."""
    if not isinstance(runs, SimulationData) or not len(runs.failed):
        return []
    some = posterior.thinned()
    places = some.model.places(X[:, : len(some.model.columns)], some.values)
    share = float(np.mean(Failures.of(runs).probability(np.hstack(places))))
    if share < SETTINGS.majority:
        return []
    return [
        Caution(
            "runs",
            f"Where the data put the parameters, a run fails with probability {share:.0%}: "
            f"{len(runs.failed)} runs of the simulation did. There the emulator extrapolates from "
            "the runs that did not. Find out why they fail, or whether a prior allows what cannot "
            "be.",
        )
    ]


def warn_if_rough(problem: Problem) -> None:
    """Warn the caller of ``fit`` where the simulation jumps by much of the noise.

    Jumps are measured by second differences over the longest step around the best fit that is
    known: of independent jumps these have six times the variance.
    """
    model = problem.model
    if model.least_step < LONGEST_STEP:
        return
    ahead, behind = np.swapaxes(around(model, problem.X, problem.good, LONGEST_STEP), 0, 1)
    best = output(model, problem.X, problem.good)
    with np.errstate(invalid="ignore", over="ignore"):
        second = ahead + behind - 2 * best[:, None]
    second = second[np.isfinite(second)]
    # a simulation that fails all around its best fit has no jumps to speak of
    jump = float(np.sqrt(np.sum(second**2) / max(6 * second.size, 1)))
    noise = float(np.std(problem.y - best[0]))
    if not jump > SETTINGS.jump_share * noise:
        return
    warnings.warn(
        f"The simulation is rough: its output jumps by about {number(jump, 2)} where parameters "
        "change by a tenth of a standard deviation of their priors, and what it misses is "
        f"{number(noise, 2)}. "
        "Is the output rounded, is a solver's tolerance loose, or does it draw random numbers? "
        "Effects of this size get lost. A smoother output helps, or runs of it: "
        "simulator.run(200) with surrogate=PolynomialChaos() averages over jumps.",
        DiagnosisWarning,
        stacklevel=4,
    )
