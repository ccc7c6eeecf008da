"""More than two sources: several simulations and measured sets, each with its own power."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from sklearn.utils import check_scalar

from hybridsurrogate.effects.base import Cause
from hybridsurrogate.estimators.fitting import Fit
from hybridsurrogate.estimators.power_scaled import PowerScaledSurrogate, as_causes
from hybridsurrogate.estimators.problem import Problem, make_problem
from hybridsurrogate.estimators.rows import MeasuredRows, merged_rows
from hybridsurrogate.inference.ensemble import EnsembleSampler
from hybridsurrogate.likelihoods import Likelihood
from hybridsurrogate.priors import FloatArray, Prior
from hybridsurrogate.simulation import SimulationData
from hybridsurrogate.surrogates.base import Surrogate


@dataclass(frozen=True, eq=False)
class Source:
    """A source of training rows and the power of its likelihood.

    Parameters
    ----------
    data : SimulationData, or (X, y)
        Runs of a simulation, or a further set of measured rows with the columns of the first.
    power : float, default=1.0
        Between 0 (ignored) and 1 (in full).
    """

    data: SimulationData | tuple[ArrayLike, ArrayLike]
    power: float = 1.0


class MultiSourceSurrogate(PowerScaledSurrogate):
    """Power scaling with any number of simulations and measured sets.

    The likelihood of each source is raised to its own power; simulations share the surrogate, so
    they must have the same inputs and parameters (a coarse and a fine one, say). One simulation
    with power alpha_S and the measured data with power alpha_R are `PowerScaledSurrogate` with the
    beta that belongs to these. Step 2 weighs measured sets by their powers relative to the largest.

    Parameters
    ----------
    sources : sequence of Source, default=()
        Simulations, and measured sets beyond the one that ``fit`` gets.
    power : float, default=1.0
        Power of the measured rows in ``fit``.
    surrogate, likelihood, noise_prior, effects, sampler, n_draws, random_state
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
        self.sampler = sampler
        self.n_draws = n_draws
        self.random_state = random_state

    @property
    def simulation(self) -> SimulationData | None:  # type: ignore[override]
        """All runs together, None without any."""
        return _merged([source.data for source in self._simulations()])

    def _simulations(self) -> list[Source]:
        return [source for source in self.sources if isinstance(source.data, SimulationData)]

    def _check_parameters(self) -> tuple[Surrogate, Likelihood]:
        for source in self.sources:
            if not isinstance(source, Source):
                raise TypeError(
                    "sources must hold Source objects such as Source(simulation, power=0.5), got "
                    f"{source!r}."
                )
            check_scalar(source.power, "the power of a source", Real, min_val=0, max_val=1)
        check_scalar(self.power, "power", Real, min_val=0, max_val=1)
        if not any(source.power > 0 for source in self.sources) and not self.power:
            raise ValueError("The powers of all sources are zero: there is nothing to train on.")
        return super()._check_parameters()

    def _problem(self, surrogate: Surrogate, likelihood: Likelihood, rows: MeasuredRows) -> Problem:
        runs = self._simulations()
        powers = [np.full(source.data.n_runs, float(source.power)) for source in runs]  # type: ignore[union-attr]
        measured = self._all_measured(likelihood, rows)
        return make_problem(
            self.simulation,
            surrogate,
            likelihood,
            self.noise_prior,
            as_causes(self.effects),
            measured.columns,
            measured.X,
            measured.y,
            weights=measured.weights,
            run_weights=np.concatenate(powers) if powers else None,
        )

    def _all_measured(self, likelihood: Likelihood, rows: MeasuredRows) -> MeasuredRows:
        """Return the rows of all measured sets, weighed relative to the largest power."""
        top = self._largest_power()
        X, y, weights = [rows.X], [rows.y], [rows.weights * (self.power / top)]
        for source in self.sources:
            if isinstance(source.data, SimulationData):
                continue
            more = np.atleast_2d(np.asarray(source.data[0], dtype=float))
            values = np.asarray(source.data[1], dtype=float)
            if more.shape != (len(values), self.n_features_in_):
                raise ValueError(
                    f"A measured source must have X of shape (n, {self.n_features_in_}) and y of "
                    f"shape (n,), got {more.shape} and {values.shape}."
                )
            likelihood.check(values)
            X.append(more[:, self._column_order])
            y.append(values)
            weights.append(np.full(len(values), source.power / top))
        return merged_rows(
            rows.columns, np.concatenate(X), np.concatenate(y), np.concatenate(weights)
        )

    def _keep(self, rows: MeasuredRows, problem: Problem, fit: Fit) -> PowerScaledSurrogate:
        """Store what a fit found; rows of all sets were merged, those in ``fit`` are among them."""
        table = np.column_stack([problem.X, problem.observed])
        wanted = np.column_stack(self._measured)
        same = (wanted[:, None] == table).all(axis=2)
        origin = np.where(same.any(axis=1), same.argmax(axis=1), -1)
        merged = MeasuredRows(rows.columns, problem.X, problem.observed, problem.weights, origin)
        return super()._keep(merged, problem, fit)

    def _largest_power(self) -> float:
        further = [s.power for s in self.sources if not isinstance(s.data, SimulationData)]
        # measured rows that count nowhere in step 1 still carry step 2
        return float(max([self.power, *further])) or 1.0

    def _powers(self, X: FloatArray) -> tuple[float, float | FloatArray]:
        return 1.0, self._largest_power() if self._any_measured_power() else 0.0

    def _any_measured_power(self) -> bool:
        further = [s.power for s in self.sources if not isinstance(s.data, SimulationData)]
        return max([self.power, *further]) > 0


def _merged(runs: Sequence[Any]) -> SimulationData | None:
    """Return one set of runs from several that share inputs and parameters."""
    if not runs:
        return None
    first = runs[0]
    if len(runs) == 1:
        return first
    for other in runs[1:]:
        for what in ("input_names", "parameter_names", "assumed_names"):
            if getattr(other, what) != getattr(first, what):
                raise ValueError(
                    "All simulations must have the same inputs, parameters and assumed constants; "
                    f"{what} are {getattr(first, what)} and {getattr(other, what)}."
                )
    ranges = {
        name: (
            min(r.input_ranges[name][0] for r in runs),
            max(r.input_ranges[name][1] for r in runs),
        )
        for name in first.input_names
    }
    return SimulationData(
        np.concatenate([r.X for r in runs]),
        np.concatenate([r.omega for r in runs]),
        np.concatenate([r.y for r in runs]),
        inputs=ranges,
        parameters=first.parameters,
        assumed=first.assumed,
        output=first.output,
    )
