"""Where an accepted cause is fixed while further ones are compared, and both refitted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hybridsurrogate.diagnosis.search.local_fit import (
    Fitted,
    highest,
    largest_size,
    node_evidence,
    settled,
    sigma_of,
)
from hybridsurrogate.effects.base import Nothing
from hybridsurrogate.inference.conjugate.noise_marginal import LogMarginal
from hybridsurrogate.inference.evidence.grid import Grid, make_grid, with_cells
from hybridsurrogate.inference.evidence.settings import SETTINGS
from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.model.problem import Problem
from hybridsurrogate.model.statistics import EmulatorPosterior
from hybridsurrogate.priors import to_normal
from hybridsurrogate.types import FloatArray


def nothing_further(
    problem: Problem, accepted: Fitted, emulator: EmulatorPosterior, noise: LogMarginal
) -> Fitted:
    """Fit "nothing else is wrong" from the fit of the accepted cause."""
    model = problem.model.with_effects((*problem.model.effects, Nothing()))
    grid = make_grid(model)
    mode = highest(
        problem,
        emulator,
        model,
        grid,
        conditioned_places(problem, accepted, emulator, noise),
        accepted.sigma,
    )
    return Fitted(model, grid, mode, sigma_of(problem, mode, accepted.sigma))


def conditioned_places(
    problem: Problem, accepted: Fitted, emulator: EmulatorPosterior, noise: LogMarginal
) -> list[FloatArray]:
    """Return where an accepted cause can be fixed: at the mean of its place, or at the best node.

    The mean is the better place, but only on the hill on which the best node is.
    """
    model, grid, mode, _ = accepted
    if not len(grid.nodes):
        return [mode.z]
    places = [_mean_node(problem, accepted, emulator, noise)]
    low, high = grid.edges[mode.node].T
    if not np.all((places[0] >= low) & (places[0] <= high)):
        places.append(grid.points[mode.node])
    out = np.repeat(mode.z[None], len(places), axis=0)
    out[:, grid.nodes] = [to_normal([model.priors[k] for k in grid.nodes], p) for p in places]
    return list(out)


def placed_anew(
    problem: Problem,
    model: MeasuredModel,
    starts: Sequence[FloatArray],
    sigma: float,
    cells: Grid,
    emulator: EmulatorPosterior,
    noise: LogMarginal,
) -> Fitted:
    """Fit a model from starts near its mode, its last cause's grid as fine as it already was."""
    grid = with_cells(make_grid(model), cells.edges, cells.log_weight)
    mode = highest(problem, emulator, model, grid, starts, sigma)
    return settled(problem, emulator, noise, Fitted(model, grid, mode, sigma))


def _mean_node(
    problem: Problem, accepted: Fitted, emulator: EmulatorPosterior, noise: LogMarginal
) -> FloatArray:
    """Return the mean of the enumerated coordinates, (len(nodes),), around the best node.

    A node is only as near as its cell is small, and what it misses would look like another cause.
    """
    grid = accepted.grid
    sizes = np.array([largest_size(problem)])
    log_evidence = node_evidence(problem, emulator, noise, accepted, sizes)
    best = int(np.argmax(log_evidence))
    reach = SETTINGS.same_mode * np.diff(grid.edges[best], axis=1)[:, 0]
    near = np.all(np.abs(grid.points - grid.points[best]) <= reach, axis=1)
    weight = np.exp(log_evidence - log_evidence[best]) * near
    return weight @ grid.points / weight.sum()
