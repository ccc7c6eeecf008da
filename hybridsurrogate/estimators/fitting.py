"""From checked data to a posterior: both steps of the procedure, no state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from hybridsurrogate.effects.base import Cause, Context
from hybridsurrogate.inference.collapsed import (
    CollapsedPosterior,
    Statistics,
    powers_of,
    statistics,
)
from hybridsurrogate.inference.ensemble import ensemble_draws
from hybridsurrogate.inference.importance import KHAT_LIMIT, find_modes, importance_draws
from hybridsurrogate.inference.measured import MeasuredModel
from hybridsurrogate.inference.starts import starting_points
from hybridsurrogate.inference.two_step import second_step
from hybridsurrogate.likelihoods import Likelihood
from hybridsurrogate.posterior import Diagnostics, Posterior
from hybridsurrogate.priors import FloatArray, Prior
from hybridsurrogate.simulation import SimulationData, Simulator
from hybridsurrogate.surrogates.base import Domain, Surrogate

# proposals of the importance sampler: three for each draw that is kept
_OVERSAMPLING = 3
# from this share of the best one's mass on, a further mode makes the posterior multimodal
_MODE_SHARE = 0.02
# a mode with less than this share gets no proposals of its own
_PROPOSAL_SHARE = 1e-5


@dataclass(frozen=True)
class Problem:
    """Everything a fit needs, checked.

    Attributes
    ----------
    model : MeasuredModel
    X, y : ndarray of shape (n, n_columns), (n,)
        Measured rows, y on the scale of eta.
    likelihood : Likelihood
    simulation : Statistics or None
    noise_prior : prior of sigma
    scale : float
        Spread of the measured output on the scale of eta.
    """

    model: MeasuredModel
    X: FloatArray
    y: FloatArray
    likelihood: Likelihood
    simulation: Statistics | None
    noise_prior: Prior
    scale: float


@dataclass(frozen=True)
class Fit:
    """A fitted posterior: the draws of both steps and their diagnostics."""

    first: Posterior
    second: Posterior
    diagnostics: Diagnostics


def spread(values: FloatArray) -> float:
    """Return the standard deviation, or the size, or one: a scale that is never zero."""
    sd = float(np.std(values))
    size = float(np.max(np.abs(values), initial=0.0))
    if sd > 1e-10 * size:
        return sd
    return size or 1.0


def make_problem(
    simulation: SimulationData | Simulator | None,
    surrogate: Surrogate,
    likelihood: Likelihood,
    noise_prior: Prior | None,
    effects: tuple[Cause, ...],
    columns: tuple[str, ...],
    X: FloatArray,
    y: FloatArray,
    measured_only: bool = False,
) -> Problem:
    """Wire surrogate, causes and priors; compute the statistics of the simulation runs once.

    With ``measured_only`` the simulation lends its input ranges and nothing else.
    """
    eta = likelihood.transform(y)
    scale = spread(eta)
    runs = simulation if isinstance(simulation, SimulationData) and not measured_only else None
    run_eta = None
    if runs is not None:
        likelihood.check(runs.y, "simulated")
        run_eta = likelihood.transform(runs.y)
    outputs = eta if run_eta is None else run_eta
    n_inputs = len(simulation.input_names) if simulation is not None else X.shape[1]
    world = None if measured_only else simulation
    domain = Domain(
        _ranges_of_inputs(simulation, X[:, :n_inputs]),
        np.array(list(world.parameter_ranges.values()) if world else []).reshape(-1, 2),
        float(np.mean(outputs)),
        spread(outputs),
        _callable(world, likelihood),
    )
    context = make_context(world, columns, n_inputs, X, scale, likelihood)
    basis = surrogate.build(domain)
    if isinstance(world, Simulator) and len(basis.coefficient_mean):
        raise ValueError(
            f"{type(surrogate).__name__} is trained on runs, but simulation is a Simulator that "
            "has not been run: pass simulator.run(100), or surrogate=ExactSurrogate()."
        )
    model = MeasuredModel(
        basis,
        columns,
        n_inputs,
        dict(world.parameters) if world else {},
        {name: c.value for name, c in world.assumed.items()} if world else {},
        tuple(effect.prepare(context) for effect in effects),
        3 * scale,
    )
    model.check_effects(X)
    run_statistics = None
    if runs is not None and run_eta is not None and len(basis.coefficient_mean):
        known = basis.known(runs.X, runs.omega)
        run_statistics = statistics(
            basis.features(runs.X, runs.omega), run_eta - known, domain.scale
        )
    prior = noise_prior if noise_prior is not None else stats.halfnorm(scale=scale)
    return Problem(model, X, eta, likelihood, run_statistics, prior, scale)


def make_context(
    simulation: SimulationData | Simulator | None,
    columns: tuple[str, ...],
    n_inputs: int,
    X: FloatArray,
    scale: float,
    likelihood: Likelihood,
) -> Context:
    """Return what causes may know about the measured rows."""
    return Context(
        dict(zip(columns, X.T, strict=True)),
        n_inputs,
        dict(simulation.parameters) if simulation else {},
        dict(simulation.assumed) if simulation else {},
        scale,
        log_scale=likelihood.log_scale,
    )


def _ranges_of_inputs(
    simulation: SimulationData | Simulator | None, inputs: FloatArray
) -> FloatArray:
    if simulation is not None:
        return np.array(list(simulation.input_ranges.values()), dtype=float)
    low, high = inputs.min(axis=0), inputs.max(axis=0)
    return np.column_stack([low, np.where(high > low, high, low + 1.0)])


class _Transformed:
    """The simulation on the scale of eta; a class so that it can be pickled."""

    def __init__(self, simulator: Simulator, likelihood: Likelihood):
        self.simulator, self.likelihood = simulator, likelihood

    def __call__(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        # parameters far in the tails may break a simulation: NaN there means impossible
        with np.errstate(all="ignore"):
            return self.likelihood.transform(self.simulator(X, omega))


def _callable(
    simulation: SimulationData | Simulator | None, likelihood: Likelihood
) -> _Transformed | None:
    if simulation is None or simulation.simulator is None:
        return None
    return _Transformed(simulation.simulator, likelihood)


def fit_problem(
    problem: Problem,
    beta: float,
    sampler: str,
    n_draws: int,
    random_state: np.random.RandomState,
) -> Fit:
    """Run both steps and return draws with diagnostics."""
    model = problem.model
    emulated = problem.simulation is not None
    simulation_power, measured_power = powers_of(beta) if emulated else (0.0, 1.0)
    target = CollapsedPosterior(
        model,
        problem.X,
        problem.y,
        problem.simulation,
        simulation_power,
        measured_power,
        problem.noise_prior,
        problem.scale,
    )
    u, diagnostics = _first_draws(target, sampler, n_draws, random_state)
    c, a = target.draw_coefficients(u, random_state)

    def posterior(z: FloatArray, sigma: FloatArray, effect_coefficients: FloatArray) -> Posterior:
        return Posterior(model, problem.likelihood, model.values(z), sigma, c, effect_coefficients)

    first = posterior(u[:, :-1], np.exp(u[:, -1]), a)
    if not emulated:
        # measured rows alone were used, at full power: step 2 would repeat step 1
        return Fit(first, first, diagnostics)
    drawn = second_step(
        model,
        problem.X,
        problem.y,
        c,
        problem.noise_prior,
        problem.scale,
        u,
        random_state,
    )
    second = posterior(drawn.z, drawn.sigma, drawn.coefficients)
    kind = "grid" if np.isnan(drawn.effective_draws) else "importance"
    return Fit(
        first,
        second,
        Diagnostics(
            diagnostics.sampler,
            diagnostics.khat,
            diagnostics.effective_draws,
            diagnostics.autocorrelation_time,
            diagnostics.n_modes,
            kind,
            np.nan if kind == "grid" else drawn.khat,
            drawn.effective_draws,
        ),
    )


def _first_draws(
    target: CollapsedPosterior,
    sampler: str,
    n_draws: int,
    random_state: np.random.RandomState,
) -> tuple[FloatArray, Diagnostics]:
    modes = find_modes(target.log_density, starting_points(target, random_state))
    best = modes[0].log_mass
    minor = [mode for mode in modes if mode.log_mass > best + np.log(_PROPOSAL_SHARE)]
    modes = [mode for mode in modes if mode.log_mass > best + np.log(_MODE_SHARE)]
    equilibrium = None
    if sampler != "emcee":
        sampled = importance_draws(
            target.log_density, minor, _OVERSAMPLING * n_draws, n_draws, random_state
        )
        trusted = sampled.khat <= KHAT_LIMIT
        if sampler == "importance" or (trusted and len(modes) == 1):
            return sampled.draws, Diagnostics(
                "importance", sampled.khat, sampled.effective_draws, np.nan, len(modes)
            )
        equilibrium = sampled.draws if trusted else None
    run = ensemble_draws(target.log_density, modes, n_draws, random_state, equilibrium)
    return run.draws, Diagnostics(
        "emcee", np.nan, run.effective_draws, run.autocorrelation_time, len(modes)
    )
