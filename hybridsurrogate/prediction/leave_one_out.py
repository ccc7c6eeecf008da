"""Leave-one-out scores of fitted estimators."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.inference.loo import PointwiseLoo, pointwise_loo
from hybridsurrogate.inference.procedure import Fit, fit_problem, measured_draws
from hybridsurrogate.inference.sampling.emcee_sampler import EnsembleSampler
from hybridsurrogate.inference.warm_start import carried
from hybridsurrogate.notebook.bars import counted
from hybridsurrogate.posterior import Posterior
from hybridsurrogate.prediction.cavity import without_each
from hybridsurrogate.prediction.mixture import MixtureAt, log_density_of
from hybridsurrogate.priors import FloatArray
from hybridsurrogate.problem.problem import Problem
from hybridsurrogate.problem.rows import MeasuredRows

# step 2 is repeated this often, for so many coefficient draws: on a grid all of them cost little
_REPEATS = 8
_ON_GRID, _OTHERWISE = 4000, 125
# draws of a fit without one row: its score has an error of a few hundredths of a nat from them
_REFITTED, _PROPOSALS = 400, 4


@dataclass(frozen=True)
class Loo:
    """Leave-one-out score of a fitted estimator.

    Of equal rows one is left out at a time. A row of weight two counts like two equal rows here
    too: what is left out of it has weight one.

    Attributes
    ----------
    elpd : float
        Mean log predictive density per row, each given the others.
    standard_error : float
    pointwise : ndarray of shape (n,)
    khat : ndarray of shape (n,)
        Pareto k-hat of each row before it was fitted anew.
    n_refits : int
        Rows for which importance sampling failed and the model was fitted without them: k-hat above
        ``min(1 - 1 / log10(n_draws), 0.7)`` (Vehtari, Simpson, Gelman, Yao and Gabry 2024, Journal
        of Machine Learning Research 25(72)).

    Examples
    --------
    As from ``model.loo()``:

    >>> pointwise, khat = np.array([-1.0, -3.0]), np.array([0.2, 0.9])
    >>> found = Loo(-2.0, 1.0, pointwise, khat, n_refits=1)
    >>> found.pointwise[found.khat > 0.7]  # the row that was left out by another fit
    array([-3.])
    """

    elpd: float
    standard_error: float
    pointwise: FloatArray
    khat: FloatArray
    n_refits: int


def loo_of_rows(
    found: PointwiseLoo,
    outside: NDArray[np.bool_],
    mixture_at: MixtureAt,
    X: FloatArray,
    y: FloatArray,
    weights: FloatArray,
    log_scale: FloatArray | float = 0.0,
) -> Loo:
    """Return the score of all measured rows; those ``outside`` the fit get their density here.

    Outputs that were divided by scales have a density that is less by the logarithm of these.
    """
    pointwise, khat = found.log_density.copy(), found.khat
    if outside.any():
        mixture = mixture_at(X[outside])
        pointwise[outside] = log_density_of(mixture, X[outside], y[outside])
    pointwise = pointwise - log_scale
    mean = float(np.average(pointwise, weights=weights))
    spread = np.average((pointwise - mean) ** 2, weights=weights)
    error = float(np.sqrt(spread / max(weights.sum() - 1, 1.0)))
    return Loo(mean, error, pointwise, khat, int(found.failed.sum()))


def loo_of_fit(
    problem: Problem,
    fit: Fit,
    rows: MeasuredRows,
    sampler: str | EnsembleSampler,
    random_state: np.random.RandomState,
    progress: bool = False,
) -> PointwiseLoo:
    """Return leave-one-out densities of the rows given to a fit; bad rows are fitted anew.

    Importance sampling is replaced by a fit without the row where its k-hat exceeds what so many
    draws can bear. Rows without weight have NaN, and a k-hat of minus infinity.
    """
    inside = rows.origin >= 0
    n = len(inside)
    out = PointwiseLoo(np.full(n, np.nan), np.full(n, -np.inf), np.zeros(n, dtype=bool))
    if not inside.any():
        return out
    # equal rows of equal weight are the same question
    asked, which = np.unique(
        np.column_stack([rows.origin, np.minimum(rows.given, 1.0)])[inside],
        axis=0,
        return_inverse=True,
    )
    found = _loo_of_distinct(
        problem, fit, asked[:, 0].astype(int), asked[:, 1], sampler, random_state, progress
    )
    out.log_density[inside] = found.log_density[which.ravel()]
    out.khat[inside] = found.khat[which.ravel()]
    out.failed[inside] = found.failed[which.ravel()]
    return out


def _loo_of_distinct(
    problem: Problem,
    fit: Fit,
    index: NDArray[np.intp],
    less: FloatArray,
    sampler: str | EnsembleSampler,
    random_state: np.random.RandomState,
    progress: bool,
) -> PointwiseLoo:
    """Return the densities of rows of a problem, by position, with so much less weight each."""
    X, y = problem.X[index], problem.observed[index]
    power = np.broadcast_to(fit.powers[1], problem.y.shape)[index]
    if fit.second is fit.first:  # there was no step 2
        first = _log_likelihood(fit.first, X, y)
        found = pointwise_loo(first, less, first[:, None], np.zeros(len(y)))
    else:
        most = _ON_GRID if fit.diagnostics.second_step == "grid" else _OTHERWISE
        draws = _spread(len(fit.unknowns), most)
        first = _log_likelihood(fit.first.take(draws), X, y)
        again = _repeated(problem, fit, draws, random_state)
        if problem.collapses and again.effect_coefficients.shape[1]:
            pair = without_each(problem, again, index, less)
        else:
            second = _log_likelihood(again, X, y)
            pair = second, less * second
        shape = len(draws), _REPEATS, len(y)
        second, removed = (values.reshape(shape) for values in pair)
        found = pointwise_loo(first, power * less, second, less, removed)
    for i in counted(np.flatnonzero(found.failed), "Fits without one row", progress):
        again = _fit_without(problem, fit, index[i], less[i], sampler, random_state)
        density = _log_likelihood(again, X[i : i + 1], y[i : i + 1])
        found.log_density[i] = np.logaddexp.reduce(density[:, 0]) - np.log(len(density))
    return found


def _spread(n: int, most: int) -> NDArray[np.intp]:
    """Return the positions of at most so many of n draws."""
    return np.linspace(0, n - 1, min(most, n)).astype(int)


def _fit_without(
    problem: Problem,
    fit: Fit,
    i: np.intp,
    less: float,
    sampler: str | EnsembleSampler,
    random_state: np.random.RandomState,
) -> Posterior:
    """Return draws given all rows but one, from those given all of them where these serve."""
    without, powers = _without(problem, fit.powers, i, less)
    n = min(fit.first.n_draws, _REFITTED)
    if np.all(np.broadcast_to(fit.powers[1], problem.y.shape)[i] == 0):
        # the row has no part in step 1
        return _repeated(without, fit, _spread(len(fit.unknowns), n // _REPEATS), random_state)
    known = carried(without, powers, fit.proposals, n, _PROPOSALS * n, random_state)
    if known is None:
        known = fit_problem(without, powers, sampler, n, random_state)
    return known.second


def _without(
    problem: Problem, powers: tuple[float, float | FloatArray], i: np.intp, less: float
) -> tuple[Problem, tuple[float, float | FloatArray]]:
    """Return a problem, and its powers, whose row i has less weight, or is gone."""
    weights = problem.weights.copy()
    weights[i] -= less
    # what rounding leaves of a whole row is nothing
    rest = weights > 1e-9 * problem.weights
    without = replace(
        problem,
        X=problem.X[rest],
        y=problem.y[rest],
        observed=problem.observed[rest],
        weights=weights[rest],
    )
    if isinstance(powers[1], float | int):
        return without, powers
    return without, (powers[0], powers[1][rest])


def _repeated(
    problem: Problem, fit: Fit, index: NDArray[np.intp], random_state: np.random.RandomState
) -> Posterior:
    """Return several draws of step 2 for each of some draws of the coefficients."""
    given, u = fit.first.take(index), fit.unknowns[index]
    drawn = measured_draws(
        problem, u, given.coefficients, given.effect_coefficients, random_state, _REPEATS
    )
    first, u = fit.first.take(np.repeat(index, _REPEATS)), np.repeat(u, _REPEATS, axis=0)
    z = np.hstack([drawn.z, u[:, problem.model.n_unknowns : -1]])
    return replace(
        first,
        values=problem.model.values(z),
        sigma=drawn.sigma,
        effect_coefficients=drawn.coefficients,
    )


def _log_likelihood(posterior: Posterior, X: FloatArray, y: FloatArray) -> FloatArray:
    return posterior.likelihood.log_density(y, *posterior.eta(X))
