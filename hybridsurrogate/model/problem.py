"""From checked data to a problem that can be fitted: surrogate, causes and priors wired up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from hybridsurrogate.effects.base import Cause, Context
from hybridsurrogate.effects.noise.known_errors import Jitter, RowErrors
from hybridsurrogate.effects.noise.noise import OutputNoise
from hybridsurrogate.effects.wrapped import prepared_for
from hybridsurrogate.exceptions import did_you_mean
from hybridsurrogate.likelihoods import Likelihood
from hybridsurrogate.model.context import (
    at_medians,
    check_effects,
    least_step,
    make_context,
    mismatch,
    of_each_output,
    with_slopes,
)
from hybridsurrogate.model.observation import MeasuredModel, TransformedSimulation, WorkingPoint
from hybridsurrogate.model.rows.columns import Experiments
from hybridsurrogate.model.rows.measured_data import MeasuredData, SimulatedRows
from hybridsurrogate.model.rows.stacking import Stacking
from hybridsurrogate.model.statistics import (
    Statistics,
    emulator_posterior,
    statistics,
    statistics_of_runs,
)
from hybridsurrogate.numerics.linear_algebra import LARGE_BLOCK, blocks
from hybridsurrogate.simulation.simulator import SimulationData, Simulator
from hybridsurrogate.surrogates.basis import Basis, Domain, Surrogate
from hybridsurrogate.surrogates.families.stacked import built_for_each
from hybridsurrogate.types import FloatArray, Prior

# beyond the first number of coefficients there may be no more than the second for each row of runs:
# the time of a fit grows with the square of their number, 8 CPU seconds for 496
_MANY_COEFFICIENTS, _MAX_A_ROW, _MAX_COEFFICIENTS = 1000, 10, 2000


@dataclass(frozen=True)
class Problem:
    """Everything a fit needs, checked.

    Attributes
    ----------
    model : MeasuredModel
    X, y, weights : ndarray of shape (n, n_columns), (n,), (n,)
        Measured rows, y on the scale of eta, and their weights.
    observed : ndarray of shape (n,)
        y as measured.
    likelihood : Likelihood
    simulation : Statistics or None
        Of the runs, on the scale of eta; None when there is no surrogate to train.
    runs : SimulatedRows or None
        The runs themselves.
    noise_prior : prior of sigma
    scale : float
        Spread of the measured output on the scale of eta.
    reach : float
        Size of an effect that may be needed to get from the simulation to what was measured.
    good : ndarray of shape (k, n_parameters)
        Parameters, as standard normal z, that are known to fit well.
    working_point : WorkingPoint or None
        In a search over a likelihood that is not normal: where its rows are expanded. ``y`` is then
        their working response, and the last column of ``X`` their noise.
    stacking : Stacking or None
        Of several outputs: how their rows are laid out.
    """

    model: MeasuredModel
    X: FloatArray
    y: FloatArray
    weights: FloatArray
    observed: FloatArray
    likelihood: Likelihood
    simulation: Statistics | None
    runs: SimulatedRows | None
    noise_prior: Prior
    scale: float
    reach: float = 0.0
    good: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    working_point: WorkingPoint | None = None
    stacking: Stacking | None = None

    def __repr__(self) -> str:
        causes = ", ".join(effect.kind for effect in self.model.effects) or "none"
        return (
            f"Problem({len(self.y)} rows, columns: {', '.join(self.model.columns)}; "
            f"parameters: {', '.join(self.model.parameters) or 'none'}; causes: {causes})"
        )

    @property
    def noise_is_known(self) -> bool:
        """Whether rows have the noise that they carry, and no scale of it is inferred."""
        errors = self.model.errors
        if errors is not None and errors.fixes_sigma:
            return True
        return self.working_point is not None and not self.likelihood.scales_noise

    def possible_sigma(self, sigma: FloatArray | float) -> FloatArray:
        """Return estimates of sigma as far as it is unknown: no less than known errors leave."""
        errors = self.model.errors
        if self.noise_is_known:
            return np.full(np.shape(sigma), 1.0 if errors is None else errors.unit)
        return np.maximum(sigma, 0.0 if errors is None else errors.least_sigma)

    @property
    def unit_noise(self) -> float:
        """Typical noise of a row where sigma is one; of rows with weights that of weight one."""
        if not self.model.has_row_noise or self.working_point is None:
            return 1.0
        return float(np.exp(np.mean(np.log(self.X[:, -1]))))

    @property
    def collapses(self) -> bool:
        """Whether the coefficients are Gaussian given everything else."""
        linear = not self.model.basis.known_depends_on_hyper
        return linear and not self.model.acts_on("outliers") and self.likelihood.gaussian

    def with_noise(self, X: FloatArray) -> FloatArray:
        """Return rows of the user's with the typical noise of the measured ones, if rows carry it.

        Rows that carry it already stay as they are.
        """
        if X.shape[1] == self.X.shape[1]:
            return X
        errors, columns = self.model.errors, [X]
        if errors is not None:
            rows = dict(zip(self.model.columns, X.T, strict=False))
            columns.append(errors.of_rows(rows, len(X)))
        # of no measurement: independent of all others
        columns += [np.full(len(X), np.nan)] * len(self.model.carried)
        if self.model.has_row_noise:
            columns.append(np.full(len(X), self.unit_noise))
        return np.column_stack(columns)

    def as_places(self, X: FloatArray) -> FloatArray:
        """Return rows of the problem as places of measurements that are yet to be made."""
        X = X.copy()
        X[:, [self.model.names.index(name) for name in self.model.carried]] = np.nan
        return X

    def given(self, hyper: FloatArray) -> Problem:
        """Return the problem with the surrogate's hyperparameters fixed at values (n_hyper,)."""
        if not self.model.n_hyper:
            return self
        basis = self.model.basis.given(hyper)
        simulation = None
        if self.runs is not None and len(basis.coefficient_mean):
            X, omega = self.runs.X, self.runs.omega
            eta = self.likelihood.working_runs(self.runs.y)
            scale = spread(eta - basis.known(X, omega))
            simulation = statistics_of_runs(basis, X, omega, eta, scale, self.runs.weights)
        model = replace(self.model, basis=basis, reference=None)
        return replace(self, model=model, simulation=simulation)


