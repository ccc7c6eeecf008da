"""A grid over one or two parameters, each draw of the coefficients with its own weights on it.

Where the posterior of each draw is narrow and at a different place, proposals that all draws share
are too few: Newton steps of all draws at once go from a start to the mode of each, and importance
weights are given to some proposals around it.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from hybridsurrogate.inference.conditional.pairwise_squares import (
    MeasuredGiven,
    main_directions,
    node_shares,
    one_node_each,
    quality,
    squares_of_factors,
    squares_of_pairs,
)
from hybridsurrogate.inference.conjugate.noise_marginal import marginal_over_noise, noise_grid
from hybridsurrogate.inference.sampling.modes import (
    PROPOSAL_SCALE,
    factors,
    optimise_density,
    standard_student,
    standard_student_draws,
)
from hybridsurrogate.inference.sampling.settings import SETTINGS
from hybridsurrogate.model.statistics import prior_log_density, prior_of_unknowns
from hybridsurrogate.numerics.linear_algebra import NEGLIGIBLE, blocks, log_det_of, nudged_cholesky
from hybridsurrogate.priors import Z_LIMIT
from hybridsurrogate.types import FloatArray


class OwnDraws(NamedTuple):
    """Points u for each coefficient draw, and how well the proposals suit them.

    Attributes
    ----------
    u : ndarray of shape (S, d)
    khat : float
        Median Pareto shape over draws.
    effective : float
        Median number of proposals that share a draw's weight.
    """

    u: FloatArray
    khat: float
    effective: float


def own_draws(
    problem: MeasuredGiven,
    starts: FloatArray,
    random_state: np.random.RandomState,
) -> OwnDraws:
    """Draw u = [z, log sigma] given each coefficient draw.

    Parameters
    ----------
    starts : ndarray of shape (M, S, d)
        M places for each draw, of which the likeliest is taken.
    """
    log_density = partial(log_density_of_pairs, problem)
    M, S, d = starts.shape
    value = log_density(starts.reshape(-1, d), np.tile(np.arange(S), M)).reshape(M, S)
    first = value.argmax(axis=0), np.arange(S)
    # a start where the simulation fails stays where it is
    value = np.maximum(value[first], np.finfo(float).min / 2)
    mode, _, hessian = optimise_density(log_density, starts[first], value)
    factor = PROPOSAL_SCALE * factors(hessian)
    scaled = standard_student_draws((SETTINGS.draw_proposals, S, d), random_state)
    points = mode + np.einsum("sij,msj->msi", factor, scaled)
    log_weight = log_density(points.reshape(-1, d), np.tile(np.arange(S), SETTINGS.draw_proposals))
    log_weight = log_weight.reshape(SETTINGS.draw_proposals, S) - standard_student(
        np.sum(scaled**2, axis=2), d
    )
    share = node_shares(log_weight)
    pick = one_node_each(share, random_state)
    return OwnDraws(points[pick, np.arange(S)], *quality(log_weight, share, 100))


def log_density_of_pairs(
    problem: MeasuredGiven, u: FloatArray, which: NDArray[np.intp]
) -> FloatArray:
    """Return the log density of points u (K, d), each given one coefficient draw, (K,).

    The causes' coefficients a ~ N(0, diag(sd^2)) are integrated out by Woodbury's identity.
    """
    numbers = problem.n_rows * (1 + len(problem.model.column_sd))
    return np.concatenate(
        [_log_density(problem, u[some], problem.c[which[some]]) for some in blocks(len(u), numbers)]
    )


def _log_density(problem: MeasuredGiven, u: FloatArray, c: FloatArray) -> FloatArray:
    residual, columns, log_det = problem.of_pairs(u, c)
    squares = np.sum(residual**2, axis=1)
    if q := columns.shape[2]:
        transposed = np.swapaxes(columns, 1, 2)
        factor = nudged_cholesky(np.eye(q) + transposed @ columns)
        log_det = log_det + log_det_of(factor)
        half = np.linalg.solve(factor, transposed @ residual[..., None])[..., 0]
        squares = np.maximum(squares - np.sum(half**2, axis=1), 0.0)
    squares += problem.weights.sum() * (NEGLIGIBLE * problem.scale / np.exp(u[:, -1])) ** 2
    out = prior_of_unknowns(u, problem.noise_prior) - log_det - 0.5 * squares
    return np.where(np.isfinite(out), out, -np.inf)


# along each parameter, by the number of parameters
GRID_NODES = {0: 1, 1: 101, 2: 41}
# a posterior on fewer nodes than this gets a grid this many times finer
_FEW_NODES = {1: 8.0, 2: 50.0}
_REFINEMENT = {1: 10, 2: 3}


def grid_draws(
    problem: MeasuredGiven, sigma: float, random_state: np.random.RandomState
) -> tuple[FloatArray, bool]:
    """Draw u = [z, log sigma] (S, d + 1), one for each coefficient draw.

    The grid spans first the whole prior, then the place where the posterior lies. The second value
    is whether its cells are smaller than the posterior of most draws.
    """
    d = problem.model.n_unknowns
    low, high = np.full(d, -Z_LIMIT), np.full(d, Z_LIMIT)
    noise = noise_grid(problem.noise_prior, problem.scale, problem.weights.sum())

    def evaluated(nodes: FloatArray) -> tuple[FloatArray, FloatArray]:
        squares = _sums_of_squares(main_directions(problem, nodes, sigma), nodes)
        marginal = marginal_over_noise(squares, problem.weights.sum(), *noise)
        return squares, node_shares(marginal + prior_log_density(nodes)[:, None])

    nodes, width = _grid(low, high, GRID_NODES[d])
    squares, share = evaluated(nodes)
    if d:
        # the box around the nodes that hold mass
        kept = nodes[_holds_mass(share.mean(axis=1))]
        low, high = kept.min(axis=0) - width / 2, kept.max(axis=0) + width / 2
        nodes, width = _grid(low, high, GRID_NODES[d])
        squares, share = evaluated(nodes)
    # far from the simulation's guidance each draw has a narrow posterior at a different place
    if d and np.median(1 / np.sum(share**2, axis=0)) < _FEW_NODES[d]:
        nodes, width = _finer(nodes, share.mean(axis=1), width, _REFINEMENT[d])
        squares, share = evaluated(nodes)
    pick = one_node_each(share, random_state)
    S = len(problem.c)
    z = nodes[pick] + width * (random_state.uniform(size=(S, d)) - 0.5)
    # sigma at the node, not at the jittered point: the jitter is below the posterior's width
    log_sigma = _draw_noise(
        squares[pick, np.arange(S)], problem.weights.sum(), *noise, random_state
    )[:, None]
    u, at_node = np.hstack([z, log_sigma]), np.hstack([nodes[pick], log_sigma])
    every = np.arange(S)
    change = log_density_of_pairs(problem, u, every) - log_density_of_pairs(problem, at_node, every)
    return u, bool(np.median(np.abs(change)) < SETTINGS.node_density_change)


def _grid(low: FloatArray, high: FloatArray, n: int) -> tuple[FloatArray, FloatArray]:
    width = (high - low) / n
    axes = [start + step * (np.arange(n) + 0.5) for start, step in zip(low, width, strict=True)]
    if not axes:
        return np.zeros((1, 0)), width
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes)), width


def _holds_mass(share: FloatArray) -> NDArray[np.bool_]:
    """Return which nodes hold all but a millionth of the mass."""
    order = np.argsort(share)
    keep = np.empty(len(share), dtype=bool)
    keep[order] = np.cumsum(share[order]) > 1e-6
    return keep


def _finer(
    nodes: FloatArray, share: FloatArray, width: FloatArray, times: int
) -> tuple[FloatArray, FloatArray]:
    """Cut the cells of a grid that hold mass, and their neighbours, so many times a side."""
    d = nodes.shape[1]
    side = round(len(nodes) ** (1 / d))
    neighbours = np.ones((3,) * d)
    kept = binary_dilation(_holds_mass(share).reshape((side,) * d), neighbours).ravel()
    offsets, _ = _grid(-width / 2, width / 2, times)
    return (nodes[kept][:, None] + offsets).reshape(-1, d), width / times


def _sums_of_squares(problem: MeasuredGiven, z: FloatArray) -> FloatArray:
    """Return the residual sums of squares of every node and draw, (J, S)."""
    model, rows = problem.model, problem.features_and_rest
    rounding = problem.weights.sum() * (NEGLIGIBLE * problem.scale) ** 2
    values = model.values(z)
    if rows is not None:
        of_inputs, rest = rows
        of_parameters = problem.parameters_part(values)
        return squares_of_factors(of_inputs, of_parameters, rest, problem.draws) + rounding
    root = np.sqrt(problem.weights)[:, None]
    squares = np.empty((len(z), len(problem.c)))
    for block in blocks(len(z), len(problem.y) * (1 + problem.c.shape[1])):
        parts = model.parts(problem.X, values[block])
        scale = root / parts.noise[..., None]
        residual = (problem.y - parts.known)[..., None] * scale
        squares[block] = squares_of_pairs(parts.features * scale, residual, problem.draws)
    return squares + rounding


def _draw_noise(
    squares: FloatArray,
    n: float,
    log_sigma: FloatArray,
    log_weight: FloatArray,
    random_state: np.random.RandomState,
) -> FloatArray:
    """Draw log sigma given each sum of squares, by inversion on a grid around its own mode."""
    # the likelihood alone has its mode at sqrt(SS / n) and a spread of 1 / sqrt(2 n) in log sigma
    spread = 8 / np.sqrt(2 * n) + 0.05
    centre = 0.5 * np.log(squares / n)
    low = np.clip(centre - spread, log_sigma[0], log_sigma[-1])
    high = np.clip(centre + spread, log_sigma[0], log_sigma[-1])
    low, high = np.where(low < high, [low, high], log_sigma[[0, -1]][:, None])
    nodes = low[:, None] + (high - low)[:, None] * np.linspace(0, 1, 81)
    prior = np.interp(nodes, log_sigma, log_weight, left=-np.inf, right=-np.inf)
    log_density = prior - n * nodes - 0.5 * squares[:, None] * np.exp(-2 * nodes)
    empty = ~np.isfinite(log_density).any(axis=1)
    if empty.any():  # the prior forbids the data's scatter: stay at its edge
        nodes[empty] = np.linspace(log_sigma[0], log_sigma[-1], nodes.shape[1])
        prior = np.interp(nodes[empty], log_sigma, log_weight)
        log_density[empty] = (
            prior - n * nodes[empty] - 0.5 * squares[empty, None] * np.exp(-2 * nodes[empty])
        )
    density = np.exp(log_density - log_density.max(axis=1, keepdims=True))
    pick = one_node_each(density.T, random_state)
    row = np.arange(len(squares))
    width = nodes[:, 1] - nodes[:, 0]
    drawn = nodes[row, pick] + width * (random_state.uniform(size=len(row)) - 0.5)
    # half of the cell of a node at an end lies beyond it
    drawn = nodes[:, 0] + np.abs(drawn - nodes[:, 0])
    return nodes[:, -1] - np.abs(nodes[:, -1] - drawn)
