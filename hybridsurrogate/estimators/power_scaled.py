"""Power scaling: one surrogate, two likelihoods raised to powers; Kennedy and O'Hagan's form."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats
from sklearn.base import clone
from sklearn.utils import check_random_state
from sklearn.utils.validation import check_is_fitted

from hybridsurrogate.effects.base import Cause, Context, check_arguments
from hybridsurrogate.effects.output.processes import GaussianProcessDiscrepancy
from hybridsurrogate.effects.wrapped import InOutput
from hybridsurrogate.estimators.base import SurrogateEstimator
from hybridsurrogate.inference.loo import PointwiseLoo
from hybridsurrogate.inference.procedure import Fit, fit_problem
from hybridsurrogate.inference.sampling.ensembles import EnsembleSampler
from hybridsurrogate.likelihoods import Likelihood
from hybridsurrogate.model.posterior import Posterior, with_prior_only
from hybridsurrogate.model.problem import PlainProblem, Problem, plain_problem
from hybridsurrogate.model.rows.measured_data import MeasuredData
from hybridsurrogate.model.statistics import powers_of
from hybridsurrogate.prediction.leave_one_out import loo_of_fit
from hybridsurrogate.priors import frozen
from hybridsurrogate.simulation.simulator import SimulationData, Simulator
from hybridsurrogate.surrogates.basis import Surrogate
from hybridsurrogate.types import FloatArray, Prior


class PowerScaledSurrogate(SurrogateEstimator):
    """Surrogate trained on simulation runs and measured data by power-scaled likelihoods.

    Step 1 infers the surrogate's coefficients from both sources, their likelihoods raised to the
    powers that ``beta`` sets. Step 2 infers the unknown parameters, the noise and the causes anew
    for each draw of the coefficients, from their original priors and the measured data
    (Reiser, Buerkner and Guthke, arXiv 2412.11875, sections 2.2 and 2.3).

    Parameters
    ----------
    simulation : SimulationData, Simulator or None, default=None
        Runs of the simulation, or the simulation itself. None: train on measured data alone.
    surrogate : Surrogate or None, default=None
        None: ``PolynomialChaos()`` of runs. A simulation is called directly where it takes less
        than a millisecond for one set of parameters. Otherwise ``fit`` makes runs of it for
        ``Kriging()``. `ExactSurrogate` calls it in any case.
    beta : float or callable, default=0.5
        Weight of the simulation: 0 = measured data only, 1 = simulation only. A callable
        ``beta(X) -> (n,)`` of the simulation's inputs varies the weight between them.
    likelihood : {"normal", "lognormal", "student-t", "negative-binomial", "poisson"} or Likelihood
        Default "normal".
    noise_prior : frozen scipy.stats distribution or None, default=None
        Prior of sigma. None: half-normal with the spread of the measured output as scale. Of
        several outputs sigma is the noise of the first, and their unit is the standard deviation
        of each one's measurements; the others' noise is inferred relative to the first.
    effects : sequence of Cause, default=()
        Causes by which measured rows differ from the simulation.
    experiment : str or None, default=None
        The measured column that holds each row's experiment: a batch, a subject, a sensor. In a
        DataFrame it may hold names. It is never an axis.
    by_experiment : mapping of parameter to {"shared", "own", "spread"} or None, default=None
        Parameters of the simulation that differ between experiments. "own": values that are
        independent of each other. "spread": values normally distributed around their mean, with
        the spread inferred (`ParameterByExperiment`). Predictions for an experiment that was not
        measured draw its value from the same distribution. The name of an output, with "spread":
        rows of one experiment share an error (`SharedErrors`).
    noise : {"added", "scaled", "known"}, default="added"
        What is inferred of the noise of rows with errors ``y_err``. "added": further noise, of the
        same standard deviation in each row, added in quadrature (jitter); its prior is
        ``noise_prior``. "scaled": a factor on all errors; sigma is the noise of a row with the
        median error. "known": nothing. Runs scatter like a row with the median error.
    sampler : {"auto", "importance", "emcee"} or EnsembleSampler, default="auto"
        "auto": importance sampling, emcee where its k-hat exceeds 0.7 or there are several modes.
    n_draws : int, default=1000
        Draws from the posterior.
    random_state : int, RandomState or None, default=None

    Attributes
    ----------
    measured_ : (ndarray of shape (n, n_columns), ndarray of shape (n,))
        The measured rows of the fit, as checked.
    surrogate_, likelihood_ : Surrogate, Likelihood
        Those used.
    posterior_ : Posterior
        Draws after step 2, from which predictions are made.
    first_step_ : Posterior
        Draws after step 1.
    diagnostics_ : Diagnostics
        Sampler used, k-hat, effective draws, autocorrelation time.
    emulation_ : Emulation or None
        The emulator of a slow simulation: the ``runs`` that ``fit`` made, ``seconds`` that one set
        of parameters takes, and ``left_open``, the emulator's standard deviation in standard
        deviations of the noise. None where the simulation is called directly, or runs were given.
    n_features_in_, feature_names_in_
        As everywhere in scikit-learn.

    Raises
    ------
    ValueError, TypeError
        In ``fit``, when parameters or data are not usable; the message says what to do.

    Warns
    -----
    SamplingWarning
        When the draws are unreliable.
    ExtrapolationWarning
        When measured inputs lie outside the simulated range.
    EmulationWarning
        When ``fit`` emulates a simulation that is slow to run.

    Examples
    --------
    >>> import hybridsurrogate as hs
    >>> from hybridsurrogate.datasets import make_log_sin
    >>> case = make_log_sin(random_state=0)
    >>> model = hs.PowerScaledSurrogate(
    ...     case.simulation, surrogate=hs.PolynomialChaos(degree=5), beta=0.5, random_state=0)
    >>> model.fit(case.X, case.y).predict(case.X_in).shape
    (100,)
    >>> model.diagnostics_.sampler
    'importance'
    """

    def __init__(
        self,
        simulation: SimulationData | Simulator | None = None,
        surrogate: Surrogate | None = None,
        beta: float | Callable[[FloatArray], ArrayLike] = 0.5,
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
        self.simulation = simulation
        self.surrogate = surrogate
        self.beta = beta
        self.likelihood = likelihood
        self.noise_prior = noise_prior
        self.effects = effects
        self.experiment = experiment
        self.by_experiment = by_experiment
        self.noise = noise
        self.sampler = sampler
        self.n_draws = n_draws
        self.random_state = random_state

    def fit_data(self, data: MeasuredData) -> PowerScaledSurrogate:
        """Fit to data that `checked_data` returned.

        Parameters
        ----------
        data : MeasuredData

        Returns
        -------
        self
        """
        task = FitTask.of(self, data)
        fit = task.draw(check_random_state(self.random_state))
        fit.diagnostics.warn()
        return self._keep(task, fit)

    def _keep(self, task: FitTask, fit: Fit) -> PowerScaledSurrogate:
        """Store the results of a fit."""
        self._store(task.data)
        self.plain_, self.inference_ = task.plain, fit
        self.surrogate_, self.likelihood_ = task.surrogate, task.likelihood
        prior_only = [effect for effect in as_causes(self.effects) if not effect.is_learned]
        self.posterior_ = with_prior_only(fit.second, fit.problem, prior_only)
        self.first_step_ = fit.first
        self.diagnostics_ = fit.diagnostics
        return self

    def with_prior_only(self, effects: Sequence[Cause]) -> PowerScaledSurrogate:
        """Return the fitted estimator with further effects, drawn from their priors alone.

        Parameters
        ----------
        effects : sequence of Cause
            Such as `Remainder`. A cause that measured rows inform needs another fit.
        """
        check_is_fitted(self)
        out = copy.copy(self)
        out.effects = (*as_causes(self.effects), *effects)
        out.posterior_ = with_prior_only(self.posterior_, self.inference_.problem, effects)
        return out

    def _run_weights(self, data: MeasuredData) -> FloatArray | None:
        """Return powers of the likelihoods of single runs, None where all are the same."""
        if callable(self.beta) and isinstance(data.simulation, SimulationData):
            return powers_of(self._beta_at(self.beta, data.simulation.X))[0]
        return None

    def _powers(self, X: FloatArray) -> tuple[float, float | FloatArray]:
        """Return `FitTask.powers` at distinct measured rows X (n, n_columns)."""
        if not callable(self.beta):
            return powers_of(float(self.beta))
        return 1.0, powers_of(self._beta_at(self.beta, X))[1]

    def _learned_effects(self, data: MeasuredData) -> tuple[Cause, ...]:
        """Return the effects that rows inform: the user's, then what differs by experiment."""
        learned = (effect for effect in as_causes(self.effects) if effect.is_learned)
        return (*learned, *data.experiments.effects())

    def _pointwise_loo(self, progress: bool = False) -> PointwiseLoo:
        random = check_random_state(self.random_state)
        return loo_of_fit(self.inference_, self.data_, self.sampler, random, progress)

    def _mixture(self, X: FloatArray | None = None) -> list[tuple[Any, Posterior]]:
        return [(1.0, self.posterior_)]

    def _learned(self, X: FloatArray | None = None) -> list[tuple[Any, Posterior]]:
        return [(1.0, self.inference_.second)]