def spread(values: FloatArray, weights: FloatArray | None = None) -> float:
    """Return the standard deviation, or the size, or one: a scale that is never zero."""
    if weights is None:
        sd = float(np.std(values))
    else:
        mean = np.average(values, weights=weights)
        sd = float(np.sqrt(np.average((values - mean) ** 2, weights=weights)))
    size = max(float(np.max(values, initial=0.0)), -float(np.min(values, initial=0.0)))
    # a constant has the rounding error of its mean as sd
    if sd > 1e-14 * size:
        return sd
    return size or 1.0


@dataclass(frozen=True, eq=False)
class PlainProblem:
    """A problem without causes, and what it takes to add some: built once for many sets of them.

    Attributes
    ----------
    problem : Problem
    simulation : SimulationData, Simulator or None
        That causes may use.
    domain : Domain
        Of the surrogate.
    noise_prior : frozen distribution or None
        As the user gave it.
    run_weights : ndarray or None
        Powers of the likelihoods of single runs.
    experiments : Experiments
    """

    problem: Problem
    simulation: SimulationData | Simulator | None
    domain: Domain
    noise_prior: Prior | None
    run_weights: FloatArray | None
    experiments: Experiments

    def with_effects(self, effects: Sequence[Cause]) -> Problem:
        """Return the problem with causes, prepared and checked."""
        plain = self.problem
        effects = (*effects, *self._noise_of_rows())
        model = plain.model.with_effects([prepared_for(one, self._context) for one in effects])
        try:
            check_effects(model, plain.X)
        except KeyError as error:
            there = [*model.columns, *model.parameters, *model.constants]
            name = error.args[0] if error.args else ""
            raise ValueError(
                f"A cause needs {error}; there are {there}.{did_you_mean(name, there)}"
            ) from error
        _check_likelihood(model, plain.likelihood)
        if model.noise_follows or model.acts_on("response"):
            model = replace(model, reference=self._reference)
        return replace(plain, model=model)

    def _noise_of_rows(self) -> tuple[Cause, ...]:
        """Return what is inferred of the noise in addition to sigma, whatever else is."""
        plain, stacking = self.problem, self.problem.stacking
        errors, names = plain.model.errors, () if stacking is None else stacking.names
        if errors is not None and errors.kind == "added":
            return (Jitter(errors, self.jitter_prior, names),)
        is_known = errors is not None and errors.kind == "known"
        if stacking is None or is_known or not plain.likelihood.scales_noise:
            return ()
        return (OutputNoise(names),)

    @property
    def jitter_prior(self) -> Prior:
        """Prior of noise in addition to known errors."""
        return self.noise_prior or self.problem.likelihood.noise_prior(self.problem.scale)

    def on_rows(self, X: FloatArray, y: FloatArray, weights: FloatArray) -> PlainProblem:
        """Return the same of rows of the same measurements, laid out otherwise."""
        plain = self.problem
        given = plain.likelihood, self.noise_prior, plain.stacking, plain.model.errors
        eta, scale, prior = _measured(*given, X, y, weights)
        problem = replace(
            plain,
            model=replace(plain.model, default_sd=3 * scale),
            X=X,
            y=eta,
            weights=weights,
            observed=y,
            noise_prior=prior,
            scale=scale,
        )
        return replace(self, problem=problem)

    @cached_property
    def _context(self) -> Context:
        """What causes may use."""
        return self.context_of(self.problem, self._reference, at_medians(self.problem.model))

    @cached_property
    def _reference(self) -> FloatArray:
        """Coefficients (p,) estimated from the rows that train the surrogate, at full power."""
        basis, domain, weights = self.problem.model.basis, self.domain, self.run_weights
        if not len(basis.coefficient_mean):
            return basis.coefficient_mean
        hyper = np.array([prior.median() for prior in basis.hyperpriors.values()])
        given = basis.given(hyper)
        centred = domain.eta - given.known(domain.X, domain.omega)
        features = given.features(domain.X, domain.omega)
        weights = weights if weights is not None and len(weights) == len(centred) else None
        mean = emulator_posterior(given, statistics(features, centred, domain.scale, weights)).mean
        factor = basis.factor(hyper[None]) if len(hyper) else None
        return mean if factor is None else basis.coefficient_mean + factor[0] @ mean

    def context_of(self, problem: Problem, c: FloatArray, values: FloatArray) -> Context:
        """Return what causes may use of a problem of the same simulation.

        Parameters
        ----------
        problem : Problem
        c : ndarray of shape (p,)
            Coefficients of the surrogate.
        values : ndarray of shape (1, n_unknowns)
            Unknowns at which slopes are taken.
        """
        model, likelihood, stacking = problem.model, problem.likelihood, problem.stacking
        rows = problem.as_places(problem.X), c, problem.y, problem.weights
        context = make_context(
            self.simulation,
            model.columns,
            model.n_inputs,
            problem.X,
            problem.scale,
            likelihood,
            model.basis,
            float(np.average(problem.y, weights=problem.weights)),
            mismatch(model, *rows),
            of_each_output(model, *rows, stacking, likelihood),
            self.experiments,
        )
        if stacking is not None:
            return context
        return with_slopes(context, model, problem.X, c, values)


