"""Modes of a density, and the Gaussian (Laplace) approximation at each.

Densities take a batch of points (J, d) and return (J,), so every step is one call.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.inference.sampling.settings import SETTINGS
from hybridsurrogate.types import FloatArray

LogDensity = Callable[[FloatArray], FloatArray]
# log density of points (K, d) for the draws (K,) of something else that they are given
PairLogDensity = Callable[[FloatArray, NDArray[np.intp]], FloatArray]


class NothingPossibleError(ValueError):
    """The log density is minus infinity wherever it was computed."""


@dataclass(frozen=True)
class Gaussian:
    """A Gaussian approximation: mean (d,), lower Cholesky factor of its covariance (d, d)."""

    mean: FloatArray
    factor: FloatArray
    log_mass: float = 0.0


def find_modes(
    log_density: LogDensity, starts: FloatArray, step_share: float = 0.1, least_step: float = 0.0
) -> list[Gaussian]:
    """Climb from every start at once by damped Newton steps; return distinct modes, best first.

    Gradient and Hessian are central differences whose steps follow the curvature, all starts and
    all difference points in one call of the density.

    Parameters
    ----------
    log_density : callable
    starts : ndarray of shape (S, d)
    step_share : float
        Length of difference steps in standard deviations; longer ones even out a rough density.
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

    def any_start(points: FloatArray, _: NDArray[np.intp]) -> FloatArray:
        return log_density(points)

    x, value, hessian = optimise_density(
        any_start, x[alive], value[alive], step_share, SETTINGS.mode_steps, True, least_step
    )
    if np.spacing(np.abs(value.max())) > SETTINGS.mode_rounding:
        raise ValueError(
            f"At the best parameters the log density is {value.max():.1g}, so low that rounding "
            "hides how it changes: the data are further from the simulation than any noise that "
            "its prior allows. Check that both have the same units and the same transformation."
        )
    return distinct(_approximations(x, value, hessian))


def optimise_density(
    log_density: PairLogDensity,
    x: FloatArray,
    value: FloatArray,
    step_share: float,
    max_iter: int,
    prune: bool,
    least_step: float = 0.0,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Climb from every start x (S, d) at once; return ends, their log densities and Hessians.

    With ``prune`` all starts climb the same density, and those far below the best stop.
    """
    x, value = x.copy(), value.copy()
    step = np.full(x.shape, max(1e-4, least_step))
    damping = np.full(len(x), 1e-3)
    active = np.ones(len(x), dtype=bool)
    for iteration in range(max_iter):
        if prune and iteration >= 4:  # starts far below the best will not matter
            active &= value > value.max() - 25.0
        if not active.any():
            break
        index = np.flatnonzero(active)
        gradient, curvature = _differences(log_density, index, x[index], value[index], step[index])
        trial = x[index] + _newton_move(gradient, curvature, damping[index])
        trial_value = log_density(trial, index)
        better = trial_value > value[index]
        gain = np.where(better, trial_value - value[index], np.inf)
        x[index[better]] = trial[better]
        value[index[better]] = trial_value[better]
        damping[index] = np.clip(np.where(better, 0.1, 8.0) * damping[index], 1e-9, 1e9)
        diagonal = np.abs(np.einsum("jkk->jk", curvature))
        share = step_share * np.clip(1 / np.sqrt(np.maximum(diagonal, 1e-8)), 1e-7, 0.5)
        step[index] = np.maximum(share, least_step)
        done = (better & (gain < 1e-3)) | (damping[index] > 1e4)
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


def _approximations(x: FloatArray, value: FloatArray, hessian: FloatArray) -> list[Gaussian]:
    factor = factors(hessian)
    log_det = np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1)
    log_mass = value + log_det + 0.5 * x.shape[1] * np.log(2 * np.pi)
    order = np.argsort(-value)
    return [Gaussian(x[k].copy(), factor[k], float(log_mass[k])) for k in order]


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
