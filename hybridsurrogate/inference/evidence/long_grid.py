"""A long grid made short: frequencies of a wave in irregular rows are thousands.

An optimisation enumerates its grid at every step. So a grid with more nodes than can be kept is
looked at once, in pieces, around a fit without the cause, as a periodogram is; what follows has its
best nodes, and one node for each group of others that explain the rows as well as each other, with
the prior mass of all of them: the evidence of the whole grid stays an average over all of it.
"""

from __future__ import annotations

import numpy as np

from hybridsurrogate.inference.evidence.grid import Grid, with_cells
from hybridsurrogate.inference.evidence.linearised import is_long, linearised_pieces
from hybridsurrogate.inference.evidence.marginal_likelihood import scan
from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.model.statistics import EmulatorPosterior
from hybridsurrogate.types import FloatArray

# nodes that are kept each, and groups of others
_BEST, _GROUPS = 300, 100


def shortened(
    model: MeasuredModel,
    X: FloatArray,
    y: FloatArray,
    emulator: EmulatorPosterior,
    grid: Grid,
    z: FloatArray,
    sigma: float,
    size: float,
) -> Grid:
    """Return a grid that is short enough to be kept; the same where it is.

    Parameters
    ----------
    z : ndarray of shape (n_unknowns,)
        The fit without the last cause, which adds columns.
    sigma : float
        Noise there.
    size : float
        Prior scale of the effect's size, in units of y; large means free.
    """
    if not is_long(model, X, grid):
        return grid
    n = len(y)

    def free_noise(squares: FloatArray) -> FloatArray:
        return np.asarray(-0.5 * n * np.log(squares))

    density = np.concatenate(
        [
            scan(parts, y[None], sigma, free_noise, np.array([size]))[0] - parts.log_weight
            for parts in linearised_pieces(model, X, emulator, grid, z)
        ]
    )
    order = np.argsort(-density)
    groups = np.array_split(order[_BEST:], _GROUPS)
    middle = [group[len(group) // 2] for group in groups]
    weight = [np.logaddexp.reduce(grid.log_weight[group]) for group in groups]
    best = order[:_BEST]
    return with_cells(
        grid,
        np.concatenate([grid.edges[best], grid.edges[middle]]),
        np.concatenate([grid.log_weight[best], weight]),
    )