def plain_problem(
    data: MeasuredData,
    surrogate: Surrogate,
    likelihood: Likelihood,
    noise_prior: Prior | None,
    measured_only: bool = False,
    run_weights: FloatArray | None = None,
) -> PlainProblem:
    """Wire surrogate and priors to distinct rows; compute the statistics of the runs once.

    With ``measured_only`` the simulation lends its input ranges and nothing else. Weights are
    powers of the likelihoods of single rows and runs. Of several outputs the rows are stacked, and
    the noise of each is a part of the model.
    """
    simulation, stacking, columns = data.simulation, data.stacking, data.columns
    X, y, weights, _ = data.distinct
    eta, scale, prior = _measured(likelihood, noise_prior, stacking, data.errors, X, y, weights)
    world = None if measured_only else simulation
    runs = world if isinstance(world, SimulationData) else None
    run_eta, refused = (None, None) if runs is None else _working(likelihood, runs.y)
    outputs, shares = (eta, weights) if run_eta is None else (run_eta, None)
    n_inputs = len(simulation.input_names) if simulation is not None else len(columns)
    ranges = dict(world.parameter_ranges) if world else {}
    simulator = world.simulator if world else None
    middle = np.mean(list(ranges.values()) or np.empty((0, 2)), axis=1)
    domain = Domain(
        _ranges_of_inputs(simulation, X[:, :n_inputs]),
        np.array(list(ranges.values())).reshape(-1, 2),
        float(np.average(outputs, weights=shares)),
        spread(outputs, shares),
        None if simulator is None else TransformedSimulation(simulator, likelihood),
        X[:, :n_inputs] if runs is None else runs.X,
        np.tile(middle, (len(X), 1)) if runs is None else runs.omega,
        outputs,
        columns[:n_inputs],
        tuple(ranges),
    )
    basis = _trained(surrogate, domain, stacking, simulation, world)
    if refused is not None and not basis.holds_runs:
        raise refused
    if runs is not None:
        _check_size(basis, runs.n_rows)
    model = MeasuredModel(
        columns,
        n_inputs,
        dict(world.parameters) if world else {},
        {name: c.value for name, c in world.assumed.items()} if world else {},
        (),
        3 * scale,
        basis,
        errors=data.errors,
        carried=data.carried_names,
    )
    model = replace(model, least_step=least_step(model, X))
    kept, run_statistics = None, None
    if runs is not None and run_eta is not None and _learns(basis) and not basis.holds_runs:
        ones = np.broadcast_to(1.0, runs.y.shape)  # takes no memory
        kept = SimulatedRows(
            runs.y, ones if run_weights is None else run_weights, runs.X, runs.omega
        )
        if not basis.known_depends_on_hyper:
            run_statistics = statistics_of_runs(
                basis, runs.X, runs.omega, run_eta, domain.scale, run_weights
            )
    problem = Problem(
        model,
        X,
        eta,
        weights,
        y,
        likelihood,
        run_statistics,
        kept,
        prior,
        scale,
        stacking=stacking,
    )
    return PlainProblem(problem, world, domain, noise_prior, run_weights, data.experiments)


