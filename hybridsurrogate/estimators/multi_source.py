"""More than two sources: several simulations and measured sets, each with its own power."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from sklearn.utils.validation import check_array, check_consistent_length, check_X_y

from hybridsurrogate.arguments import described
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.estimators.power_scaled import PowerScaledSurrogate
from hybridsurrogate.exceptions import did_you_mean
from hybridsurrogate.inference.sampling.ensembles import EnsembleSampler
from hybridsurrogate.likelihoods import Likelihood, as_likelihood
from hybridsurrogate.model.rows.columns import (
    column_names,
    matched_columns,
)
from hybridsurrogate.model.rows.measured_data import (
    MeasuredData,
    SingleRows,
    check_errors,
    taken_out,
    without_gaps,
)
from hybridsurrogate.model.rows.stacking import as_several
from hybridsurrogate.simulation.arrays import (
    as_numbers,
    check_number,
    check_size,
    complete_table,
)
from hybridsurrogate.simulation.simulator import SimulationData, Simulator
from hybridsurrogate.simulation.variables import priors_of
from hybridsurrogate.surrogates.basis import Surrogate
from hybridsurrogate.types import FloatArray, Prior

# priors are distinguished by their quantiles at these shares
_SHARES = np.linspace(0.01, 0.99, 9)


@dataclass(frozen=True, eq=False)
class Source:
    """A source of training rows and the power of its likelihood.

    Parameters
    ----------
    data : SimulationData, or (X, y)
        Runs of a simulation, or a further set of measured rows with the columns of the first: by
        name (DataFrame), else in the same order.
    power : float, default=1.0
        Between 0 (ignored) and 1 (in full).
    y_err : float, str, array-like of the shape of y, or None, default=None
        Known errors of measured rows, as in ``fit``: of all measured sets, or of none.

    Examples
    --------
    >>> import hybridsurrogate as hs
    >>> hs.Source(([[0.0], [1.0]], [2.0, 3.0]), power=0.3).power
    0.3
    """

    data: SimulationData | tuple[ArrayLike, ArrayLike]
    power: float = 1.0
    y_err: Any = None

    def __sklearn_clone__(self) -> Source:
        """Return itself: it is a value, and clones share its data."""
        return self


class MultiSourceSurrogate(PowerScaledSurrogate):
    """Power scaling with any number of simulations and measured sets.

    The likelihood of each source is raised to its power. Simulations share the surrogate, so they
    must have the same inputs, priors and assumed values, as a coarse and a fine one have. One
    simulation with power alpha_S and the measured data with power alpha_R are
    `PowerScaledSurrogate` with the beta that belongs to these. In step 2 the weights of measured
    sets are their powers relative to the largest.

    Parameters
    ----------
    sources : sequence of Source, default=()
        Simulations, and measured sets beyond the one that ``fit`` gets.
    power : float, default=1.0
        Power of the measured rows in ``fit``.
    surrogate, likelihood, noise_prior, effects, experiment, by_experiment
        As in `PowerScaledSurrogate`.
    noise, sampler, n_draws, random_state
        As in `PowerScaledSurrogate`.

    Examples
    --------
    >>> import hybridsurrogate as hs
    >>> from hybridsurrogate.datasets import make_log_sin
    >>> case, other = make_log_sin(random_state=0), make_log_sin(random_state=1)
    >>> model = hs.MultiSourceSurrogate(
    ...     [hs.Source(case.simulation, 0.5), hs.Source((other.X, other.y), 0.3)], random_state=0)
    >>> model.fit(case.X, case.y).predict(case.X_in).shape
    (100,)
    """

    beta = 0.5  # powers take its place

    def __init__(
        self,
        sources: Sequence[Source] = (),
        power: float = 1.0,
        surrogate: Surrogate | None = None,
        likelihood: str | Likelihood = "normal",
        noise_prior: Prior | None = None,
        effects: Sequence[Cause] = (),
        experiment: str | None = None,
        by_experiment: Mapping[str, str] | None = None,
        noise: str = "added",
        sampler: str | EnsembleSampler = "auto",
        n_draws: int = 1000,
        random_state: Any = None,
    ):
        self.sources = sources
        self.power = power
        self.surrogate = surrogate
        self.likelihood = likelihood
        self.noise_prior = noise_prior
        self.effects = effects
        self.experiment = experiment
        self.by_experiment = by_experiment
        self.noise = noise
        self.sampler = sampler
        self.n_draws = n_draws
        self.random_state = random_state

    @property
    def simulation(self) -> SimulationData | None:  # type: ignore[override]
        """All runs together, None without any."""
        return _merged([source.data for source in self._simulations()])

    def _simulations(self) -> list[Source]:
        return [source for source in self.sources if isinstance(source.data, SimulationData)]

    def checked_settings(self) -> tuple[Surrogate, Likelihood]:
        """Return surrogate and likelihood; raise where a parameter is not usable."""
        if isinstance(self.sources, Source):
            raise TypeError("sources must be a sequence: write [Source(...)] for one source.")
        if not isinstance(self.sources, list | tuple):
            raise TypeError(
                "sources must be a list of Source objects such as [Source(simulation)], got "
                f"{described(self.sources)}."
            )
        for source in self.sources:
            if not isinstance(source, Source):
                raise TypeError(
                    "sources must hold Source objects such as Source(simulation, power=0.5), got "
                    f"{described(source)}."
                )
            if isinstance(source.data, Simulator):
                raise TypeError(
                    "A source holds runs: write Source(simulator.run(200), ...) instead of "
                    "Source(simulator, ...)."
                )
            pair = isinstance(source.data, list | tuple) and len(source.data) == 2
            if not pair and not isinstance(source.data, SimulationData):
                raise TypeError(
                    "The data of a source must be SimulationData or a pair (X, y) of measured "
                    f"rows, got {described(source.data)}."
                )
            check_number(source.power, "the power of a source", Real, min_val=0, max_val=1)
        check_number(self.power, "power", Real, min_val=0, max_val=1)
        if not any(source.power > 0 for source in self.sources) and not self.power:
            raise ValueError("The powers of all sources are zero: there is nothing to train on.")
        return super().checked_settings()

    def _run_weights(self, data: MeasuredData) -> FloatArray | None:
        powers = []
        for source in self._simulations():
            assert isinstance(source.data, SimulationData)
            # of several outputs one row for each that a run has
            powers.append(np.full(int(np.isfinite(source.data.y).sum()), float(source.power)))
        return np.concatenate(powers) if powers else None

    def _further_tables(self) -> Sequence[Any]:
        tables = [
            taken_out(source.data[0], source.y_err)[0]
            for source in self.sources
            if not isinstance(source.data, SimulationData)
        ]
        return [complete_table(X, labels=self.experiment) for X in tables]

    def _further_sets(
        self, data: MeasuredData
    ) -> tuple[float, Sequence[tuple[SingleRows, FloatArray | None]]]:
        """Return rows of all further sets, weights relative to the largest power."""
        # measured rows that count nowhere in step 1 still carry step 2
        top, sets = self._largest_power(), []
        for source in self.sources:
            if not isinstance(source.data, SimulationData):
                rows, values, scatter = self._read(source, data)
                weights = np.full(len(rows), source.power / top if top else 1.0)
                sets.append((SingleRows(rows, values, weights), scatter))
        return self.power / top if top else 1.0, sets

    def _read(
        self, source: Source, data: MeasuredData
    ) -> tuple[FloatArray, FloatArray, FloatArray | None]:
        """Return a measured source, columns in the order of those in ``fit``, and its errors.

        Errors are on the scale of eta.
        """
        if (source.y_err is None) != (data.errors is None):
            raise ValueError(
                "Either all measured sets have errors or none has: pass y_err to fit and to each "
                "Source of measured rows."
            )
        assert not isinstance(source.data, SimulationData)
        X, y_err = taken_out(source.data[0], source.y_err)
        X, y, _, y_err = without_gaps(X, source.data[1], None, y_err)
        X = data.experiments.numbered(complete_table(X, labels=self.experiment))
        # an array has the columns of the X in ``fit``
        order, names = data.order, column_names(X)
        columns = data.given_columns
        if data.stacking is None:
            more, values = check_X_y(X, as_numbers(y, "y"), dtype=np.float64)
        else:
            more = check_array(X, dtype=np.float64)
            values = as_several(y, data.stacking.names)
            check_consistent_length(more, values)
        check_size(more, "X")
        check_size(values, "y")
        if more.shape[1] != data.X.shape[1]:
            raise ValueError(
                f"A measured source must have X of shape (n, {data.X.shape[1]}), got {more.shape}."
            )
        if names and data.names is not None:
            missing = [name for name in columns if name not in names]
            if missing:
                raise ValueError(
                    f"A measured source lacks the columns {missing} of the X in fit; its columns "
                    f"are {names}.{did_you_mean(missing, names)}"
                )
            order = [names.index(name) for name in columns]
        elif names:
            order = matched_columns(names, len(names), self.simulation)[1]
        scatter = None
        if y_err is not None:
            likelihood = as_likelihood(self.likelihood)
            errors = check_errors(y_err, values, likelihood, self.output_names(values))
            scatter = likelihood.scatter(errors, values)
        return more[:, order], values, scatter

    def _largest_power(self) -> float:
        further = [s.power for s in self.sources if not isinstance(s.data, SimulationData)]
        return float(max([self.power, *further]))

    def _powers(self, X: FloatArray) -> tuple[float, float | FloatArray]:
        return 1.0, self._largest_power()


def _merged(runs: Sequence[Any]) -> SimulationData | None:
    """Return one set of runs from several that share inputs and parameters."""
    if not runs:
        return None
    first = runs[0]
    if len(runs) == 1:
        return first
    for other in runs[1:]:
        _check_alike(first, other)
    ranges = {
        name: (
            min(r.input_ranges[name][0] for r in runs),
            max(r.input_ranges[name][1] for r in runs),
        )
        for name in first.input_names
    }
    kept = ("X", "omega", "y", "failed")
    X, omega, y, failed = (np.concatenate([getattr(r, k) for r in runs]) for k in kept)
    labels = None
    if any(r.run is not None for r in runs):
        own = [np.arange(r.n_rows) if r.run is None else r.run - r.run.min() for r in runs]
        before = np.cumsum([0, *(one.max() + 1 for one in own)])
        labels = np.concatenate([one + start for one, start in zip(own, before, strict=False)])
    return first.with_data(X, omega, y, labels, inputs=ranges, simulator=None, failed=failed)


def _check_alike(first: SimulationData, other: SimulationData) -> None:
    """Raise ValueError for simulations whose runs do not mean the same."""
    alike = ["input_names", "parameter_names", "assumed_names"]
    # a single output may have any name
    alike += ["outputs"] * (max(len(first.outputs), len(other.outputs)) > 1)
    for what in alike:
        if getattr(other, what) != getattr(first, what):
            raise ValueError(
                "All simulations must have the same inputs, parameters and assumed constants; "
                f"{what} are {getattr(first, what)} and {getattr(other, what)}."
            )
    for name, constant in first.assumed.items():
        if other.assumed[name].value != constant.value:
            raise ValueError(
                f"The assumed value of {name!r} is {constant.value!r} in one and "
                f"{other.assumed[name].value!r} in another simulation: give all the same value, "
                f"or make {name!r} a parameter."
            )
    theirs = priors_of(other.parameters, other.assumed)
    for name, prior in priors_of(first.parameters, first.assumed).items():
        # one distribution may be written in several ways
        ours, its = prior.ppf(_SHARES), theirs[name].ppf(_SHARES)
        if not np.allclose(ours, its, rtol=1e-6, atol=1e-6 * float(np.ptp(ours))):
            raise ValueError(
                f"The prior of {name!r} differs between the simulations: give all the same prior."
            )
