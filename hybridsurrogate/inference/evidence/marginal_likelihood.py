"""The evidence of a cause at every node of its grid, given the measured rows.

Given the nodes of what is not a size (a period, a location) the linearised model has an evidence
in closed form, for any number of responses at once.

Sizes have a scale mixture as prior: the root mean square of the effect over the measured rows is
spread evenly, on a logarithmic scale, between a fraction of the noise and several times the spread
of the output, the same for every cause, so that no cause is favoured by the units of its size.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from hybridsurrogate.inference.conjugate.noise_marginal import KnownNoise, NoiseTable
from hybridsurrogate.inference.evidence.grid import Grid
from hybridsurrogate.inference.evidence.linearised import (
    Columns,
    Linearised,
    RecentSlopes,
    columns_at_nodes,
    linearise,
)
from hybridsurrogate.inference.evidence.node_products import (
    Products,
    known_covariance,
    node_products,
    scaled_covariances,
)
from hybridsurrogate.inference.evidence.outliers import heavy_fit, heavy_scan
from hybridsurrogate.inference.evidence.settings import SETTINGS
from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.model.statistics import EmulatorPosterior
from hybridsurrogate.numerics.blocks import BLOCK
from hybridsurrogate.numerics.cholesky import log_det_of, nudged_cholesky
from hybridsurrogate.types import FloatArray

# a prior scale that is as good as zero, whose square is a number still
_NO_SIZE = 1e-100

# whitened values, their rows along an axis
Whiten = Callable[[FloatArray, int], FloatArray]


def scan(
    parts: Linearised,
    responses: FloatArray,
    sigma: float,
    log_marginal: Callable[[FloatArray], FloatArray],
    sizes: FloatArray,
) -> FloatArray:
    """Return the log evidence of every node for every response, (R, T).

    Parameters
    ----------
    parts : Linearised
    responses : ndarray of shape (R, n)
    sigma : float
        Noise scale of the penalised fit, relative to the priors of parameters and sizes.
    log_marginal : callable
        Log integral over sigma as a function of the residual sum of squares; a `NoiseTable` or
        `KnownNoise` where there are outliers.
    sizes : ndarray of shape (K,)
        Prior scales of the effect's root mean square, equally probable.
    """
    if parts.outliers is not None:
        assert isinstance(log_marginal, NoiseTable | KnownNoise)
        log_prior = log_marginal.log_prior
        return np.stack([heavy_scan(parts, y, sigma, log_prior, sizes) for y in responses])
    evidence = []
    for unit, factor in parts.by_noise():
        y, covariance = responses / factor, known_covariance(unit.U, sigma)
        for piece in unit.pieces(len(responses)):
            (products,) = node_products(piece, y, sigma, covariance)
            found = _of_products(products, piece, y.shape[1], sigma, log_marginal, sizes)
            evidence.append(found - np.sum(np.log(factor)))
    return np.concatenate(evidence, axis=1)


def scan_with_process(
    parts: Linearised,
    response: FloatArray,
    sigma: float,
    log_marginal: Callable[[FloatArray], FloatArray],
    sizes: FloatArray,
    bases: FloatArray,
    process_sizes: FloatArray,
) -> FloatArray:
    """Return the log evidence of every node with a process in addition, (L, K, T).

    Parameters
    ----------
    parts, sigma, log_marginal, sizes
        As for `scan`; the noise of the rows is the same at all nodes.
    response : ndarray of shape (n,)
    bases : ndarray of shape (L, n, r)
        Columns of the process at L lengths.
    process_sizes : ndarray of shape (K,)
        Factors on them.
    """
    ((unit, factor),) = parts.by_noise()
    whiten, log_det = _whitener(unit.U, sigma)
    y, unit = whiten(response / factor, 0)[None], unit.whitened(whiten)
    out = np.empty((len(bases), len(process_sizes), len(parts.H)))
    for of_length, basis in zip(out, bases, strict=True):
        columns = whiten(basis / np.reshape(factor, (-1, 1)), 0)
        covariances = scaled_covariances(columns, process_sizes, sigma)
        start = 0
        for piece in unit.pieces(1):
            nodes = slice(start, start + len(piece.H))
            for k, products in enumerate(node_products(piece, y, sigma, covariances)):
                of_length[k, nodes] = _of_products(
                    products, piece, y.shape[1], sigma, log_marginal, sizes
                )[0]
            start = nodes.stop
    return out - log_det - np.sum(np.log(factor))


def _of_products(
    products: Products,
    parts: Linearised,
    n: int,
    sigma: float,
    log_marginal: Callable[[FloatArray], FloatArray],
    sizes: FloatArray,
) -> FloatArray:
    """Return the log evidence (R, T) of n rows: sizes and noise integrated out as well."""
    # rounding is the affair of `log_marginal`, in shares of the spread of y: y itself may be far
    # from zero, and a share of its square would be more than the noise
    least = np.finfo(float).tiny
    squares, log_base = products.squares, (parts.log_weight - products.log_det)[:, None]
    T, _, q = products.along.shape
    if not q:
        out = log_marginal(np.maximum(squares, least)) + log_base
        return np.where(np.isnan(out), -np.inf, out).T
    # where the simulation failed, or overflowed, there is nothing to decompose
    failed = np.asarray(~np.isfinite(products.inner).all(axis=(1, 2)))
    eigenvalue, vector = np.linalg.eigh(np.where(failed[:, None, None], 0.0, products.inner))
    # what G can draw as well leaves rounding, by the rule of `numpy.linalg.matrix_rank`
    informed = eigenvalue > n * np.finfo(float).eps * products.squared[:, None]
    eigenvalue = np.where(informed, eigenvalue, 0.0)[:, None]
    along = (products.along @ (vector * informed[:, None])) ** 2
    # one size for all directions of a cause; caps bind only parameters, which come alone
    scales = np.maximum(np.minimum(sizes[:, None], parts.cap.min(axis=1)), _NO_SIZE)
    terms = []
    for scale in np.array_split(scales, -(-scales.size * along.size // (BLOCK * T))):
        ridge = ((sigma / scale) ** 2)[:, :, None, None]
        reduced = squares - np.sum(along / (eigenvalue + ridge), axis=3)
        log_det = 0.5 * np.sum(np.log1p(eigenvalue / ridge), axis=3)
        terms.append(log_marginal(np.maximum(reduced, least)) - log_det)
    # NaN marks a simulation that failed, and is sorted out here
    with np.errstate(invalid="ignore"):
        out = np.logaddexp.reduce(np.concatenate(terms), axis=0) - np.log(len(sizes))
    out = out + log_base
    return np.where(np.isnan(out) | failed[:, None], -np.inf, out).T


def _whitener(U: FloatArray, sigma: float) -> tuple[Whiten, float]:
    """Return a map that gives rows with covariance sigma^2 I + U U' the covariance sigma^2 I."""
    if not U.size:
        return (lambda values, axis: values), 0.0
    # with L L' = I + U'U / sigma^2 the map W = I - U (L' + I)^-1 L^-1 U' / sigma^2 has
    # W'W = (I + U U' / sigma^2)^-1, and the determinant is that of L: no decomposition of n rows
    one = np.eye(U.shape[1])
    factor = nudged_cholesky((one + U.T @ U / sigma**2)[None])[0]
    inner = np.linalg.solve(factor.T + one, np.linalg.inv(factor)) / sigma**2

    def whiten(values: FloatArray, axis: int) -> FloatArray:
        moved = np.moveaxis(values, axis, 0)
        flat = moved.reshape(len(moved), -1)
        flat = flat - U @ (inner @ (U.T @ flat))
        return np.moveaxis(flat.reshape(moved.shape), 0, axis)

    return whiten, float(log_det_of(factor[None])[0])