def _measured(
    likelihood: Likelihood,
    noise_prior: Prior | None,
    stacking: Stacking | None,
    errors: RowErrors | None,
    X: FloatArray,
    y: FloatArray,
    weights: FloatArray,
) -> tuple[FloatArray, float, Prior]:
    """Return y on the scale of eta, its spread, and the prior of sigma."""
    eta = likelihood.working(y)
    within = eta.copy()
    if stacking is not None:
        for k in range(len(stacking.names)):  # several outputs have no level in common
            here = X[:, stacking.at] == k
            within[here] -= np.average(eta[here], weights=weights[here])
    scale = spread(within, weights)
    prior = likelihood.noise_prior(scale) if noise_prior is None else noise_prior
    return eta, scale, prior if errors is None else errors.noise_prior(prior, noise_prior is None)


def _learns(basis: Basis) -> bool:
    return bool(len(basis.coefficient_mean) or basis.hyperpriors)


def _trained(
    surrogate: Surrogate,
    domain: Domain,
    stacking: Stacking | None,
    simulation: SimulationData | Simulator | None,
    world: SimulationData | Simulator | None,
) -> Basis:
    """Return the surrogate on its domain; raise ValueError for one that cannot be trained there."""
    name = type(surrogate).__name__
    try:
        if stacking is None:
            basis = surrogate.build(domain)
        else:
            basis = built_for_each(surrogate, domain, stacking.names)
        if not isinstance(basis, Basis):
            raise TypeError(f"{name}.build must return a Basis, got {basis!r}.")
        _check_basis(basis, domain)
    except (IndexError, ValueError) as error:
        # rows of a simulation have all that it gives; the hint is for those without
        if world is not None or (simulation is None and isinstance(error, ValueError)):
            raise
        raise ValueError(
            f"{name} cannot be trained on measured data alone, where omega has "
            f"no columns ({error}). If it needs parameters, override of_measured_data to return a "
            "surrogate without, such as PolynomialChaos(), for predictive weighting."
        ) from error
    if isinstance(world, Simulator) and _learns(basis):
        raise ValueError(
            f"{name} is trained on runs, but simulation is a Simulator that "
            "has not been run: pass simulator.run(100), or surrogate=ExactSurrogate()."
        )
    return basis


