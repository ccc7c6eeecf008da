"""Step 2: the measured world given each draw of the surrogate's coefficients.

For every coefficient draw c_s the unknowns (omega, theta, sigma) and the causes' coefficients a
are inferred anew from their original priors and the full likelihood of the measured rows. All
draws share their nodes: the likelihood at node j and draw s is quadratic in c_s, so one matrix
product serves all pairs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.inference.importance import mixture_draws, moment_match
from hybridsurrogate.inference.measured import MeasuredModel, prior_log_density
from hybridsurrogate.inference.modes import Gaussian, find_modes
from hybridsurrogate.inference.noise import marginal_over_noise, noise_grid
from hybridsurrogate.inference.pareto import pareto_smooth
from hybridsurrogate.inference.statistics import ROUNDING
from hybridsurrogate.priors import FloatArray, Prior

_GRID_NODES = {0: 1, 1: 101, 2: 41}
_Z_RANGE = 7.0
# a posterior on fewer nodes than this gets a grid this many times finer
_FEW_NODES = {1: 8.0, 2: 50.0}
_REFINEMENT = {1: 10, 2: 3}
# numbers in one block of matrices
_BLOCK = 500_000
_N_PROPOSALS = 3000
_N_ROUNDS = 4


@dataclass(frozen=True)
class MeasuredDraws:
    """Draws of the measured world, one for each coefficient draw.

    Attributes
    ----------
    z : ndarray of shape (S, n_unknowns)
    sigma : ndarray of shape (S,)
    coefficients : ndarray of shape (S, q)
        Coefficients a of the causes.
    khat : float
        Median Pareto shape over draws; minus infinity on a grid, which has no weights.
    effective_draws : float
        Median over draws of the number of nodes that share its weight, or of the moves accepted;
        NaN on a grid.
    method : str
        "grid", "importance" or "moves".
    """

    z: FloatArray
    sigma: FloatArray
    coefficients: FloatArray
    khat: float
    effective_draws: float
    method: str


@dataclass(frozen=True)
class _Problem:
    model: MeasuredModel
    X: FloatArray
    y: FloatArray
    weights: FloatArray
    c: FloatArray
    noise_prior: Prior
    scale: float


def second_step(
    model: MeasuredModel,
    X: FloatArray,
    y: FloatArray,
    weights: FloatArray,
    coefficients: FloatArray,
    noise_prior: Prior,
    scale: float,
    first_step: FloatArray,
    random_state: np.random.RandomState,
) -> MeasuredDraws:
    """Draw (omega, theta, sigma, a) given each coefficient draw.

    Parameters
    ----------
    model : MeasuredModel
    X, y, weights : ndarray of shape (n, n_columns), (n,), (n,)
        Measured rows, y on the scale of eta, and powers of their likelihoods.
    coefficients : ndarray of shape (S, p)
    noise_prior : prior of sigma
    scale : float
        Spread of the output.
    first_step : ndarray of shape (S, d)
        Draws of u from step 1, which tell where the proposals should lie.
    random_state : RandomState

    Returns
    -------
    MeasuredDraws
    """
    problem = _Problem(model, X, y, weights, coefficients, noise_prior, scale)
    if model.n_unknowns in _GRID_NODES and not model.effects:
        return _on_grid(problem, random_state)
    return _by_proposals(problem, first_step, random_state)


# ------------------------------------------------------------------ one or two parameters: a grid


def _on_grid(problem: _Problem, random_state: np.random.RandomState) -> MeasuredDraws:
    """Draw on a grid over z, first over the whole prior, then where the posterior lies."""
    d = problem.model.n_unknowns
    low, high = np.full(d, -_Z_RANGE), np.full(d, _Z_RANGE)
    noise = noise_grid(problem.noise_prior, problem.scale, problem.weights.sum())
    nodes, width, squares, share = _weighed_grid(problem, low, high, _GRID_NODES[d], noise)
    if d:
        low, high = _occupied(nodes, share.mean(axis=1), width)
        nodes, width, squares, share = _weighed_grid(problem, low, high, _GRID_NODES[d], noise)
    # far from the simulation's guidance every draw has a narrow posterior at a place of its own
    if d and np.median(1 / np.sum(share**2, axis=0)) < _FEW_NODES[d]:
        n = _GRID_NODES[d] * _REFINEMENT[d]
        nodes, width, squares, share = _weighed_grid(problem, low, high, n, noise)
    pick = _one_index_per_column(share, random_state)
    S = len(problem.c)
    z = nodes[pick] + width * (random_state.uniform(size=(S, d)) - 0.5)
    # sigma at the node, not at the jittered point: the jitter is below the posterior's width
    chosen = squares[pick, np.arange(S)]
    sigma = _draw_noise(chosen, problem.weights.sum(), *noise, random_state)
    return MeasuredDraws(z, sigma, np.empty((S, 0)), -np.inf, np.nan, "grid")


def _grid(low: FloatArray, high: FloatArray, n: int) -> tuple[FloatArray, FloatArray]:
    width = (high - low) / n
    axes = [start + step * (np.arange(n) + 0.5) for start, step in zip(low, width, strict=True)]
    if not axes:
        return np.zeros((1, 0)), width
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes)), width


def _weighed_grid(
    problem: _Problem,
    low: FloatArray,
    high: FloatArray,
    n: int,
    noise: tuple[FloatArray, FloatArray],
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return nodes (J, d), their width, sums of squares (J, S) and posterior shares (J, S)."""
    nodes, width = _grid(low, high, n)
    squares = _sums_of_squares(problem, nodes)
    marginal = marginal_over_noise(squares, problem.weights.sum(), *noise)
    return nodes, width, squares, _shares(marginal + prior_log_density(nodes)[:, None])


