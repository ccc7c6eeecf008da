"""Predictive weighting: two surrogates, their predictions mixed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from sklearn.utils import check_random_state

from hybridsurrogate.estimators.base import SurrogateEstimator
from hybridsurrogate.inference.loo import PointwiseLoo, stacking_weights
from hybridsurrogate.inference.procedure import Fit, fit_problem
from hybridsurrogate.inference.sampling.ensembles import EnsembleSampler
from hybridsurrogate.likelihoods import Likelihood
from hybridsurrogate.model.posterior import Diagnostics, Posterior
from hybridsurrogate.model.problem import plain_problem
from hybridsurrogate.model.rows.measured_data import MeasuredData
from hybridsurrogate.prediction.leave_one_out import loo_of_fit, loo_of_mixture
from hybridsurrogate.prediction.variables import MixturePart
from hybridsurrogate.simulation.simulator import SimulationData, Simulator
from hybridsurrogate.surrogates.basis import Surrogate
from hybridsurrogate.types import FloatArray, Prior


class PredictiveWeightedSurrogate(SurrogateEstimator):
    """Mixture of a surrogate of the simulation and one of the measured data.

    The predictive density is ``beta p_S + (1 - beta) p_R``, mixed exactly: p_S comes from a
    surrogate trained on the simulation and calibrated to the measured data, p_R from a surrogate
    of the known inputs alone, trained on the measured data (Reiser, Buerkner and Guthke,
    arXiv 2412.11875, section 2.4).

    Parameters
    ----------
    simulation : SimulationData, Simulator or None, default=None
        None: the measured data alone, whatever ``beta``.
    surrogate : Surrogate or None, default=None
        Family of both surrogates (the second is a `PolynomialChaos` where the first is exact).
        None: as in `PowerScaledSurrogate`.
    beta : float, callable or "stacking", default=0.5
        Weight of the simulation. A callable ``beta(X) -> (n,)`` of the simulation's inputs varies
        the weight between them. "stacking": the weight with the best leave-one-out predictions of
        the measured rows (Yao, Vehtari, Simpson and Gelman 2018, Bayesian Analysis 13:917).
    likelihood : {"normal", "lognormal", "student-t", "negative-binomial", "poisson"} or Likelihood
        Default "normal".
    noise_prior : frozen scipy.stats distribution or None, default=None
    experiment, by_experiment
        As in `PowerScaledSurrogate`, for the surrogate of the simulation. That of the measured data
        has no parameters of the simulation, and is the same for all experiments.
    noise : {"added", "scaled", "known"}, default="added"
        What is inferred of the noise of rows with errors ``y_err``. "added": further noise, of the
        same standard deviation in each row, added in quadrature (jitter); its prior is
        ``noise_prior``. "scaled": a factor on all errors; sigma is the noise of a row with the
        median error. "known": nothing. Runs scatter like a row with the median error.
    sampler : {"auto", "importance", "emcee"} or EnsembleSampler, default="auto"
    n_draws : int, default=1000
        Draws from each of the two posteriors.
    random_state : int, RandomState or None, default=None

    Attributes
    ----------
    measured_ : (ndarray of shape (n, n_columns), ndarray of shape (n,))
        The measured rows of the fit, as checked.
    simulation_posterior_, measured_posterior_ : Posterior
        Draws of the two surrogates; the first is None without a simulation.
    beta_ : float or callable
        The weight used: ``beta``, or the result of stacking.
    diagnostics_ : dict of str to Diagnostics
        For "simulation" and "measured".

    Examples
    --------
    >>> import hybridsurrogate as hs
    >>> from hybridsurrogate.datasets import make_log_sin
    >>> case = make_log_sin(random_state=0)
    >>> model = hs.PredictiveWeightedSurrogate(
    ...     case.simulation, surrogate=hs.PolynomialChaos(degree=5), beta=0.3, random_state=0)
    >>> model.fit(case.X, case.y).sample_posterior_predictive(case.X_in, n_draws=50).shape
    (50, 100)
    """

    def __init__(
        self,
        simulation: SimulationData | Simulator | None = None,
        surrogate: Surrogate | None = None,
        beta: float | str | Callable[[FloatArray], ArrayLike] = 0.5,
        likelihood: str | Likelihood = "normal",
        noise_prior: Prior | None = None,
        experiment: str | None = None,
        by_experiment: Mapping[str, str] | None = None,
        noise: str = "added",
        sampler: str | EnsembleSampler = "auto",
        n_draws: int = 1000,
        random_state: Any = None,
    ):
        self.simulation = simulation
        self.surrogate = surrogate
        self.beta = beta
        self.likelihood = likelihood
        self.noise_prior = noise_prior
        self.experiment = experiment
        self.by_experiment = by_experiment
        self.noise = noise
        self.sampler = sampler
        self.n_draws = n_draws
        self.random_state = random_state

    def fit_data(self, data: MeasuredData) -> PredictiveWeightedSurrogate:
        """Fit both surrogates to data that `checked_data` returned.

        Parameters
        ----------
        data : MeasuredData

        Returns
        -------
        self
        """
        surrogate, likelihood = self.checked_settings()
        random, powers, fits = check_random_state(self.random_state), (1.0, 0.0), {}
        for source in ("measured",) if self.simulation is None else ("measured", "simulation"):
            alone = source == "measured"
            family = surrogate.of_measured_data() if alone else surrogate
            plain = plain_problem(data, family, likelihood, self.noise_prior, measured_only=alone)
            problem = plain.with_effects(() if alone else data.experiments.effects())
            fits[source] = fit_problem(problem, powers, self.sampler, int(self.n_draws), random)
        beta = self._stacked(fits, data, random) if self.beta == "stacking" else self.beta
        for fit in fits.values():
            fit.diagnostics.warn()
        self._store(data)
        self.inference_ = fits
        self.measured_posterior_ = fits["measured"].second
        self.simulation_posterior_ = fits["simulation"].second if len(fits) > 1 else None
        self.diagnostics_ = {source: fit.diagnostics for source, fit in fits.items()}
        self.beta_: Any = beta
        return self

    def _check_beta(self) -> None:
        if isinstance(self.beta, str):
            if self.beta != "stacking":
                raise ValueError(
                    f'beta must lie between 0 and 1, be callable or "stacking", got {self.beta!r}.'
                )
            return
        super()._check_beta()

    def _stacked(
        self, fits: dict[str, Fit], data: MeasuredData, random: np.random.RandomState
    ) -> float:
        """Return the weight of the simulation whose leave-one-out predictions are the best."""
        if "simulation" not in fits:
            return 0.0
        inside = data.distinct.origin >= 0
        loos = [loo_of_fit(fit, data, self.sampler, random) for fit in fits.values()]
        densities = np.column_stack([loo.log_density[inside] for loo in loos])
        _, simulation = stacking_weights(densities, data.single.weights[inside])
        return float(simulation)

    def _pointwise_loo(self, progress: bool = False) -> PointwiseLoo:
        random = check_random_state(self.random_state)
        parts = {
            source: loo_of_fit(fit, self.data_, self.sampler, random, progress)
            for source, fit in self.inference_.items()
        }
        if "simulation" not in parts:
            return parts["measured"]
        weight = self._weight(self.data_.single.X)
        return loo_of_mixture([parts["simulation"], parts["measured"]], [weight, 1.0 - weight])

    def _weight(self, X: FloatArray) -> Any:
        """Return the weight of the simulation: a number, or (n,) at rows X."""
        return self._beta_at(self.beta_, X) if callable(self.beta_) else float(self.beta_)

    def _mixture(self, X: FloatArray | None = None) -> list[tuple[Any, Posterior]]:
        if self.simulation_posterior_ is None:
            return [(1.0, self.measured_posterior_)]
        weight = self._weight(self.data_.single.X if X is None else X)
        weight = weight if X is not None else float(np.mean(weight))
        pairs = [(weight, self.simulation_posterior_), (1.0 - weight, self.measured_posterior_)]
        return [pair for pair in pairs if np.max(pair[0]) > 0]

    def _parts(self) -> list[MixturePart]:
        source = {id(fit.second): name for name, fit in self.inference_.items()}
        parts = []
        for weight, posterior in self._mixture():
            name = source[id(posterior)]
            prior = self.inference_[name].problem.noise_prior
            parts.append(MixturePart(float(weight), posterior, self.diagnostics_[name], prior))
        return parts

    def _draws(self) -> list[tuple[str, Any, Posterior, Diagnostics]]:
        beta = self.beta_ if self.simulation_posterior_ is not None else 0.0
        weights: dict[str, float | None] = {"measured": None, "simulation": None}
        if not callable(beta):
            weights = {"measured": 1.0 - float(beta), "simulation": float(beta)}
        return [
            (source, weights[source], fit.second, self.diagnostics_[source])
            for source, fit in self.inference_.items()
        ]