def _working(likelihood: Likelihood, y: FloatArray) -> tuple[FloatArray, ValueError | None]:
    """Return simulated outputs on the scale of eta, and why they cannot be draws of y.

    An emulator that interpolates them needs no likelihood of them.
    """
    try:
        likelihood.check_training(y, "simulated")
    except ValueError as error:
        with np.errstate(invalid="ignore", divide="ignore"):
            eta = likelihood.link(y)
        if not np.isfinite(eta).all():
            raise
        return eta, error
    return likelihood.working_runs(y), None


def _check_likelihood(model: MeasuredModel, likelihood: Likelihood) -> None:
    """Raise ValueError for causes that need another likelihood."""
    if model.correlated and model.acts_on("outliers"):
        raise ValueError(
            "Correlated errors of several outputs are normal, and outliers are not: leave out "
            "Outliers, or give y_err as standard deviations without OutputCorrelation."
        )
    if len(model.carried) > 2 and model.output_correlation:
        raise ValueError(
            "The covariances in y_err have the correlations already: leave out OutputCorrelation, "
            "or give y_err as standard deviations."
        )
    if model.acts_on("outliers") and not likelihood.gaussian:
        raise ValueError(
            "Outliers need a normal or log-normal likelihood for the other rows, not a "
            f"{likelihood.name} one."
        )
    if model.acts_on("overdispersion") and likelihood.overdispersed(np.zeros((1, 1))) is None:
        raise ValueError(
            "Overdispersion is a scatter beyond that of a Poisson likelihood, or of a binomial one "
            f"of several trials; a {likelihood.name} one already has a scale, or no such form."
        )


def _check_basis(basis: Basis, domain: Domain) -> None:
    """Raise ValueError, by name, for a surrogate whose arrays do not fit its training rows."""
    p, name = len(basis.coefficient_mean), type(basis).__name__.lstrip("_")
    if len(basis.coefficient_sd) != p or not (basis.coefficient_sd > 0).all():
        raise ValueError(f"{name} needs a positive prior sd for each of its {p} coefficients.")
    has_known = not basis.known_depends_on_hyper and not basis.is_simulation
    # some rows at a time: there may be millions, on disk
    for some in blocks(len(domain.X), 3 * (1 + p), LARGE_BLOCK):
        X, omega = domain.X[some], domain.omega[some]
        if has_known:
            _check_shape(f"{name}.known", np.asarray(basis.known(X, omega)), (len(X),))
        _check_shape(f"{name}.features", np.asarray(basis.features(X, omega)), (len(X), p))


def _check_shape(what: str, values: FloatArray, shape: tuple[int, ...]) -> None:
    if values.shape != shape:
        raise ValueError(
            f"{what} must return shape {shape} for {shape[0]} rows of inputs and parameters, got "
            f"{values.shape}."
        )
    if not np.isfinite(values).all():
        raise ValueError(f"{what} returned NaN or infinity on the training rows.")


def _ranges_of_inputs(
    simulation: SimulationData | Simulator | None, inputs: FloatArray
) -> FloatArray:
    if simulation is not None:
        return np.array(list(simulation.input_ranges.values()), dtype=float)
    low, high = inputs.min(axis=0), inputs.max(axis=0)
    return np.column_stack([low, np.where(high > low, high, low + 1.0)])


def _check_size(basis: Basis, n_rows: int) -> None:
    """Raise ValueError for far too many coefficients, before a fit that hangs."""
    n = len(basis.coefficient_mean)
    if n > max(_MANY_COEFFICIENTS, _MAX_A_ROW * n_rows):
        raise ValueError(
            f"The surrogate has {n} coefficients, more than {_MAX_A_ROW} for each of the {n_rows} "
            "rows of the runs: choose a lower degree, sparse=True, or Kriging()."
        )
    if n > _MAX_COEFFICIENTS:
        raise ValueError(
            f"The surrogate has {n} coefficients, of which {_MAX_COEFFICIENTS} are the most that "
            "can be inferred together: choose a lower degree, sparse=True, or Kriging()."
        )
