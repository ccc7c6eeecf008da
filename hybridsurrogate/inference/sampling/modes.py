"""Starts and modes of a density, and the Gaussian (Laplace) approximation at each.

Densities take a batch of points (J, d) and return (J,), so every step is one call.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import special

from hybridsurrogate.effects.base import Cause
from hybridsurrogate.inference.conjugate.target import PowerScaledPosterior, Target
from hybridsurrogate.inference.evidence.grid import make_grid
from hybridsurrogate.inference.evidence.levenberg_marquardt import (
    best_of_global_starts,
    best_of_spread,
)
from hybridsurrogate.inference.evidence.marginal_likelihood import optimise, shortened
from hybridsurrogate.inference.evidence.settings import SETTINGS as EVIDENCE
from hybridsurrogate.inference.sampling.settings import SETTINGS
from hybridsurrogate.model.statistics import emulator_posterior
from hybridsurrogate.numerics.linear_algebra import NEGLIGIBLE
from hybridsurrogate.priors import Z_LIMIT, to_normal
from hybridsurrogate.types import FloatArray

# of proposals: with 10, k-hats of 36 fits are 0.10 (standard error 0.04) larger, with 2.5 they are
# the same
_DEGREES_OF_FREEDOM = 5.0
# of its standard deviations: at 1.0, those of 176 fresh densities are off by 0.004 (standard error
# 0.001) more on average
PROPOSAL_SCALE = 1.1
# places along one parameter, in standard normal coordinates: beyond, no prior has mass
_LINE = np.linspace(-Z_LIMIT, Z_LIMIT, 41)
_SPACING = _LINE[1] - _LINE[0]


def starting_points(
    target: PowerScaledPosterior, random_state: np.random.RandomState
) -> FloatArray:
    """Return points u from which an optimiser should climb: best prior draws, best nodes."""
    model = target.model
    bare = replace(model, effects=())
    base = _best_prior_points(target.with_model(bare), random_state)
    if not model.effects:
        return base
    z, z_hyper = np.split(base[0, :-1], [model.n_parameters])
    # causes are placed on the scale of eta, with the surrogate's hyperparameters where they are
    hyper = bare.values(base[:1, :-1])[0, model.n_parameters :]
    emulator = emulator_posterior(
        model.basis.given(hyper), target.run_statistics(hyper), target.simulation_power
    )
    model = replace(model, basis=model.basis.given(hyper))
    sigma, size, floor = float(np.exp(base[0, -1])), 10 * target.scale, NEGLIGIBLE * target.scale
    causes: tuple[Cause, ...] = ()
    for cause in model.effects:
        causes = (*causes, cause)
        partial = replace(model, effects=causes)
        grid = make_grid(partial)
        before_it, z = z, np.concatenate([z, grid.neutral[len(z) :]])
        rows = partial, target.X, target.y, emulator
        grid = shortened(*rows, grid, z, sigma, size)
        for round_ in range(EVIDENCE.probing_rounds):
            mode = optimise(*rows, grid, z, sigma, size, lambda sigma: np.maximum(sigma, floor))
            z = mode.z.copy()
            if not round_:
                best = best_of_global_starts(*rows, grid, before_it, z, floor)
                if best is not None:
                    z = best
                    continue
            if len(grid.nodes):
                priors = [partial.priors[k] for k in grid.nodes]
                z[grid.nodes] = to_normal(priors, grid.points[mode.node])
            before = sigma
            sigma = max(float(np.sqrt(mode.squares / len(target.y))), floor)
            if sigma > SETTINGS.converged_noise * before:
                break
    return np.array([[*z, *z_hyper, np.log(sigma * factor)] for factor in (1.0, 2.0)])


def further_points(target: Target, mode: FloatArray) -> FloatArray:
    """Return the other local maxima (m, d) on lines through a mode (d,), one a parameter.

    Far in the tail of a parameter's prior a surrogate may bend back to the data; random starts in
    several dimensions can miss that. The noise scale is free along the lines. Where a simulation
    itself has several on one line, as one that oscillates, the best end of many descents joins.
    """
    log_sigma = mode[-1] + np.log([0.3, 0.6, 1.0, 1.7, 3.0])
    out = [np.empty((0, len(mode)))]
    is_rough = False
    for k in range(target.model.n_parameters):
        points = np.tile(mode, (len(_LINE), len(log_sigma), 1))
        points[:, :, k] = _LINE[:, None]
        points[:, :, -1] = log_sigma
        value = target.search_density(points.reshape(-1, len(mode))).reshape(points.shape[:2])
        best = value.argmax(axis=1)
        height = np.concatenate([[-np.inf], value.max(axis=1), [-np.inf]])
        peaks = np.flatnonzero((height[1:-1] > height[2:]) & (height[1:-1] >= height[:-2]))
        # what lies next to the mode itself is known
        peaks = peaks[np.abs(_LINE[peaks] - mode[k]) > 2 * _SPACING]
        out.append(points[peaks, best[peaks]])
        is_rough |= len(peaks) > 1
    if is_rough and target.model.basis.is_simulation:
        model, floor = target.model, NEGLIGIBLE * target.scale
        emulator = emulator_posterior(model.basis, None)
        z, sigma = best_of_spread(model, target.X, target.y, emulator, floor)
        out.append(np.array([[*z, np.log(sigma)]]))
    return np.concatenate(out)


def _best_prior_points(
    target: PowerScaledPosterior, random_state: np.random.RandomState
) -> FloatArray:
    """Return the local maxima among points spread over the prior and beyond, best first.

    Posteriors can have a second mode far in a tail, where the surrogate bends back to the data.
    """
    d = target.n_dimensions - 1
    if d == 1:
        z = _LINE[:, None]
    else:
        z = random_state.standard_normal((1 + 40 * d, d))
        z[0], z[1::2] = 0.0, 2.5 * z[1::2]
    sigma = target.scale * np.array([1e-3, 0.03, 0.1, 0.3, 1.0])
    # a prior that knows the noise may have no mass at any of a few shares of the spread
    low, high = target.noise_prior.ppf([1e-3, 1 - 1e-3])
    if not ((low < sigma) & (sigma < high)).any():
        sigma = target.noise_prior.ppf([0.05, 0.25, 0.5, 0.75, 0.95])
    log_sigma = np.log(np.maximum(sigma, 1e-300))
    grid = np.concatenate(
        [np.repeat(z, len(log_sigma), axis=0), np.tile(log_sigma, len(z))[:, None]], axis=1
    )
    value = target.search_density(grid).reshape(len(z), -1)
    u = grid.reshape(len(z), len(log_sigma), -1)[np.arange(len(z)), value.argmax(axis=1)]
    value = value.max(axis=1)
    if not d:
        return u[:1]
    distance = np.linalg.norm(z[:, None] - z, axis=2)
    neighbours = np.argsort(distance, axis=1)[:, 1 : 2 * d + 1]
    peaks = np.flatnonzero(value >= value[neighbours].max(axis=1))
    return u[peaks[np.argsort(-value[peaks])][: SETTINGS.few_rounds]]


LogDensity = Callable[[FloatArray], FloatArray]
# log density of points (K, d) for the draws (K,) of something else that they are given
PairLogDensity = Callable[[FloatArray, NDArray[np.intp]], FloatArray]


class NothingPossibleError(ValueError):
    """The log density is minus infinity wherever it was computed."""


@dataclass(frozen=True)
class Gaussian:
    """A Gaussian approximation: mean (d,), lower Cholesky factor of its covariance (d, d).

    Proposals around it are a little wider, and Student-t.
    """

    mean: FloatArray
    factor: FloatArray
    log_mass: float

    def draws(self, n: int, random_state: np.random.RandomState) -> FloatArray:
        """Draw n proposals."""
        drawn = standard_student_draws((n, len(self.mean)), random_state)
        return self.mean + PROPOSAL_SCALE * drawn @ self.factor.T

    def log_density(self, x: FloatArray) -> FloatArray:
        """Return the log density of the proposals (J,) at points (J, d)."""
        factor = PROPOSAL_SCALE * self.factor
        scaled = np.linalg.inv(factor) @ (x - self.mean).T
        squares = np.einsum("dj,dj->j", scaled, scaled)
        return standard_student(squares, len(self.mean)) - np.log(np.diagonal(factor)).sum()


def standard_student_draws(
    shape: tuple[int, ...], random_state: np.random.RandomState
) -> FloatArray:
    """Draw standard Student-t variables; the last axis of the shape holds those of one point."""
    normal = random_state.standard_normal(shape)
    chi2 = random_state.chisquare(_DEGREES_OF_FREEDOM, size=(*shape[:-1], 1)) / _DEGREES_OF_FREEDOM
    return normal / np.sqrt(chi2)


def standard_student(squares: FloatArray, d: int) -> FloatArray:
    """Return the log density of d standard Student-t variables at a squared distance from 0."""
    nu = _DEGREES_OF_FREEDOM
    return (
        special.gammaln((nu + d) / 2)
        - special.gammaln(nu / 2)
        - 0.5 * d * np.log(nu * np.pi)
        - 0.5 * (nu + d) * np.log1p(squares / nu)
    )


# length of difference steps in standard deviations: five times as long for an approximation that is
# optimised, k-hat of 36 fits to counts and heavy tails is 0.002 lower (standard error 0.013)
STEP_SHARE = 0.1


def find_modes(
    log_density: LogDensity, starts: FloatArray, least_step: float = 0.0
) -> list[Gaussian]:
    """Climb from every start at once by damped Newton steps; return distinct modes, best first.

    Gradient and Hessian are central differences whose steps follow the curvature, all starts and
    all difference points in one call of the density.

    Parameters
    ----------
    log_density : callable
    starts : ndarray of shape (S, d)
    least_step : float
        Differences over less mean nothing.

    Returns
    -------
    list of Gaussian
        Laplace approximations with their log masses.

    Raises
    ------
    NothingPossibleError
        If no start is possible.
    ValueError
        If the density at the best is lost in rounding.
    """
    x = np.array(starts, dtype=float)
    value = log_density(x)
    alive = np.isfinite(value)
    if not alive.any():
        raise NothingPossibleError(
            "The log density is minus infinity at every starting point: the priors and the data "
            "contradict each other, or the simulation fails everywhere. Check priors and units."
        )
    x, value, hessian = optimise_density(
        lambda points, _: log_density(points),
        x[alive],
        value[alive],
        prune=True,
        least_step=least_step,
    )
    if np.spacing(np.abs(value.max())) > SETTINGS.mode_gain:
        raise ValueError(
            f"At the best parameters the log density is {value.max():.1g}, so low that rounding "
            "hides how it changes: the data are further from the simulation than any noise that "
            "its prior allows. Check that both have the same units and the same transformation."
        )
    factor = factors(hessian)
    log_det = np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1)
    log_mass = value + log_det + 0.5 * x.shape[1] * np.log(2 * np.pi)
    order = np.argsort(-value)
    return distinct([Gaussian(x[k].copy(), factor[k], float(log_mass[k])) for k in order])


def optimise_density(
    log_density: PairLogDensity,
    x: FloatArray,
    value: FloatArray,
    prune: bool = False,
    least_step: float = 0.0,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Climb from every start x (S, d) at once; return ends, their log densities and Hessians.

    With ``prune`` all starts climb the same density, and those far below the best stop.
    """
    x, value = x.copy(), value.copy()
    step = np.full(x.shape, max(1e-4, least_step))
    damping = np.full(len(x), 1e-3)
    active = np.ones(len(x), dtype=bool)
    slopes, curvatures = np.empty(x.shape), np.empty((*x.shape, x.shape[1]))
    known = np.zeros(len(x), dtype=bool)
    for iteration in range(SETTINGS.mode_steps):
        if prune and iteration >= 4:  # starts far below the best will not matter
            active &= value > value.max() - 25.0
        if not active.any():
            break
        index = np.flatnonzero(active)
        # a shorter trial after one that was rejected needs no derivatives anew
        anew = index[~known[index]]
        if len(anew):
            slopes[anew], curvatures[anew] = _differences(
                log_density, anew, x[anew], value[anew], step[anew]
            )
        gradient, curvature = slopes[index], curvatures[index]
        move = _newton_move(gradient, curvature, damping[index])
        trial = x[index] + move
        trial_value = log_density(trial, index)
        better = trial_value > value[index]
        # where Newton's step, not the damped one, promises nothing, rounding rejects it
        promised = np.einsum("jk,jk->j", move, gradient) * (1 + damping[index])
        gain = np.where(better, trial_value - value[index], promised)
        x[index[better]] = trial[better]
        value[index[better]] = trial_value[better]
        damping[index] = np.clip(np.where(better, 0.1, 8.0) * damping[index], 1e-9, 1e9)
        diagonal = np.abs(np.einsum("jkk->jk", curvature))
        share = STEP_SHARE * np.clip(1 / np.sqrt(np.maximum(diagonal, 1e-8)), 1e-7, 0.5)
        before, step[index] = step[index], np.maximum(share, least_step)
        known[index] = ~better & np.all(np.abs(np.log2(step[index] / before)) < 1, axis=1)
        done = (gain < SETTINGS.mode_gain) | (damping[index] > 1e4)
        active[index[done]] = False
    _, hessian = _differences(log_density, np.arange(len(x)), x, value, step)
    return x, value, hessian