class LocalMode(NamedTuple):
    """Where a cause fits best.

    Attributes
    ----------
    z : ndarray of shape (n_unknowns,)
        Fixed directions and sizes at the optimum, nodes at the best one.
    squares : float
        Residual sum of squares there, in units of the noise covariance.
    objective : float
        Penalised squares in units of sigma^2; smaller is better.
    node : int
    """

    z: FloatArray
    squares: float
    objective: float
    node: int


def optimise(
    model: MeasuredModel,
    X: FloatArray,
    y: FloatArray,
    emulator: EmulatorPosterior,
    grid: Grid,
    z: FloatArray,
    sigma: float,
    size: float,
    columns: Columns | None = None,
    recent: RecentSlopes | None = None,
) -> LocalMode:
    """Follow the linearised model to its best fit by Gauss-Newton steps, nodes re-enumerated.

    Parameters
    ----------
    z : ndarray of shape (n_unknowns,)
        Starting point.
    sigma : float
        Noise scale of the penalised fit, relative to the priors.
    size : float
        Prior scale of the effect's size, in units of y; large means free.
    columns : Columns, optional
        Where they are known from `columns_at_nodes`.
    recent : RecentSlopes, optional
        Of the same rows and emulator.
    """
    best: LocalMode | None = None
    point, step = np.array(z, dtype=float), 1.0
    proposal = point
    # columns move only with the cause's own parameters, and these are enumerated or fixed
    if columns is None:
        columns = columns_at_nodes(model, X, grid, point)
    followed = np.arange(len(grid.points))
    costly = bool(len(grid.nodes)) and model.effects[-1].touches_simulation
    for _ in range(SETTINGS.max_steps):
        parts = linearise(model, X, emulator, grid, proposal, columns, recent)
        here, move, deviance = _solve(parts, y, grid, proposal, sigma, size)
        here = here._replace(node=int(followed[here.node]))
        if costly and len(followed) > SETTINGS.nodes_followed and np.isfinite(here.objective):
            index = np.argsort(deviance)[: SETTINGS.nodes_followed]
            followed, grid, columns = followed[index], grid.at(index), columns.at(index)
        if not np.isfinite(here.objective):
            if best is None:
                return here
            step *= 0.3
        elif best is None or here.objective < best.objective - 1e-4:
            gain = np.inf if best is None else best.objective - here.objective
            best, point, target, step = here, proposal, move, 1.0
            if gain < SETTINGS.gain_converged:
                break
        else:
            step *= 0.3
        if step < 0.02:
            break
        proposal = point + step * (target - point)
    assert best is not None
    return best


