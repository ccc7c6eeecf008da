"""Where an optimiser should start: the best prior points, the best nodes of each cause."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hybridsurrogate.effects.base import Cause
from hybridsurrogate.inference.evidence.grid import make_grid
from hybridsurrogate.inference.evidence.levenberg_marquardt import (
    best_of_global_starts,
    best_of_spread,
)
from hybridsurrogate.inference.evidence.long_grid import shortened
from hybridsurrogate.inference.evidence.marginal_likelihood import optimise
from hybridsurrogate.inference.sampling.settings import SETTINGS
from hybridsurrogate.inference.sampling.target import Target
from hybridsurrogate.model.statistics import ROUNDING, emulator_posterior
from hybridsurrogate.priors import to_normal
from hybridsurrogate.types import FloatArray

# places along one parameter, in standard normal coordinates: beyond, no prior has mass
_LINE = np.linspace(-6.5, 6.5, 41)
_SPACING = _LINE[1] - _LINE[0]


def starting_points(target: Target, random_state: np.random.RandomState) -> FloatArray:
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
    sigma = float(np.exp(base[0, -1]))
    causes: tuple[Cause, ...] = ()
    for cause in model.effects:
        causes = (*causes, cause)
        partial = replace(model, effects=causes)
        grid = make_grid(partial)
        before_it, z = z, np.concatenate([z, grid.neutral[len(z) :]])
        rows = partial, target.X, target.y, emulator
        grid = shortened(*rows, grid, z, sigma, 10 * target.scale)
        for round_ in range(SETTINGS.noise_refits):
            mode = optimise(
                partial, target.X, target.y, emulator, grid, z, sigma, 10 * target.scale
            )
            z = mode.z.copy()
            if not round_:
                floor = ROUNDING * target.scale
                args = partial, target.X, target.y, emulator, grid
                best = best_of_global_starts(*args, before_it, z, floor)
                if best is not None:
                    z = best
                    continue
            if len(grid.nodes):
                priors = [partial.priors[k] for k in grid.nodes]
                z[grid.nodes] = to_normal(priors, grid.points[mode.node])
            before = sigma
            sigma = max(float(np.sqrt(mode.squares / len(target.y))), ROUNDING * target.scale)
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
        model, floor = target.model, ROUNDING * target.scale
        emulator = emulator_posterior(model.basis, None)
        z, sigma = best_of_spread(model, target.X, target.y, emulator, floor)
        out.append(np.array([[*z, np.log(sigma)]]))
    return np.concatenate(out)


def _noise_levels(target: Target) -> FloatArray:
    """Return log noise scales to start from, spread over what data may have and the prior allows.

    A prior that knows the noise may have no mass at any of a few shares of the spread.
    """
    sigma = target.scale * np.array([1e-3, 0.03, 0.1, 0.3, 1.0])
    low, high = target.noise_prior.ppf([1e-3, 1 - 1e-3])
    if not ((low < sigma) & (sigma < high)).any():
        sigma = target.noise_prior.ppf([0.05, 0.25, 0.5, 0.75, 0.95])
    return np.log(np.maximum(sigma, 1e-300))


def _best_prior_points(target: Target, random_state: np.random.RandomState) -> FloatArray:
    """Return the local maxima among points spread over the prior and beyond, best first.

    Posteriors can have a second mode far in a tail, where the surrogate bends back to the data.
    """
    d = target.n_dimensions - 1
    if d == 1:
        z = _LINE[:, None]
    else:
        z = random_state.standard_normal((1 + 40 * d, d))
        z[0], z[1::2] = 0.0, 2.5 * z[1::2]
    log_sigma = _noise_levels(target)
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
    return u[peaks[np.argsort(-value[peaks])][: SETTINGS.max_starts]]
