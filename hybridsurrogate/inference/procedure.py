"""From a problem to a posterior: both steps of the procedure, no state."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from hybridsurrogate.inference.conditional.pairwise_squares import MeasuredGiven
from hybridsurrogate.inference.conditional.sampler import (
    MeasuredDraws,
    conditional_draws,
    moved_step,
    second_step,
)
from hybridsurrogate.inference.conjugate.collapsed import CollapsedPosterior
from hybridsurrogate.inference.conjugate.target import PowerScaledPosterior
from hybridsurrogate.inference.laplace import LaplacePosterior
from hybridsurrogate.inference.posterior_sampler import FirstStep, first_step, of_importance
from hybridsurrogate.inference.sampling.ensembles import FROM_NEAR, Effort, EnsembleSampler
from hybridsurrogate.inference.sampling.importance import Proposals, matched_draws
from hybridsurrogate.inference.sampling.modes import NothingPossibleError
from hybridsurrogate.model.posterior import MIN_EFFECTIVE, Diagnostics, Posterior
from hybridsurrogate.model.problem import Problem
from hybridsurrogate.numerics.linear_algebra import one_blas_thread
from hybridsurrogate.numerics.psis import KHAT_LIMIT
from hybridsurrogate.surrogates.families.parametric import ExactBasis
from hybridsurrogate.types import FloatArray, Prior

# the outermost share of a prior that holds so much of a posterior
_OUTER_SHARE, _OUTER_MASS = 0.02, 0.9
# mean distance from the end over standard deviation: 1 of a density that falls off exponentially
# from there, 1.32 of half a normal one, 1.73 of a uniform one
_MAX_MEAN_TO_SD = 1.5


class AtPriorEnd(NamedTuple):
    """A parameter at the end of its prior.

    Attributes
    ----------
    name : str
    side : {"low", "high"}
    mean : float
        Of the posterior.
    end : float
        The value beyond which the prior has 2 % of its mass.
    """

    name: str
    side: str
    mean: float
    end: float


def at_prior_ends(posterior: Posterior) -> list[AtPriorEnd]:
    """Return the parameters whose prior keeps the posterior from going further.

    The posterior is piled up at an end of the prior's support or, of a prior without ends, 90 % of
    it lie in the outermost 2 % of the prior.

    Parameters
    ----------
    posterior : Posterior
    """
    model = posterior.model
    return _at_ends(zip(model.parameters.items(), posterior.values.T, strict=False))


def effects_at_prior_ends(posterior: Posterior, n: int) -> list[AtPriorEnd]:
    """Return what of the first n effects the data push against an end of its prior.

    Parameters
    ----------
    posterior : Posterior
    n : int
    """
    model, found = posterior.model, []
    for position, (owner, name) in enumerate(model.theta_names, start=model.n_parameters):
        if owner < n:
            word = f"{name} of {model.effects[owner].name}"
            found.append(((word, model.priors[position]), posterior.values[:, position]))
    return _at_ends(found)


def _at_ends(found: Iterable[tuple[tuple[str, Prior], FloatArray]]) -> list[AtPriorEnd]:
    out = []
    for (name, prior), draws in found:
        below, mean, sd = prior.cdf(draws), float(np.mean(draws)), float(np.std(draws))
        usual = float(np.diff(prior.ppf([0.16, 0.84]))[0]) / 2
        for side, share, end in zip(
            ("low", "high"), (below, 1 - below), prior.support(), strict=True
        ):
            outermost = np.mean(share < _OUTER_SHARE) > _OUTER_MASS
            if outermost or abs(mean - end) < _MAX_MEAN_TO_SD * sd < _MAX_MEAN_TO_SD * usual / 2:
                beyond = float(prior.ppf(_OUTER_SHARE if side == "low" else 1 - _OUTER_SHARE))
                out.append(AtPriorEnd(name, side, mean, beyond))
                break
    return out


def carried_step(
    problem: Problem,
    powers: tuple[float, float | FloatArray],
    proposals: Proposals | None,
    n_draws: int,
    n_proposals: int,
    random_state: np.random.RandomState,
) -> FirstStep | None:
    """Return step 1 of a problem from proposals made for another, None where they do not serve.

    They do not where, after moment matching, their k-hat exceeds 0.7 or so few effective draws
    are left that they are doubtful.

    Parameters
    ----------
    powers : (alpha_S, alpha_R)
    proposals : Proposals or None
        For the same unknowns, at other powers or for other rows; None of an ensemble.
    n_proposals : int
        At most so many of them are used.
    """
    if proposals is None or len(proposals.points) < MIN_EFFECTIVE:
        return None
    powers = powers_used(problem, powers)
    target, some = make_target(problem, *powers), thinned(proposals, n_proposals)
    sampled = matched_draws(
        target.extended_log_density, some, n_draws, random_state, target.n_noise
    )
    if not (sampled.khat <= KHAT_LIMIT and sampled.effective_draws >= MIN_EFFECTIVE):
        return None
    drawn = target.resolved(sampled.draws, random_state)
    return FirstStep(*drawn, of_importance(target, sampled, 1), sampled.proposals)


def carried(
    problem: Problem,
    powers: tuple[float, float | FloatArray],
    proposals: Proposals | None,
    n_draws: int,
    n_proposals: int,
    random_state: np.random.RandomState,
) -> Fit | None:
    """Return the fit of a problem whose step 1 is `carried_step`, None where that is."""
    with one_blas_thread():
        step = carried_step(problem, powers, proposals, n_draws, n_proposals, random_state)
        if step is None:
            return None
        return _finish(problem, powers_used(problem, powers), step, random_state)


def thinned(proposals: Proposals, n: int) -> Proposals:
    """Return at most n proposals, spread evenly over all."""
    if len(proposals.points) <= n:
        return proposals
    index = np.linspace(0, len(proposals.points) - 1, n).astype(int)
    return Proposals(proposals.points[index], proposals.log_density[index])


@dataclass(frozen=True)
class Fit:
    """A fitted posterior: the draws of both steps and their diagnostics.

    Attributes
    ----------
    problem : Problem
    first, second : Posterior
    unknowns : ndarray of shape (S, d)
        Draws of u = [z, z_hyper, log sigma] of step 1.
    diagnostics : Diagnostics
    powers : (alpha_S, alpha_R)
        Those used.
    proposals : Proposals or None
        What importance draws of step 1 were chosen from.
    again : ndarray of shape (S, d) or None
        Draws of [z, log sigma] of step 2; None where there was none.
    """

    problem: Problem
    first: Posterior
    second: Posterior
    unknowns: FloatArray
    diagnostics: Diagnostics
    powers: tuple[float, float | FloatArray]
    proposals: Proposals | None = None
    again: FloatArray | None = None

    def __repr__(self) -> str:
        return f"Fit({self.second!r}, {self.diagnostics!r})"


def make_target(
    problem: Problem, simulation_power: float, measured_power: float | FloatArray
) -> PowerScaledPosterior:
    """Return the density of step 1; an array of powers holds one for each measured row."""
    weights, power = problem.weights, measured_power
    if not isinstance(power, float | int):
        weights, power = weights * power, float(np.any(power > 0))
    rows = problem.model, problem.X, problem.y, weights
    both = *rows, simulation_power, power, problem.noise_prior, problem.scale
    if problem.collapses:
        return CollapsedPosterior(*both, problem.simulation)
    return LaplacePosterior(*both, problem.observed, problem.likelihood, problem.runs)


def fit_problem(
    problem: Problem,
    powers: tuple[float, float | FloatArray],
    sampler: str | EnsembleSampler,
    n_draws: int,
    random_state: np.random.RandomState,
) -> Fit:
    """Run both steps and return draws with diagnostics.

    Parameters
    ----------
    powers : (alpha_S, alpha_R)
        alpha_R may be an array with one power for each measured row.
    """
    powers = powers_used(problem, powers)
    with one_blas_thread():
        try:
            drawn = first_step(make_target(problem, *powers), sampler, n_draws, random_state)
        except NothingPossibleError as error:
            # how a simulation that is its own surrogate failed
            basis = problem.model.basis
            failure = basis.simulate.failure(problem.X) if isinstance(basis, ExactBasis) else ""
            raise ValueError(f"{error} {failure}".rstrip()) from None
        return _finish(problem, powers, drawn, random_state)


def powers_used(
    problem: Problem, powers: tuple[float, float | FloatArray]
) -> tuple[float, float | FloatArray]:
    """Return (alpha_S, alpha_R), which without runs are those of measured rows alone."""
    return powers if problem.runs is not None else (0.0, 1.0)


def _finish(
    problem: Problem,
    powers: tuple[float, float | FloatArray],
    drawn: FirstStep,
    random_state: np.random.RandomState,
) -> Fit:
    """Run step 2 on the draws of step 1 at `powers_used`."""
    model, first = problem.model, posterior_of(problem, drawn)
    if powers[0] == 0 and np.all(powers[1] == 1):
        # measured rows alone were used, at full power: step 2 would repeat step 1
        return Fit(problem, first, first, drawn.u, drawn.diagnostics, powers, drawn.proposals)
    if problem.collapses:
        given, near = given_draws(problem, drawn.c), _without_hyper(problem, drawn.u)
        again = second_step(given, near, random_state)
    else:
        again = moved_again(problem, drawn.u, drawn.c, drawn.a, random_state, FROM_NEAR)
    z = np.hstack([again.z, drawn.u[:, model.n_unknowns : -1]])
    second = replace(
        first, values=model.values(z), sigma=again.sigma, effect_coefficients=again.coefficients
    )
    diagnostics = replace(
        drawn.diagnostics,
        second_step=again.method,
        second_khat=np.nan if again.method == "grid" else again.khat,
        second_effective_draws=again.effective_draws,
    )
    unknowns = np.column_stack([again.z, np.log(again.sigma)])
    return Fit(problem, first, second, drawn.u, diagnostics, powers, drawn.proposals, unknowns)


def posterior_of(problem: Problem, drawn: FirstStep) -> Posterior:
    """Return the posterior of step 1."""
    return Posterior(
        problem.model,
        problem.likelihood,
        problem.model.values(drawn.u[:, :-1]),
        np.exp(drawn.u[:, -1]),
        drawn.c,
        drawn.a,
    )


def with_again(u: FloatArray, again: FloatArray) -> FloatArray:
    """Return unknowns [z, z_hyper, log sigma] with those of step 2, [z, log sigma], in place."""
    m = again.shape[1] - 1
    return np.hstack([again[:, :m], u[:, m:-1], again[:, m:]])


def moved_again(
    problem: Problem,
    u: FloatArray,
    c: FloatArray,
    a: FloatArray,
    random_state: np.random.RandomState,
    effort: Effort,
) -> MeasuredDraws:
    """Draw the unknowns of the measured rows given each coefficient draw, by moves.

    From u and a, which are draws of this posterior or of one near.
    """
    if problem.collapses:
        start = _without_hyper(problem, u)
        return moved_step(given_draws(problem, c), start, random_state, effort)
    return conditional_draws(problem, u, c, a, random_state, effort)


def given_draws(problem: Problem, c: FloatArray) -> MeasuredGiven:
    """Return the measured rows of a problem given coefficient draws (S, p)."""
    rows = problem.model, problem.X, problem.y, problem.weights
    return MeasuredGiven(*rows, c, problem.noise_prior, problem.scale)


def _without_hyper(problem: Problem, u: FloatArray) -> FloatArray:
    """Return [z, log sigma] of unknowns [z, z_hyper, log sigma]."""
    return np.delete(u, np.s_[problem.model.n_unknowns : u.shape[1] - 1], axis=1)