def _differences(
    log_density: PairLogDensity,
    index: NDArray[np.intp],
    x: FloatArray,
    value: FloatArray,
    step: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return gradients (S, d) and Hessians (S, d, d) by central differences."""
    S, d = x.shape
    unit = np.eye(d)
    pairs = [(i, j) for i in range(d) for j in range(i)]
    offsets = np.array(
        [*unit, *-unit]
        + [unit[i] + unit[j] for i, j in pairs]
        + [-unit[i] - unit[j] for i, j in pairs]
    )
    points = x[:, None, :] + offsets * step[:, None, :]
    values = log_density(points.reshape(-1, d), np.repeat(index, len(offsets))).reshape(S, -1)
    values = np.where(np.isfinite(values), values, value[:, None] - 1e6)
    plus, minus = values[:, :d], values[:, d : 2 * d]
    gradient = (plus - minus) / (2 * step)
    hessian = np.empty((S, d, d))
    hessian[:, np.arange(d), np.arange(d)] = (plus + minus - 2 * value[:, None]) / step**2
    for k, (i, j) in enumerate(pairs):
        both = values[:, 2 * d + k] + values[:, 2 * d + len(pairs) + k]
        single = plus[:, i] + minus[:, i] + plus[:, j] + minus[:, j]
        mixed = (both - single + 2 * value) / (2 * step[:, i] * step[:, j])
        hessian[:, i, j] = hessian[:, j, i] = mixed
    return gradient, hessian


def _newton_move(gradient: FloatArray, hessian: FloatArray, damping: FloatArray) -> FloatArray:
    """Return the damped Newton step; directions that curve upwards are walked along anyway."""
    eigenvalue, vector = np.linalg.eigh(-hessian)
    size = np.abs(eigenvalue) + damping[:, None] * np.maximum(
        np.abs(eigenvalue).max(axis=1, keepdims=True), 1.0
    )
    along = np.einsum("jki,jk->ji", vector, gradient) / np.maximum(size, 1e-10)
    move = np.einsum("jki,ji->jk", vector, along)
    length = np.linalg.norm(move, axis=1, keepdims=True)
    return move * np.minimum(1.0, 2.0 / np.maximum(length, 1e-300))


def factors(hessian: FloatArray) -> FloatArray:
    """Return lower factors (S, d, d) of the covariances that Hessians (S, d, d) stand for."""
    # saddles and rounding: no direction is wider than a few of the prior's deviations
    eigenvalue, vector = np.linalg.eigh(-hessian)
    eigenvalue = np.clip(eigenvalue, 0.05, 1e10)
    return np.linalg.cholesky((vector / eigenvalue[:, None, :]) @ np.swapaxes(vector, 1, 2))


def distinct(found: list[Gaussian]) -> list[Gaussian]:
    """Return the modes that are not repetitions of an earlier one, the largest mass first."""
    modes: list[Gaussian] = []
    for new in found:
        inside = any(
            np.linalg.norm(np.linalg.solve(mode.factor, new.mean - mode.mean))
            < 3.0 + len(mode.mean)
            for mode in modes
        )
        if not inside:
            modes.append(new)
    modes.sort(key=lambda mode: -mode.log_mass)
    return modes