@dataclass(frozen=True, eq=False)
class FitTask:
    """Measured data and the problem that an estimator is fitted to, for one fit or many.

    Attributes
    ----------
    estimator : PowerScaledSurrogate
        With the settings of the fit; it stays as it is.
    surrogate, likelihood : Surrogate, Likelihood
        Those used.
    data : MeasuredData
    plain : PlainProblem
        Of these data.
    problem : Problem
        The same with the estimator's effects.
    """

    estimator: PowerScaledSurrogate
    surrogate: Surrogate
    likelihood: Likelihood
    data: MeasuredData
    plain: PlainProblem
    problem: Problem

    @classmethod
    def of(cls, estimator: PowerScaledSurrogate, data: MeasuredData) -> FitTask:
        """Return the task of an estimator and data that its `checked_data` returned."""
        surrogate, likelihood = estimator.checked_settings()
        data = data.leaving_out(as_causes(estimator.effects))
        settings = surrogate, likelihood, estimator.noise_prior
        plain = plain_problem(data, *settings, run_weights=estimator._run_weights(data))
        problem = plain.with_effects(estimator._learned_effects(data))
        return cls(estimator, surrogate, likelihood, data, plain, problem)

    @classmethod
    def of_fitted(cls, estimator: PowerScaledSurrogate) -> FitTask:
        """Return the task that an estimator was fitted to."""
        used = estimator.surrogate_, estimator.likelihood_, estimator.data_, estimator.plain_
        return cls(clone(estimator), *used, estimator.inference_.problem)

    @property
    def powers(self) -> tuple[float, float | FloatArray]:
        """alpha_S and alpha_R; a weight that changes with x is in the rows' powers."""
        return self.estimator._powers(self.data.distinct.X)

    def with_effects(self, effects: Sequence[Cause]) -> FitTask:
        """Return the task of other effects; the data are as they are, but for rows left out."""
        task = self.with_settings(effects=effects)
        data = task.data.leaving_out(as_causes(effects))
        if data is not self.data:
            return FitTask.of(task.estimator, data)
        problem = self.plain.with_effects(task.estimator._learned_effects(data))
        return replace(task, problem=problem)

    def with_settings(self, **settings: Any) -> FitTask:
        """Return the task with other settings of the draws, or a number as weight beta."""
        estimator = copy.copy(self.estimator)
        # `set_params` looks the signatures up, and `clone` each parameter: 8 % of folds of 40 rows
        estimator.__dict__.update(settings)
        return replace(self, estimator=estimator)

    def random_state(self) -> np.random.RandomState:
        """Return what a fit draws from: the same for each."""
        return check_random_state(copy.deepcopy(self.estimator.random_state))

    def draw(self, random_state: np.random.RandomState) -> Fit:
        """Return draws of both steps."""
        one = self.estimator
        return fit_problem(self.problem, self.powers, one.sampler, int(one.n_draws), random_state)

    def fit(self) -> PowerScaledSurrogate:
        """Return a fitted estimator."""
        fit = self.draw(self.random_state())
        fit.diagnostics.warn()
        return self.fitted_by(fit)

    def fitted_by(self, fit: Fit) -> PowerScaledSurrogate:
        """Return an estimator fitted by draws from elsewhere."""
        return copy.copy(self.estimator)._keep(self, fit)


def prepared(
    estimator: PowerScaledSurrogate,
    X: ArrayLike,
    y: ArrayLike,
    sample_weight: ArrayLike | None = None,
    y_err: Any = None,
) -> FitTask:
    """Return what an estimator is fitted to, checked and built once for many fits.

    A simulation that is slow to run is called as it is.

    Parameters
    ----------
    estimator : PowerScaledSurrogate
    X, y, sample_weight, y_err
        As in ``fit``.
    """
    return FitTask.of(estimator, estimator.checked_data(X, y, sample_weight, y_err))


def as_causes(effects: Any, argument: str = "effects") -> tuple[Cause, ...]:
    """Return effects as a tuple of causes; raise TypeError when they are something else."""
    try:
        causes = tuple(effects)
    except TypeError:  # one cause, or its class
        causes = (None,)
    if not all(isinstance(cause, Cause) for cause in causes):
        raise TypeError(
            f"{argument} must be a sequence of causes such as [Trend('t'), Offset()], "
            f"got {effects!r}."
        )
    for cause in causes:
        check_arguments(cause)
    return causes


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
        usual = frozen(stats.halfnorm, scale=context.scale)
        return super().prepare(context).filled(amplitude=self.amplitude or usual)
