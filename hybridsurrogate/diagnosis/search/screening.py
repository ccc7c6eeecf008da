"""Where each cause fits best: one optimisation, and more where that looks promising."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hybridsurrogate.diagnosis.search.context import Fitted, InterruptedSearch, SearchContext
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.inference.evidence.grid import Grid, make_grid, refine, with_cells
from hybridsurrogate.inference.evidence.levenberg_marquardt import (
    best_of_global_starts,
    best_of_many,
    is_followed,
)
from hybridsurrogate.inference.evidence.long_grid import shortened
from hybridsurrogate.inference.evidence.marginal_likelihood import LocalMode
from hybridsurrogate.inference.evidence.settings import SETTINGS
from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.types import FloatArray


def best_modes(
    context: SearchContext,
    causes: Sequence[Cause],
    null: Fitted,
    log_prior: FloatArray,
    nearby: Sequence[Fitted] | None = None,
    is_sample: bool = False,
) -> tuple[list[Fitted], FloatArray]:
    """Fit every cause: from one start, and from more where that looks promising.

    ``log_prior`` is that of "nothing is wrong" and of every cause. ``nearby`` are the modes of the
    same causes in other rows of the same data: they stand for that first optimisation, and what is
    promising is followed from there alone, to the end where those were a sample of these rows. An
    `InterruptedSearch` contains the fits of the first so many causes.

    Returns
    -------
    fits : list of Fitted
    behind : ndarray
        Log evidence of the causes that are far behind, on the first grid; NaN for the others.
    """
    problem = context.problem
    fits: list[Fitted] = []
    try:
        for k, cause in enumerate(causes):
            model = problem.model.with_effects((*problem.model.effects, cause))
            grid = make_grid(model)
            if is_followed(cause):
                # with every unknown followed a start is a choice, which other rows must not make
                fits.append(_followed(context, model, grid, null))
            elif nearby is None or model.effects[-1].is_correlated_noise:
                fits.append(_once(context, model, grid, null))
            else:
                fits.append(_unchanged(context, model, grid, nearby[k], null))
        # a first fit may have found a lower mode on too coarse a grid; where those in other rows
        # ended is nearly it, and what had a chance there has a finer grid already
        is_coarse = nearby is None or is_sample
        margin = SETTINGS.behind if is_coarse else SETTINGS.behind_nearby
        behind = _far_behind(context, [null, *fits], log_prior, margin)
        for k in map(int, np.flatnonzero(np.isnan(behind))):
            if causes[k].is_correlated_noise or is_followed(causes[k]):
                continue
            # where those in other rows ended the grid is fine already
            rounds = None if is_coarse else SETTINGS.refinements_nearby
            fits[k] = context.converge(fits[k], rounds)
    except KeyboardInterrupt as stop:
        raise InterruptedSearch(fits) from stop
    return fits, behind


def _followed(
    context: SearchContext,
    model: MeasuredModel,
    grid: Grid,
    null: Fitted,
) -> Fitted:
    """Fit a cause whose unknowns are all followed, from many starts."""
    X, y, emulator = context.problem.X, context.problem.y, context.emulator
    plain, floor = grid.followed(), SETTINGS.exact_fit * null.sigma
    z, sigma = best_of_many(model, X, y, emulator, grid, null.mode.z, floor)
    mode = context.climb(model, plain, [z], sigma)
    return context.converge(Fitted(model, plain, mode, sigma))


def _unchanged(
    context: SearchContext, model: MeasuredModel, grid: Grid, other: Fitted, null: Fitted
) -> Fitted:
    """Return the fit to other rows as one to these, on the grid refined there, not optimised.

    Causes that were accepted are fixed where they are in these rows.
    """
    grid = with_cells(grid, other.grid.edges, other.grid.log_weight)
    if not np.isfinite(other.mode.objective):
        return Fitted(model, grid, other.mode, other.sigma)
    z, accepted = other.mode.z.copy(), slice(model.n_parameters, len(null.mode.z))
    z[accepted] = null.mode.z[accepted]
    mode = LocalMode(z, len(context.problem.y) * other.sigma**2, 0.0, 0)
    return Fitted(model, grid, mode, other.sigma)


def _once(
    context: SearchContext,
    model: MeasuredModel,
    grid: Grid,
    null: Fitted,
) -> Fitted:
    """Climb once, on the first grid."""
    starts, sigma = _starts(model, grid, null), null.sigma
    args = model, context.problem.X, context.problem.y, context.emulator
    grid = shortened(*args, grid, starts[0], sigma, context.largest_size)
    if model.effects[-1].is_correlated_noise:
        # left free it would take all the noise there is: it has the size of the noise
        size = sigma * context.problem.unit_noise
        mode = context.optimise(model, grid, starts[0], sigma, size=size)
        return Fitted(model, grid, mode, sigma)
    mode = context.climb(model, grid, starts, sigma)
    start = best_of_global_starts(*args, grid, null.mode.z, mode.z, SETTINGS.exact_fit * null.sigma)
    if start is not None:
        mode = context.climb(model, grid, [start], sigma)
    for _ in range(SETTINGS.looks):
        before, sigma = sigma, context.noise_of(mode, sigma)
        if not sigma < SETTINGS.much_closer * before:
            break
        # kept at the priors by the noise of a poor fit, an optimisation ends short of a good one
        mode = context.climb(model, grid, [mode.z], sigma)
    return Fitted(model, grid, mode, sigma)


def _far_behind(
    context: SearchContext,
    fits: Sequence[Fitted],
    log_prior: FloatArray,
    margin: float,
) -> FloatArray:
    """Return the log evidence of causes that are far behind; NaN for the others, failed or not.

    By more than ``margin``, in nats with the prior odds.

    The first of the fits is that of "nothing is wrong". The stronger the data, the more a grid
    misses between its nodes: what a finer one reaches counts, too.
    """
    sizes = context.sizes(fits)
    scans = [context.evidence_of_nodes(fit, sizes) for fit in fits]
    reached = np.array([np.logaddexp.reduce(nodes) for nodes in scans])
    # a curve of any shape reaches high at once: what has a name is compared with its like; what
    # could not be followed at all gets its other starting points, too
    of_any_shape = [any(e.kind == "unexplained" for e in fit.model.effects[-1:]) for fit in fits]
    weight = np.where(np.isfinite(reached), reached + log_prior, -np.inf)
    enough = np.max(weight[~np.array(of_any_shape)], initial=-np.inf) - margin
    behind = weight < enough
    for k in map(int, np.flatnonzero(behind & np.isfinite(reached))):
        if len(fits[k].grid.nodes):
            missed = _between_nodes(context, fits[k], scans[k], sizes)
            # what gains so much without an optimisation may gain as much again by one
            behind[k] = weight[k] + missed < enough and missed < margin
    return np.where(behind & np.isfinite(reached), reached, np.nan)[1:]


def _between_nodes(
    context: SearchContext,
    fit: Fitted,
    nodes: FloatArray,
    sizes: FloatArray,
) -> float:
    """Return how many nats more a finer grid around the best nodes reaches, not optimised."""
    density = nodes - fit.grid.log_weight
    coarse = float(density.max())
    for _ in range(SETTINGS.looks):
        index = np.argsort(-density)[: SETTINGS.looked_between]
        best = fit.grid.at(index)
        finer = refine(fit.model, best, density[index] + best.log_weight)
        if finer is best:
            break
        fit = fit._replace(grid=finer)
        density = context.evidence_of_nodes(fit, sizes) - finer.log_weight
    return max(float(density.max()) - coarse, 0.0)


def _starts(model: MeasuredModel, grid: Grid, null: Fitted) -> list[FloatArray]:
    """Return starting points: the fit without the cause and, far from it, the prior's centre."""
    start = grid.neutral.copy()
    start[: len(null.mode.z)] = null.mode.z
    if np.linalg.norm(null.mode.z[: model.n_parameters]) <= SETTINGS.displaced:
        return [start]
    # the simulation's parameters start anew, accepted causes stay where they are
    anew = start.copy()
    anew[: model.n_parameters] = 0.0
    return [start, anew]
