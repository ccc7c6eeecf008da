"""Leave-one-out scores of fitted estimators."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.estimators.fitting import Fit, fit_problem, measured_draws
from hybridsurrogate.estimators.mixture import MixtureAt, log_density_of
from hybridsurrogate.estimators.problem import Problem
from hybridsurrogate.inference.ensemble import EnsembleSampler
from hybridsurrogate.inference.leave_one_out import PointwiseLoo, pointwise_loo
from hybridsurrogate.inference.pareto import KHAT_LIMIT
from hybridsurrogate.posterior import Posterior
from hybridsurrogate.priors import FloatArray

# step 2 is repeated this often, for so many coefficient draws: on a grid all of them cost little
_REPEATS = 8
_ON_GRID, _OTHERWISE = 4000, 250


@dataclass(frozen=True)
class Loo:
    """Leave-one-out score of a fitted estimator.

    Attributes
    ----------
    elpd : float
        Mean log predictive density per row, each given the others.
    standard_error : float
    pointwise : ndarray of shape (n,)
    khat : ndarray of shape (n,)
        Pareto k-hat of each row before it was fitted anew.
    n_refits : int
        Rows for which importance sampling failed and the model was fitted without them.
    """

    elpd: float
    standard_error: float
    pointwise: FloatArray
    khat: FloatArray
    n_refits: int


def loo_of_rows(
    found: PointwiseLoo,
    origin: NDArray[np.intp],
    mixture_at: MixtureAt,
    X: FloatArray,
    y: FloatArray,
    weights: FloatArray,
) -> Loo:
    """Return the score of all measured rows from the densities of the distinct ones.

    ``origin`` tells which of these each row is; -1: none, as it has no weight.
    """
    pointwise, khat = found.log_density[origin], found.khat[origin]
    outside = origin < 0
    if outside.any():
        mixture = mixture_at(X[outside])
        pointwise[outside] = log_density_of(mixture, X[outside], y[outside])
        khat[outside] = -np.inf
    mean = float(np.average(pointwise, weights=weights))
    spread = np.average((pointwise - mean) ** 2, weights=weights)
    error = float(np.sqrt(spread / max(weights.sum() - 1, 1.0)))
    return Loo(mean, error, pointwise, khat, int(np.sum(found.khat > KHAT_LIMIT)))


def loo_of_fit(
    problem: Problem,
    fit: Fit,
    sampler: str | EnsembleSampler,
    random_state: np.random.RandomState,
) -> PointwiseLoo:
    """Return leave-one-out densities of the measured rows of a fit; bad rows are fitted anew.

    Importance sampling is replaced by a fit without the row where its k-hat exceeds 0.7.
    """
    X, y, powers = problem.X, problem.observed, fit.powers
    if fit.second is fit.first:  # there was no step 2
        first = _log_likelihood(fit.first, X, y)
        found = pointwise_loo(first, problem.weights, first[:, None], np.zeros(len(y)))
    else:
        most = _ON_GRID if fit.diagnostics.second_step == "grid" else _OTHERWISE
        n_coefficients = min(most, len(fit.unknowns))
        index = np.linspace(0, len(fit.unknowns) - 1, n_coefficients).astype(int)
        first = _log_likelihood(fit.first.take(index), X, y)
        second = _log_likelihood(_repeated(problem, fit, index, random_state), X, y)
        found = pointwise_loo(
            first,
            powers[1] * problem.weights,
            second.reshape(len(index), _REPEATS, len(y)),
            problem.weights,
        )
    for i in np.flatnonzero(found.khat > KHAT_LIMIT):
        rest = np.arange(len(y)) != i
        without = replace(
            problem,
            X=X[rest],
            y=problem.y[rest],
            observed=y[rest],
            weights=problem.weights[rest],
        )
        less = powers if isinstance(powers[1], float | int) else (powers[0], powers[1][rest])
        again = fit_problem(without, less, sampler, fit.first.n_draws, random_state)
        density = _log_likelihood(again.second, X[i : i + 1], y[i : i + 1])
        found.log_density[i] = np.logaddexp.reduce(density[:, 0]) - np.log(len(density))
    return found


def _repeated(
    problem: Problem, fit: Fit, index: NDArray[np.intp], random_state: np.random.RandomState
) -> Posterior:
    """Return several draws of step 2 for each of some draws of the coefficients."""
    chosen = np.repeat(index, _REPEATS)
    first = fit.first.take(chosen)
    u = fit.unknowns[chosen]
    drawn = measured_draws(problem, u, first.coefficients, first.effect_coefficients, random_state)
    z = np.hstack([drawn.z, u[:, problem.model.n_unknowns : -1]])
    return replace(
        first,
        values=problem.model.values(z),
        sigma=drawn.sigma,
        effect_coefficients=drawn.coefficients,
    )


def _log_likelihood(posterior: Posterior, X: FloatArray, y: FloatArray) -> FloatArray:
    return posterior.likelihood.log_density(y, *posterior.eta(X))