def _solve(
    parts: Linearised, y: FloatArray, grid: Grid, z: FloatArray, sigma: float, size: float
) -> tuple[LocalMode, FloatArray, FloatArray]:
    """Return the fit at z, columns free, the z of the best linear model, and (T,) deviance."""
    if parts.outliers is not None:
        heavy = heavy_fit(parts, y, grid, z, sigma, size)
        mode = LocalMode(z.copy(), heavy.squares, heavy.objective, heavy.node)
        return mode, heavy.move, heavy.deviance
    T, _, q = parts.H.shape
    d, s = parts.G.shape[2], len(grid.sizes)
    units = [_normal_equations(unit, y / factor, sigma) for unit, factor in parts.by_noise()]
    normal, right, total = (np.concatenate(block) for block in list(zip(*units, strict=True))[:3])
    scale = np.maximum(np.minimum(size, parts.cap), _NO_SIZE)
    penalty = np.concatenate([np.ones((T, d)), scale**-2.0], axis=1) * sigma**2
    normal[:, np.arange(d + q), np.arange(d + q)] += penalty
    try:
        solution = np.linalg.solve(normal, right[..., None])[..., 0]
    except np.linalg.LinAlgError:  # slopes without bound: the simulation breaks down around here
        return LocalMode(z.copy(), np.inf, np.inf, 0), z, np.full(T, np.inf)
    best_linear = total - np.einsum("tk,tk->t", right, solution)
    deviance = best_linear / sigma**2 - 2 * parts.log_weight
    if parts.noise is not None:
        # without noise factors the determinant is the same everywhere, and only sigma matters
        deviance = deviance + 2 * np.concatenate([np.full(len(u[0]), u[3]) for u in units])
        deviance = deviance + 2 * np.sum(np.log(parts.noise), axis=1)
    deviance = np.where(np.isnan(deviance), np.inf, deviance)
    node = int(np.argmin(deviance))
    # the fit at z itself: what is nonlinear stays, columns are estimated anew
    ((unit, factor),) = parts.at(np.array([node])).by_noise()
    whiten, log_det = units[0][4], units[0][3]
    if parts.noise is not None:
        whiten, log_det = _whitener(unit.U, sigma)
    design = np.hstack([whiten(unit.G[0], 0), whiten(unit.H[0], 0)])
    conditioned = np.concatenate(
        [z[grid.fixed], (z[grid.sizes] - grid.neutral[grid.sizes]) * parts.H_rms[node, :s]]
    )
    free = np.ones(d + q, dtype=bool)
    free[: len(grid.fixed)] = free[d : d + s] = False
    rest = whiten(y / factor - unit.mean[0], 0) - design[:, ~free] @ conditioned
    columns = design[:, free]
    fitted = np.linalg.solve(normal[node][np.ix_(free, free)], columns.T @ rest)
    rest = rest - columns @ fitted
    squares = float(rest @ rest)
    prior = float(penalty[node, ~free] @ conditioned**2 + penalty[node, free] @ fitted**2)
    objective = (squares + prior) / sigma**2
    if parts.noise is not None:
        objective += 2 * (log_det + float(np.sum(np.log(factor))))
    mode = LocalMode(z.copy(), squares, objective if np.isfinite(objective) else np.inf, node)
    move = z.copy()
    move[grid.fixed] = np.clip(solution[node, : len(grid.fixed)], -6, 6)
    size_move = solution[node, d : d + s] / parts.H_rms[node, :s]
    move[grid.sizes] = np.clip(grid.neutral[grid.sizes] + size_move, -6, 6)
    return mode, move, deviance


