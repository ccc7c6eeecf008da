"""Leave-one-out scores of fitted estimators.

Given everything else, measured rows are jointly Gaussian: y = f + noise, f = eta + H a with
a ~ N(0, I). The density of row i given the others follows from the posterior of f_i by taking the
row's own likelihood out of it (the cavity; Burkner, Gabry and Vehtari 2021, Computational
Statistics 36:1243, do so with the inverse of the covariance). Draws of a, of which a process has
dozens that follow each row, would make importance weights fail.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special
from scipy.stats import norm

from hybridsurrogate.inference.conditional.sampler import (
    MeasuredDraws,
    exchanged,
    held_out,
    near_draws,
)
from hybridsurrogate.inference.loo import PointwiseLoo, pointwise_loo
from hybridsurrogate.inference.posterior_sampler import first_step
from hybridsurrogate.inference.procedure import (
    Fit,
    carried,
    carried_step,
    fit_problem,
    given_draws,
    make_target,
    moved_again,
    posterior_of,
    powers_used,
    with_again,
)
from hybridsurrogate.inference.sampling.ensembles import FROM_DRAWS, FROM_NEAR, EnsembleSampler
from hybridsurrogate.inference.sampling.modes import Gaussian
from hybridsurrogate.model.posterior import FEW_DRAWS, Posterior
from hybridsurrogate.model.problem import Problem
from hybridsurrogate.model.rows.measured_data import MeasuredData
from hybridsurrogate.model.rows.stacking import Conditional
from hybridsurrogate.notebook import counted
from hybridsurrogate.numerics.linear_algebra import (
    LARGE_BLOCK,
    blocks,
    nudged_cholesky,
    one_blas_thread,
)
from hybridsurrogate.numerics.psis import khat_limit, pareto_smooth
from hybridsurrogate.prediction.mixture import MixtureAt, log_density_of
from hybridsurrogate.types import FloatArray


def without_each(
    problem: Problem, posterior: Posterior, index: NDArray[np.intp], less: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return log densities of rows given all others, and what leaving them out takes away.

    Parameters
    ----------
    problem : Problem
        Whose coefficients are Gaussian.
    posterior : Posterior
        S draws; of those of the causes' coefficients nothing is used.
    index : ndarray of int of shape (m,)
        Rows of the problem.
    less : ndarray of shape (m,)
        How much weight each of these loses.

    Returns
    -------
    predicted : ndarray of shape (S, m)
        Log density of a measurement of weight one.
    removed : ndarray of shape (S, m)
        Log of the integral of the likelihood, to the power ``less``, over the cavity.
    """
    n, q = len(problem.y), posterior.effect_coefficients.shape[1]
    parts = [
        _of_some(problem, posterior.take(np.arange(some.start, some.stop)), index, less)
        for some in blocks(posterior.n_draws, n * (q + 2), LARGE_BLOCK)
    ]
    predicted, removed = (np.concatenate(part) for part in zip(*parts, strict=True))
    # densities of y, where the likelihood is normal on another scale
    y, eta = problem.observed[index], problem.y[index]
    jacobian = problem.likelihood.log_density(y, eta, np.ones(len(y))) - norm.logpdf(0.0)
    return predicted + jacobian, removed + less * jacobian


