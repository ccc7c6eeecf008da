"""Which unknowns of a cause are enumerated, which are sizes, and the grid of the former."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.inference.evidence.settings import SETTINGS
from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.priors import prior_range, to_normal
from hybridsurrogate.types import FloatArray, Prior

# a constant may have been assumed at the very end of its prior, where z knows no slope: its search
# begins where the prior has mass. Sizes are counted from there and reach one prior sd, so that from
# any farther what lies beyond the prior's middle would be held against the constant.
_FARTHEST = 1.0


@dataclass(frozen=True)
class Grid:
    """Which coordinates of z are enumerated, which are sizes, and the grid.

    Attributes
    ----------
    fixed, sizes, nodes : ndarray of int
        Positions in z: unit-normal directions, sizes of the cause, enumerated coordinates.
    neutral : ndarray of shape (n_unknowns,)
        z at which the cause changes nothing, zero elsewhere.
    points : ndarray of shape (T, len(nodes))
        Values of the enumerated coordinates in the user's units.
    edges : ndarray of shape (T, len(nodes), 2)
        The cell around each node.
    log_weight : ndarray of shape (T,)
        Log prior mass of each node, that of what it stands for included; all nodes of the first
        grid together have one.
    exact : bool
        Whether nothing changes within a cell, so that a finer grid would be no better.
    """

    fixed: NDArray[np.intp]
    sizes: NDArray[np.intp]
    nodes: NDArray[np.intp]
    neutral: FloatArray
    points: FloatArray
    edges: FloatArray
    log_weight: FloatArray
    exact: bool = False

    def followed(self) -> Grid:
        """Return the grid with nothing enumerated: what was is followed like a parameter."""
        return replace(
            self,
            fixed=np.concatenate([self.fixed, self.nodes]),
            nodes=self.nodes[:0],
            points=np.empty((1, 0)),
            edges=np.empty((1, 0, 2)),
            log_weight=np.zeros(1),
        )

    def is_neutral(self, z: FloatArray) -> bool:
        """Return whether at z the sizes change nothing, whatever the node."""
        neutral = self.neutral[self.sizes]
        return bool(np.all(z[self.sizes] == neutral) and np.all(np.abs(neutral) < _FARTHEST))

    def mass_under(self, model: MeasuredModel, own: MeasuredModel) -> FloatArray:
        """Return the log prior mass (T,) of its nodes under the priors of another model."""
        there, here = (_log_mass(one, self, self.edges) for one in (model, own))
        return self.log_weight + there - here

    def at(self, index: NDArray[np.intp]) -> Grid:
        """Return the grid at some of its nodes."""
        return replace(
            self,
            points=self.points[index],
            edges=self.edges[index],
            log_weight=self.log_weight[index],
        )


def make_grid(model: MeasuredModel) -> Grid:
    """Return the grid for the last cause of a model; earlier causes count as fixed shapes.

    Enumerated unknowns of an earlier cause are fixed at their estimates.
    """
    last = len(model.effects) - 1
    grids = [effect.grid() for effect in model.effects]
    neutral = np.zeros(model.n_unknowns)
    sizes, nodes, conditioned, cells = [], [], [], []
    axes: dict[str, FloatArray] = grids[last] if model.effects else {}
    start = model.effects[last].start() if model.effects else {}
    for position, (owner, name) in enumerate(model.theta_names, start=model.n_parameters):
        if owner != last:
            if name in grids[owner]:
                conditioned.append(position)
            continue
        prior = model.priors[position]
        if name in axes:
            nodes.append(position)
            cells.append(_cells(axes[name], prior))
        elif name in start:
            sizes.append(position)
            neutral[position] = np.clip(to_normal([prior], [start[name]])[0], -_FARTHEST, _FARTHEST)
    mesh = np.meshgrid(*(np.arange(len(cell)) for cell in cells), indexing="ij")
    index = [axis.ravel() for axis in mesh]
    edges = np.empty((1, 0, 2))
    if nodes:
        edges = np.stack([cell[k] for cell, k in zip(cells, index, strict=True)], axis=1)
    taken = {*sizes, *nodes, *conditioned}
    fixed = [k for k in range(model.n_unknowns) if k not in taken]
    places = [np.array(some, dtype=int) for some in (fixed, sizes, nodes)]
    exact = all(np.ndim(axis) == 2 for axis in axes.values())
    none = np.empty((0, 0)), edges, np.empty(0)
    grid = Grid(places[0], places[1], places[2], neutral, *none, exact)
    log_mass = _log_mass(model, grid, edges)
    # scipy's logsumexp costs a fifth of a millisecond, whatever the size
    return with_cells(grid, edges, log_mass - np.logaddexp.reduce(log_mass))


def _cells(nodes: FloatArray, prior: Prior) -> FloatArray:
    """Return cells (T, 2): those given, or from halfway between nodes to the ends of the prior."""
    if nodes.ndim == 2:
        return nodes
    low, high = prior_range(prior)
    middle = 0.5 * (nodes[1:] + nodes[:-1])
    borders = np.concatenate([[min(low, nodes[0])], middle, [max(high, nodes[-1])]])
    return np.column_stack([borders[:-1], borders[1:]])


def with_cells(grid: Grid, edges: FloatArray, log_weight: FloatArray) -> Grid:
    """Return the grid with other cells of known weight, nodes in their middle."""
    return replace(grid, points=edges.mean(axis=2), edges=edges, log_weight=log_weight)


def _log_mass(model: MeasuredModel, grid: Grid, edges: FloatArray) -> FloatArray:
    """Return the log prior mass of cells (T, len(nodes), 2)."""
    log_mass = np.zeros(len(edges))
    for k, position in enumerate(grid.nodes):
        mass = np.diff(model.priors[position].cdf(edges[:, k]), axis=1)[:, 0]
        log_mass += np.log(np.maximum(mass, 1e-300))
    return log_mass


def refine(model: MeasuredModel, grid: Grid, log_evidence: FloatArray) -> Grid:
    """Split the cells that carry the evidence, three ways along every axis; keep all others.

    Cells that are not split keep their prior mass: the evidence is an average over all of the
    prior.

    Parameters
    ----------
    log_evidence : ndarray of shape (T,)
        As from `scan`, for one response.

    Returns
    -------
    Grid
        The same grid when it is exact or enough nodes share the evidence already.
    """
    if grid.exact or not len(grid.nodes):
        return grid
    density = log_evidence - grid.log_weight
    if len(best_levels(grid, log_evidence)) >= SETTINGS.resolved_nodes ** len(grid.nodes):
        return grid
    split = density > density.max() - 30.0
    split &= np.argsort(np.argsort(-density)) < SETTINGS.max_split
    finer = divided(model, grid.at(np.flatnonzero(split)), 3)
    kept = ~split & (density > density.max() - SETTINGS.cell_margin)
    return with_cells(
        grid,
        np.concatenate([grid.edges[kept], finer.edges]),
        np.concatenate([grid.log_weight[kept], finer.log_weight]),
    )


def divided(model: MeasuredModel, grid: Grid, ways: int) -> Grid:
    """Return the grid with every cell cut so many ways along every axis.

    The pieces of a cell share its prior mass.
    """
    edges = grid.edges
    for k in range(len(grid.nodes)):
        borders = np.linspace(edges[:, k, 0], edges[:, k, 1], 1 + ways, axis=1)
        edges = np.repeat(edges, ways, axis=0)
        edges[:, k, 0], edges[:, k, 1] = borders[:, :-1].ravel(), borders[:, 1:].ravel()
    log_mass = _log_mass(model, grid, edges).reshape(len(grid.points), -1)
    log_mass += (grid.log_weight - np.logaddexp.reduce(log_mass, axis=1))[:, None]
    return with_cells(grid, edges, log_mass.ravel())


def best_levels(grid: Grid, log_evidence: FloatArray) -> FloatArray:
    """Return the different densities of the best nodes, within two nats, in rising order.

    Places of a jump between the same two rows are one: there may be a better one further on.
    """
    density = log_evidence - grid.log_weight
    return np.unique(np.round(density[density > density.max() - 2.0], 6))
