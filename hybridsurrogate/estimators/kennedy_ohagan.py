"""Kennedy and O'Hagan's calibration: the simulation plus a discrepancy process."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from scipy import stats

from hybridsurrogate.effects.base import Cause, Context
from hybridsurrogate.effects.in_output import InOutput
from hybridsurrogate.effects.output.discrepancy_process import GaussianProcessDiscrepancy
from hybridsurrogate.estimators.power_scaled import PowerScaledSurrogate
from hybridsurrogate.inference.sampling.emcee_sampler import EnsembleSampler
from hybridsurrogate.likelihoods import Likelihood
from hybridsurrogate.priors import frozen
from hybridsurrogate.simulation.simulator import SimulationData, Simulator
from hybridsurrogate.surrogates.base import Surrogate
from hybridsurrogate.types import Prior


class KennedyOHaganSurrogate(PowerScaledSurrogate):
    """Calibration with a Gaussian-process discrepancy (Kennedy and O'Hagan 2001).

    ``y = surrogate(x, omega) + delta(x) + noise``, the surrogate trained on the simulation alone:
    `PowerScaledSurrogate` at beta = 1 with `GaussianProcessDiscrepancy` as its only effect
    (Journal of the Royal Statistical Society B 63:425; modular, as in Bayarri et al. 2007,
    Technometrics 49:138).

    Parameters
    ----------
    simulation : SimulationData, Simulator or None, default=None
    surrogate : Surrogate or None, default=None
    likelihood : str or Likelihood, default="normal"
    noise_prior : frozen scipy.stats distribution or None, default=None
    length_scale_prior : frozen scipy.stats distribution or None, default=None
        Of the discrepancy, on inputs whose simulated range is scaled to [-1, 1]. None: inverse
        gamma (5, 5) (arXiv 2412.11875, appendix).
    amplitude_prior : frozen scipy.stats distribution or None, default=None
        Of the discrepancy's standard deviation. None: half-normal with the spread of the
        measured output as scale (the paper's is half-normal(1), on the scale of eta).
    experiment, by_experiment, noise, sampler, n_draws, random_state
        As in `PowerScaledSurrogate`.

    Examples
    --------
    >>> import hybridsurrogate as hs
    >>> from hybridsurrogate.datasets import make_log_sin
    >>> case = make_log_sin(random_state=0)
    >>> model = hs.KennedyOHaganSurrogate(
    ...     case.simulation, surrogate=hs.PolynomialChaos(degree=5), random_state=0)
    >>> sorted(model.fit(case.X, case.y).posterior_.estimates(0))
    ['amplitude', 'length_scale']
    """

    def __init__(
        self,
        simulation: SimulationData | Simulator | None = None,
        surrogate: Surrogate | None = None,
        likelihood: str | Likelihood = "normal",
        noise_prior: Prior | None = None,
        length_scale_prior: Prior | None = None,
        amplitude_prior: Prior | None = None,
        experiment: str | None = None,
        by_experiment: Mapping[str, str] | None = None,
        noise: str = "added",
        sampler: str | EnsembleSampler = "auto",
        n_draws: int = 1000,
        random_state: Any = None,
    ):
        self.simulation = simulation
        self.surrogate = surrogate
        self.likelihood = likelihood
        self.noise_prior = noise_prior
        self.length_scale_prior = length_scale_prior
        self.amplitude_prior = amplitude_prior
        self.experiment = experiment
        self.by_experiment = by_experiment
        self.noise = noise
        self.sampler = sampler
        self.n_draws = n_draws
        self.random_state = random_state

    # what the parent takes as parameters is fixed here
    beta = 1.0

    @property
    def effects(self) -> tuple[Cause, ...]:  # type: ignore[override]
        """The discrepancy process, on the simulated range of the inputs; one for each output."""
        ranges = None if self.simulation is None else dict(self.simulation.input_ranges)
        length, amplitude = self.length_scale_prior, self.amplitude_prior
        process = _Discrepancy(
            ranges,
            frozen(stats.invgamma, 5.0, scale=5.0) if length is None else length,
            amplitude,
        )
        names = () if self.simulation is None else self.simulation.outputs
        return tuple(InOutput(process, name) for name in names) if len(names) > 1 else (process,)


class _Discrepancy(GaussianProcessDiscrepancy):
    """The process with an amplitude that is always inferred."""

    def prepare(self, context: Context) -> Cause:
        """Fill in the prior of the amplitude, too."""
        prepared = super().prepare(context)
        if self.amplitude is None:
            prepared.amplitude = frozen(stats.halfnorm, scale=context.scale)
        return prepared