def _of_some(
    problem: Problem, posterior: Posterior, index: NDArray[np.intp], less: FloatArray
) -> tuple[FloatArray, FloatArray]:
    model, X = problem.model, problem.X
    plain = replace(posterior, effect_coefficients=np.zeros_like(posterior.effect_coefficients))
    eta, scale = plain.eta(X)
    columns = model.added(X, posterior.values) * model.column_sd
    if (given := model.conditional(X, posterior.values)) is not None:
        found = _of_correlated(given, problem.y - eta, scale, columns)[:, index]
        return found, less * found
    root = np.sqrt(problem.weights) / scale
    scaled, residual = columns * root[..., None], (problem.y - eta) * root
    transposed = np.swapaxes(scaled, 1, 2)
    factor = nudged_cholesky(np.eye(columns.shape[2]) + transposed @ scaled)
    # with F F' = I + H'H the posterior of f_i has mean h_i F'^-1 F^-1 H'r and variance |F^-1 h_i|^2
    half = np.linalg.solve(factor, transposed @ residual[..., None])
    asked = np.linalg.solve(factor, np.swapaxes(columns[:, index], 1, 2))
    mean, variance = (np.swapaxes(asked, 1, 2) @ half)[..., 0], np.sum(asked**2, axis=1)
    noise, y = scale[:, index] ** 2, (problem.y - eta)[:, index]
    variance = variance / np.maximum(1 - less * variance / noise, np.finfo(float).eps)
    mean = mean + variance * less * (mean - y) / noise
    predicted = norm.logpdf(y, mean, np.sqrt(variance + noise))
    # N(y; f, s^2)^w = (2 pi s^2)^((1 - w) / 2) w^(-1/2) N(y; f, s^2 / w)
    removed = norm.logpdf(y, mean, np.sqrt(variance + noise / less))
    removed = removed + 0.5 * (1 - less) * np.log(2 * np.pi * noise) - 0.5 * np.log(less)
    return predicted, removed


def _of_correlated(
    given: Conditional, residual: FloatArray, scale: FloatArray, columns: FloatArray
) -> FloatArray:
    """Return log densities (S, n) of rows given all others, of weight one, by the precision P.

    Row i has mean y_i - (P r)_i / P_ii and variance 1 / P_ii (Sundararajan and Keerthi 2001, Neural
    Computation 13:1103). With ``T r`` the independent residuals P is T' (D^2 + H H')^-1 T.
    """
    n = residual.shape[1]
    covariance = columns @ np.swapaxes(columns, 1, 2)
    covariance[:, range(n), range(n)] += scale**2
    T = np.broadcast_to(given.residuals(np.eye(n)[None]), covariance.shape)
    solved = np.linalg.solve(covariance, np.concatenate([T, residual[..., None]], axis=2))
    both = np.swapaxes(T, 1, 2) @ solved
    own = np.diagonal(both[..., :n], axis1=1, axis2=2)
    return np.asarray(norm.logpdf(both[..., n] / own, 0, own**-0.5))


Powers = tuple[float, float | FloatArray]  # of the likelihoods of both sources
# draws of step 2 for each of a few draws of the coefficients
_N_REPEATS = 8


class _Starts(NamedTuple):
    """Draws of step 2, [z, log sigma] and coefficients of causes, for draws of step 1."""

    draw: NDArray[np.intp]
    u: FloatArray
    columns: FloatArray

    @classmethod
    def of_fit(cls, fit: Fit, draw: NDArray[np.intp]) -> _Starts:
        """Return those of a fit."""
        assert fit.again is not None
        return cls(draw, fit.again[draw], fit.second.effect_coefficients[draw])

    def take(self, chosen: NDArray[np.intp]) -> _Starts:
        """Return some of them."""
        return _Starts(self.draw[chosen], self.u[chosen], self.columns[chosen])


class _Step(NamedTuple):
    """Draws of step 1 without a row, and where step 2 lies.

    Attributes
    ----------
    first : Posterior
    unknowns : ndarray of shape (n, d)
    begun : _Starts
        Draws of step 2 for each, or near to them.
    near : tuple of Gaussian
        What step 2 infers without the row, about, and with it.
    """

    first: Posterior
    unknowns: FloatArray
    begun: _Starts
    near: tuple[Gaussian, Gaussian]