def _occupied(
    nodes: FloatArray, share: FloatArray, width: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the box around the nodes that hold all but a millionth of the mass."""
    order = np.argsort(share)
    keep = order[np.cumsum(share[order]) > 1e-6]
    return nodes[keep].min(axis=0) - width / 2, nodes[keep].max(axis=0) + width / 2


def _sums_of_squares(problem: _Problem, z: FloatArray) -> FloatArray:
    """Return the residual sums of squares of every node and draw, (J, S)."""
    model, root = problem.model, np.sqrt(problem.weights)[:, None]
    parts = model.parts(problem.X, model.values(z))
    residual = (problem.y - parts.known)[..., None] * root
    rounding = problem.weights.sum() * (ROUNDING * problem.scale) ** 2
    return _quadratic(parts.features * root, residual, problem.c) + rounding


def _quadratic(features: FloatArray, residual: FloatArray, c: FloatArray) -> FloatArray:
    """Return |residual_j - features_j c_s|^2 for all j and s, from p-dimensional products.

    Centred at the mean draw, so that nothing large cancels.
    """
    centre = c.mean(axis=0)
    delta = c - centre
    p = features.shape[2]
    upper = np.triu_indices(p)
    twice = np.where(upper[0] == upper[1], 1.0, 2.0)
    products = (delta[:, upper[0]] * delta[:, upper[1]] * twice).T
    total = np.empty((len(features), len(c)))
    # in blocks that stay in the processor's cache
    step = max(1, _BLOCK // p**2) if p else len(features)
    for first in range(0, len(features), step):
        block = slice(first, first + step)
        rest = residual[block] - features[block] @ centre[:, None]
        transposed = np.swapaxes(features[block], 1, 2)
        squares = (transposed @ features[block])[:, upper[0], upper[1]]
        cross = (transposed @ rest)[..., 0]
        total[block] = np.einsum("jnk,jnk->j", rest, rest)[:, None] + squares @ products
        total[block] -= 2 * cross @ delta.T
    return np.maximum(total, 0.0)


def _draw_noise(
    squares: FloatArray,
    n: float,
    log_sigma: FloatArray,
    log_weight: FloatArray,
    random_state: np.random.RandomState,
) -> FloatArray:
    """Draw sigma given each sum of squares, by inversion on a grid around its own mode."""
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
    pick = _one_index_per_column(density.T, random_state)
    row = np.arange(len(squares))
    width = nodes[:, 1] - nodes[:, 0]
    return np.exp(nodes[row, pick] + width * (random_state.uniform(size=len(row)) - 0.5))


def _shares(log_weight: FloatArray) -> FloatArray:
    """Return weights that sum to one in each column."""
    weight = np.exp(log_weight - log_weight.max(axis=0))
    return weight / weight.sum(axis=0)


def _one_index_per_column(
    weight: FloatArray, random_state: np.random.RandomState
) -> NDArray[np.intp]:
    cumulative = np.cumsum(weight, axis=0)
    target = random_state.uniform(size=weight.shape[1]) * cumulative[-1]
    return np.minimum((cumulative < target).sum(axis=0), len(weight) - 1)


# ------------------------------------------------- beyond: importance sampling, nodes for all draws


def _by_proposals(
    problem: _Problem, first_step: FloatArray, random_state: np.random.RandomState
) -> MeasuredDraws:
    """Weigh proposals that all coefficient draws share, moved twice to where the mass is."""
    centre = problem.c.mean(axis=0, keepdims=True)

    def at_centre(u: FloatArray) -> FloatArray:
        return _log_density(problem, u, centre)[:, 0]

    modes = find_modes(at_centre, first_step[np.argsort(-at_centre(first_step[:200]))[:2]])
    n = len(first_step)
    spread = Gaussian(first_step[0], np.eye(first_step.shape[1]), modes[0].log_mass)
    first = moment_match(first_step, np.full(n, 1 / n), spread)
    components = [first, modes[0]]
    for round_ in range(_N_ROUNDS):
        points, log_proposal = mixture_draws(components, _N_PROPOSALS, random_state)
        log_weight = _log_density(problem, points, problem.c) - log_proposal[:, None]
        share = _shares(log_weight)
        effective = float(np.median(1 / np.sum(share**2, axis=0)))
        if round_ == _N_ROUNDS - 1 or effective > 0.1 * _N_PROPOSALS:
            break
        components = [moment_match(points, share.mean(axis=1), first), modes[0]]
    pick = _one_index_per_column(share, random_state)
    u = points[pick]
    coefficients = _draw_columns(problem, u, random_state)
    some = np.linspace(0, len(problem.c) - 1, min(25, len(problem.c))).astype(int)
    khat = float(np.median([pareto_smooth(log_weight[:, s])[1] for s in some]))
    return MeasuredDraws(u[:, :-1], np.exp(u[:, -1]), coefficients, khat, effective, "importance")


def _log_density(problem: _Problem, u: FloatArray, c: FloatArray) -> FloatArray:
    """Return the log density of proposals (J, d) given coefficient draws (S, p): (J, S).

    The causes' coefficients a ~ N(0, diag(sd^2)) are integrated out by Woodbury's identity.
    """
    model, y = problem.model, problem.y
    sigma = np.exp(u[:, -1])
    parts = model.parts(problem.X, model.values(u[:, :-1]))
    scale = parts.noise * sigma[:, None]
    scaled = np.sqrt(problem.weights) / scale
    features = parts.features * scaled[..., None]
    residual = ((y - parts.known) * scaled)[..., None]
    columns = parts.columns * model.column_sd * scaled[..., None]
    transposed = np.swapaxes(columns, 1, 2)
    q = columns.shape[2]
    inner = np.eye(q) + transposed @ columns
    factor = np.linalg.cholesky(inner)
    total = _quadratic(features, residual, c)
    if q:
        # |r|^2 - |F^-1 H' r|^2 with F F' = I + H'H, linear in c
        projected = np.linalg.solve(factor, transposed @ np.concatenate([features, residual], 2))
        total = total - _quadratic(projected[..., :-1], projected[..., -1:], c)
    with np.errstate(divide="ignore"):
        prior = prior_log_density(u[:, :-1]) + problem.noise_prior.logpdf(sigma) + u[:, -1]
    log_scale = np.log(np.broadcast_to(scale, (len(u), len(y)))) @ problem.weights
    log_det = np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1) + log_scale
    rounding = 0.5 * problem.weights.sum() * (ROUNDING * problem.scale / sigma) ** 2
    out = (prior - log_det - rounding)[:, None] - 0.5 * np.maximum(total, 0.0)
    return np.where(np.isfinite(out), out, -np.inf)


def _draw_columns(
    problem: _Problem, u: FloatArray, random_state: np.random.RandomState
) -> FloatArray:
    """Draw a given (u_s, c_s), one for each s: (S, q)."""
    model = problem.model
    q = len(model.column_sd)
    if not q:
        return np.empty((len(u), 0))
    parts = model.parts(problem.X, model.values(u[:, :-1]))
    scaled = np.sqrt(problem.weights) / (parts.noise * np.exp(u[:, -1:]))
    fitted = (parts.features @ problem.c[..., None])[..., 0]
    residual = (problem.y - parts.known - fitted) * scaled
    columns = parts.columns * model.column_sd * scaled[..., None]
    transposed = np.swapaxes(columns, 1, 2)
    factor = np.linalg.cholesky(np.eye(q) + transposed @ columns)
    half = np.linalg.solve(factor, transposed @ residual[..., None])
    half += random_state.standard_normal(half.shape)
    return np.linalg.solve(np.swapaxes(factor, 1, 2), half)[..., 0] * model.column_sd