def _normal_equations(
    unit: Linearised, y: FloatArray, sigma: float
) -> tuple[FloatArray, FloatArray, FloatArray, float, Whiten]:
    """Return normal matrices (T, k, k), right sides (T, k), sums of squares (T,), log det of U.

    Then what whitens the rows. In blocks: G and the residual are mostly the same at all nodes, and
    H is tall.
    """
    whiten, log_det = _whitener(unit.U, sigma)
    T, _, q = unit.H.shape
    d = unit.G.shape[2]
    residual = whiten((y - unit.mean)[..., None], 1)
    both = np.swapaxes(np.concatenate([whiten(unit.G, 1), residual], axis=2), 1, 2)
    inner = both @ np.swapaxes(both, 1, 2)
    normal, right = np.empty((T, d + q, d + q)), np.empty((T, d + q))
    normal[:, :d, :d], right[:, :d] = inner[:, :d, :d], inner[:, :d, d]
    start = 0
    for piece in unit.pieces(1):
        H = whiten(piece.H, 1)
        nodes = slice(start, start + len(H))
        across = (both if len(both) == 1 else both[nodes]) @ H
        normal[nodes, :d, d:] = across[:, :d]
        normal[nodes, d:, :d] = np.swapaxes(across[:, :d], 1, 2)
        normal[nodes, d:, d:] = np.swapaxes(H, 1, 2) @ H
        right[nodes, d:] = across[:, d]
        start += len(H)
    return normal, right, np.broadcast_to(inner[:, d, d], (T,)), log_det, whiten