@dataclass(frozen=True)
class Loo:
    """Leave-one-out score of a fitted estimator.

    Of equal rows one is left out at a time. A row of weight two counts like two equal rows: weight
    one is left out at a time.

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


def loo_of_rows(found: PointwiseLoo, data: MeasuredData, mixture_at: MixtureAt) -> Loo:
    """Return the score of all measured rows; those outside the fit get their density here.

    Outputs that were divided by scales have a density that is less by the logarithm of these.
    """
    (X, y, weights), outside = data.single, data.distinct.origin < 0
    pointwise, khat = found.log_density.copy(), found.khat
    if outside.any():
        mixture = mixture_at(X[outside])
        pointwise[outside] = log_density_of(mixture, X[outside], y[outside])
    if data.stacking is not None:
        pointwise = pointwise - data.stacking.log_scale(X)
    mean = float(np.average(pointwise, weights=weights))
    spread = np.average((pointwise - mean) ** 2, weights=weights)
    error = float(np.sqrt(spread / max(weights.sum() - 1, 1.0)))
    return Loo(mean, error, pointwise, khat, int(found.failed.sum()))


def loo_of_mixture(parts: Sequence[PointwiseLoo], weights: Sequence[Any]) -> PointwiseLoo:
    """Return the densities of a mixture, whose weights are numbers or arrays (n,).

    A k-hat is the largest of its parts.
    """
    log_density, khat, failed = (np.array(column) for column in zip(*parts, strict=True))
    share = np.stack([np.broadcast_to(weight, log_density.shape[1:]) for weight in weights])
    density = special.logsumexp(log_density, axis=0, b=share)
    return PointwiseLoo(density, khat.max(axis=0), np.asarray(failed.any(axis=0)))


def loo_of_fit(
    fit: Fit,
    data: MeasuredData,
    sampler: str | EnsembleSampler,
    random_state: np.random.RandomState,
    progress: bool = False,
) -> PointwiseLoo:
    """Return leave-one-out densities of the rows given to a fit; bad rows are fitted anew.

    Importance sampling is replaced by a fit without the row where its k-hat exceeds what so many
    draws can bear. Rows without weight have NaN, and a k-hat of minus infinity.
    """
    origin, given = data.distinct.origin, data.share * data.single.weights
    inside = origin >= 0
    n = len(inside)
    out = PointwiseLoo(np.full(n, np.nan), np.full(n, -np.inf), np.zeros(n, dtype=bool))
    if not inside.any():
        return out
    # equal rows of equal weight are the same question
    asked, which = np.unique(
        np.column_stack([origin, np.minimum(given, 1.0)])[inside],
        axis=0,
        return_inverse=True,
    )
    leaving = _LeavingOut(fit, sampler, random_state)
    with one_blas_thread():
        found = leaving.each(asked[:, 0].astype(int), asked[:, 1], progress)
    out.log_density[inside] = found.log_density[which.ravel()]
    out.khat[inside] = found.khat[which.ravel()]
    out.failed[inside] = found.failed[which.ravel()]
    return out


@dataclass(frozen=True)
class _LeavingOut:
    """Rows of a fit left out, one at a time."""

    fit: Fit
    sampler: str | EnsembleSampler
    random_state: np.random.RandomState

    @property
    def problem(self) -> Problem:
        return self.fit.problem

    def each(self, index: NDArray[np.intp], less: FloatArray, progress: bool) -> PointwiseLoo:
        """Return the densities of rows of the problem, by position, with so much less weight."""
        problem, fit = self.problem, self.fit
        power = np.broadcast_to(fit.powers[1], problem.y.shape)[index]
        first = _log_likelihood(problem, fit.first, index)
        if fit.second is fit.first:  # there was no step 2
            found = pointwise_loo(first, less, first[:, None], np.zeros(len(index)))
        else:
            n_coefficients = fit.first.coefficients.shape[1] + len(problem.model.column_sd)
            # so many that their matrices, and all of them with each other, fit into a block
            most = np.clip(LARGE_BLOCK / max(n_coefficients, 1) ** 2, FEW_DRAWS, LARGE_BLOCK**0.5)
            some = np.linspace(0, len(first) - 1, min(int(most), len(first))).astype(int)
            starts = self._repeats(some)
            of_first = fit.first.take(starts.draw), fit.unknowns[starts.draw]
            again = _at(*of_first, starts.u, starts.columns)
            second, removed = _given_others(problem, again, index, less)
            shape = len(some), _N_REPEATS, len(index)
            found = pointwise_loo(
                first, power * less, second.reshape(shape), less, removed.reshape(shape), some
            )
        for i in counted(np.flatnonzero(found.failed), "Fits without one row", progress):
            without, powers = _without(problem, fit.powers, index[i], less[i])
            if fit.again is None:
                again = self._fit_without(without, powers)
            else:
                log_weight = -power[i] * less[i] * first[:, i]
                kept = -removed[:, i].reshape(len(some), -1)
                step = self._step_without(without, powers, starts, some, log_weight, kept)
                known = self._held_out(without, step, index[i], less[i])
                if known is not None:
                    found.log_density[i] = known
                    continue
                again = self._moved(without, step)
            density = _given_others(problem, again, index[i : i + 1], less[i : i + 1])[0]
            found.log_density[i] = special.logsumexp(density) - np.log(len(density))
        return found

    def _repeats(self, some: NDArray[np.intp]) -> _Starts:
        """Return `_N_REPEATS` draws of step 2 for some draws of the coefficients, in turn.

        Draws that belong to other coefficients serve where their posteriors overlap, and are moved
        where they do not.
        """
        fit, problem, random = self.fit, self.problem, self.random_state
        starts = _Starts.of_fit(fit, np.repeat(some, _N_REPEATS))
        c = fit.first.coefficients
        if problem.collapses:
            own = _Starts.of_fit(fit, some)
            chosen = exchanged(given_draws(problem, c[some]), own.u, _N_REPEATS, random)
            if chosen is not None:
                return starts._replace(u=own.u[chosen.ravel()])
        u = with_again(fit.unknowns[starts.draw], starts.u)
        drawn = moved_again(problem, u, c[starts.draw], starts.columns, random, FROM_DRAWS)
        return _Starts(starts.draw, _unknowns_of(drawn), drawn.coefficients)

    def _step_without(
        self,
        without: Problem,
        powers: Powers,
        starts: _Starts,
        some: NDArray[np.intp],
        log_weight: FloatArray,
        kept: FloatArray,
    ) -> _Step:
        """Return draws of step 1 given all rows but one, from those of a fit with it.

        Parameters
        ----------
        some : ndarray of int of shape (T,)
            Draws of step 1 that have repeats.
        log_weight : ndarray of shape (S,)
            Of draws of step 1 as if their row were not there.
        kept : ndarray of shape (T, M)
            The same of the repeats, given their draw of step 1.
        """
        fit, random = self.fit, self.random_state
        n = min(fit.first.n_draws, FEW_DRAWS)
        smoothed, khat = pareto_smooth(log_weight) if np.ptp(log_weight) else (0 * log_weight, 0.0)
        of_first = smoothed[some][:, None] - special.logsumexp(kept, axis=1, keepdims=True)
        share = special.softmax((kept + of_first).ravel())
        begun = starts.take(_evenly(share, n, random))
        equal = np.full(len(share), 1 / len(share))
        near = near_draws(starts.u, share), near_draws(starts.u, equal)
        if khat <= khat_limit(len(log_weight)):
            return _Step(fit.first.take(begun.draw), fit.unknowns[begun.draw], begun, near)
        step = carried_step(without, powers, fit.proposals, n, _N_REPEATS * FEW_DRAWS, random)
        if step is None:
            target = make_target(without, *powers_used(without, powers))
            step = first_step(target, self.sampler, n, random)
        return _Step(posterior_of(without, step), step.u, begun, near)

    def _held_out(self, without: Problem, step: _Step, i: np.intp, less: float) -> float | None:
        """Return the log density of row i given the others, None where proposals do not serve."""
        problem = self.problem
        if not problem.collapses:
            return None
        c = step.first.coefficients
        # the others, and a measurement of weight one
        more = _without(problem, (0.0, 1.0), i, less - 1)[0]
        draws = given_draws(without, c), given_draws(more, c)
        found = held_out(*draws, step.near, self.random_state)
        if found is None:
            return None
        constant = problem.likelihood.log_density(problem.observed[i], problem.y[i], np.ones(()))
        return float(special.logsumexp(found) - np.log(len(found)) + constant)

    def _moved(self, without: Problem, step: _Step) -> Posterior:
        """Return draws of step 2 given all rows but one, by moves."""
        u, c = with_again(step.unknowns, step.begun.u), step.first.coefficients
        drawn = moved_again(without, u, c, step.begun.columns, self.random_state, FROM_NEAR)
        return _at(step.first, step.unknowns, _unknowns_of(drawn), drawn.coefficients)

    def _fit_without(self, without: Problem, powers: Powers) -> Posterior:
        """Return draws given all rows but one, from those given all of them where these serve."""
        n, random = min(self.fit.first.n_draws, 2 * FEW_DRAWS), self.random_state
        known = carried(without, powers, self.fit.proposals, n, _N_REPEATS * FEW_DRAWS, random)
        if known is None:
            known = fit_problem(without, powers, self.sampler, n, random)
        return known.second


def _given_others(
    problem: Problem, posterior: Posterior, index: NDArray[np.intp], less: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return log densities (S, m) of rows, and what leaving them out takes from those of draws."""
    # the coefficients of causes are integrated out where they are Gaussian
    if problem.collapses and len(problem.model.column_sd):
        return without_each(problem, posterior, index, less)
    density = _log_likelihood(problem, posterior, index)
    return density, less * density


def _evenly(share: FloatArray, n: int, random_state: np.random.RandomState) -> NDArray[np.intp]:
    """Return n positions by their shares, from one random number."""
    cumulative = np.cumsum(share)
    even = (np.arange(n) + random_state.uniform()) / n
    return np.minimum(np.searchsorted(cumulative, even * cumulative[-1]), len(share) - 1)


def _without(problem: Problem, powers: Powers, i: np.intp, less: float) -> tuple[Problem, Powers]:
    """Return a problem, and its powers, whose row i has less weight, or is gone."""
    weights = problem.weights.copy()
    weights[i] -= less
    # what rounding leaves of a whole row is nothing
    rest = weights > 1e-9 * problem.weights
    rows = {name: getattr(problem, name)[rest] for name in ("X", "y", "observed")}
    without = replace(problem, weights=weights[rest], **rows)
    if isinstance(powers[1], float | int):
        return without, powers
    return without, (powers[0], powers[1][rest])


def _unknowns_of(drawn: MeasuredDraws) -> FloatArray:
    return np.column_stack([drawn.z, np.log(drawn.sigma)])


def _at(first: Posterior, unknowns: FloatArray, u: FloatArray, columns: FloatArray) -> Posterior:
    """Return draws of step 1, of given unknowns, with u of step 2 in place."""
    u = with_again(unknowns, u)
    return replace(
        first,
        values=first.model.values(u[:, :-1]),
        sigma=np.exp(u[:, -1]),
        effect_coefficients=columns,
    )


def _log_likelihood(problem: Problem, posterior: Posterior, index: NDArray[np.intp]) -> FloatArray:
    """Return log densities (S, m) of rows, given what else of their measurement is correlated."""
    if posterior.model.correlated:
        posterior = replace(posterior, model=replace(posterior.model, given_all=True))
        eta, noise = (values[:, index] for values in posterior.eta(problem.X))
    else:
        eta, noise = posterior.eta(problem.X[index])
    return posterior.likelihood.log_density(problem.observed[index], eta, noise)
