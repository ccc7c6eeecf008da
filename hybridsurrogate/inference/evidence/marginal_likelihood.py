"""The evidence of a cause at every node of its grid, given the measured rows.

Given the nodes of what is not a size (a period, a location) the linearised model has an evidence
in closed form, for any number of responses at once.

Sizes have a scale mixture as prior: the root mean square of the effect over the measured rows is
spread evenly, on a logarithmic scale, between a fraction of the noise and several times the spread
of the output, the same for every cause, so that no cause is favoured by the units of its size.

All rows enter by products of responses, slopes and columns: matrix products over all nodes and
responses at once, and no array of responses times nodes times rows. A covariance of the rows,
``sigma^2 I + V V'``, subtracts from each of them a product of what they have along V, so that
several covariances along the same directions share all work over rows.

An optimisation enumerates its grid at every step. So a grid with more nodes than can be kept is
looked at once, in pieces, around a fit without the cause, as a periodogram is; what follows has its
best nodes, and one node for each group of others that explain the rows as well as each other, with
the prior mass of all of them: the evidence of the whole grid stays an average over all of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from hybridsurrogate.inference.evidence.grid import Grid, with_cells
from hybridsurrogate.inference.evidence.linearised import (
    Columns,
    Linearised,
    RecentSlopes,
    columns_at_nodes,
    is_long,
    linearise,
    linearised_pieces,
)
from hybridsurrogate.inference.evidence.outliers import Noise, as_normal_rows
from hybridsurrogate.inference.evidence.settings import SETTINGS
from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.model.statistics import EmulatorPosterior
from hybridsurrogate.numerics.linear_algebra import BLOCK, log_det_of, nudged_cholesky
from hybridsurrogate.types import FloatArray


class Covariances(NamedTuple):
    """K covariances ``sigma^2 I + V V'`` of the rows, as their inverses.

    ``sigma^2 (sigma^2 I + V_k V_k')^-1 = I - E_k E_k'`` with ``E_k = directions * weights_k``.

    Attributes
    ----------
    directions : ndarray of shape (n, r)
    weights : ndarray of shape (K, r)
    log_det : ndarray of shape (K,)
        Log determinants of ``(I + V_k V_k' / sigma^2)^(1/2)``.
    """

    directions: FloatArray
    weights: FloatArray
    log_det: FloatArray


def known_covariance(U: FloatArray, sigma: float) -> Covariances:
    """Return the covariance sigma^2 I + U U' for U (n, r)."""
    r = U.shape[1]
    if not r:
        return Covariances(U, np.ones((1, 0)), np.zeros(1))
    factor = nudged_cholesky((sigma**2 * np.eye(r) + U.T @ U)[None])
    log_det = log_det_of(factor) - r * np.log(sigma)
    return Covariances(U @ np.linalg.inv(factor[0]).T, np.ones((1, r)), log_det)


def scaled_covariances(basis: FloatArray, sizes: FloatArray, sigma: float) -> Covariances:
    """Return the covariances sigma^2 I + size^2 B B' for a basis B (n, r) and K sizes."""
    # with B = U diag(s) V' the inverse is I - U diag(s^2 / (sigma^2 / size^2 + s^2)) U': not from
    # B'B, of which the small s^2 are rounding, and may come out as more than the whole
    directions, singular, _ = np.linalg.svd(basis, full_matrices=False)
    ridge = (sigma / sizes[:, None]) ** 2
    log_det = 0.5 * np.sum(np.log1p(singular**2 / ridge), axis=1)
    return Covariances(directions, singular / np.sqrt(ridge + singular**2), log_det)


class Products(NamedTuple):
    """What the evidence of R responses at T nodes depends on, parameters integrated out.

    Under K covariances. M is 1 where the nodes share the simulation, else T.

    Attributes
    ----------
    squares : ndarray of shape (K, M, R)
        Squares that the simulation's parameters leave, those of their prior included.
    log_det : ndarray of shape (K, M)
        Of the covariance of the rows and of the precision of the parameters.
    along : ndarray of shape (K, T, R, q)
        Products of the columns with the residuals of a fit of the parameters.
    inner : ndarray of shape (K, T, q, q)
        Products of the columns with each other, after the projection on the parameters' slopes.
    squared : ndarray of shape (T,)
        Squares of the columns before that.
    """

    squares: FloatArray
    log_det: FloatArray
    along: FloatArray
    inner: FloatArray
    squared: FloatArray


def node_products(
    parts: Linearised, responses: FloatArray, sigma: float, covariances: Iterable[Covariances]
) -> Iterator[Products]:
    """Return the products under each set of covariances.

    Parameters
    ----------
    parts : Linearised
        Of unit noise; its own known covariance is not looked at.
    responses : ndarray of shape (R, n)
    sigma : float
    covariances : iterable of Covariances
    """
    seen = _seen(parts, responses, sigma)
    H = np.swapaxes(parts.H, 1, 2)
    plain = _Blocks.of(seen.rows, H, seen.shared)
    squared = np.einsum("tkk->t", plain.columns[0])
    # where a process explains nearly all, a difference of two products is what rounding leaves
    rounding = responses.shape[1] * np.finfo(float).eps * np.einsum("mss->ms", plain.rows[0])
    for directions, weights, log_det in covariances:
        blocks = plain
        if weights.size:
            # along the directions, (..., n) to (..., r)
            rows, columns, shared = (
                (v.reshape(-1, len(directions)) @ directions).reshape(*v.shape[:-1], len(weights.T))
                for v in (seen.rows, H, seen.shared)
            )
            along = _Blocks.of(rows, columns, shared, weights**2)
            blocks = _Blocks(*(a - b for a, b in zip(plain, along, strict=True)))
        yield _without_parameters(seen, blocks, sigma, log_det, squared, rounding)


class _Seen(NamedTuple):
    """Responses as they are at every node: ``shared_r - own_m' u_r``, and the slopes G.

    A response minus the mean may be large and almost in the span of the parameters. Its squares
    would lose all digits. So it is counted from a fit, the parameters at ``start_m @ u_r``: the
    residual of a good node is of the size of the noise.

    Attributes
    ----------
    shared : ndarray of shape (R, n)
    rows : ndarray of shape (M, k + d, n)
        Own parts, then slopes.
    u : ndarray of shape (R, k)
    start : ndarray of shape (M, d, k)
    """

    shared: FloatArray
    rows: FloatArray
    u: FloatArray
    start: FloatArray


def _seen(parts: Linearised, responses: FloatArray, sigma: float) -> _Seen:
    mean, G = parts.mean, np.swapaxes(parts.G, 1, 2)
    M, d, n = G.shape
    # one node that does not fail
    at = int(np.argmax(np.isfinite(mean).all(axis=1)))
    if len(responses) == 1:
        shared, u = np.zeros((1, n)), np.ones((1, 1))
        own = (mean - responses)[:, None]
        start = np.zeros((M, d, 1))
    else:
        left = responses - mean[at]
        fit = _coefficients(G[at][None], sigma)[0] @ (G[at] @ left.T)  # (d, R)
        shared, u = left - fit.T @ G[at], np.vstack([np.ones(len(left)), fit]).T
        own = np.concatenate([(mean - mean[at])[:, None], G - G[at]], axis=1)
        start = np.broadcast_to(np.eye(d, d + 1, 1), (M, d, d + 1))
    # the projection of a node's part on its slopes is taken out
    move = _coefficients(G, sigma) @ (G @ np.swapaxes(own, 1, 2))  # (M, d, k)
    own = own - np.swapaxes(move, 1, 2) @ G
    return _Seen(shared, np.concatenate([own, G], axis=1), u, start - move)


def _coefficients(G: FloatArray, sigma: float) -> FloatArray:
    """Return (G G' + sigma^2 I)^-1 of slopes G (M, d, n)."""
    d = G.shape[1]
    inverse = np.linalg.inv(nudged_cholesky(G @ np.swapaxes(G, 1, 2) + sigma**2 * np.eye(d)))
    return np.swapaxes(inverse, 1, 2) @ inverse


class _Blocks(NamedTuple):
    """Products of rows S (M, s, n), columns H (T, q, n) and shared parts of responses (R, n)."""

    rows: FloatArray  # (K, M, s, s)
    across: FloatArray  # (K, T, s, q)
    columns: FloatArray  # (K, T, q, q)
    shared: FloatArray  # (K, 1, R)
    shared_rows: FloatArray  # (K, M, R, s)
    shared_columns: FloatArray  # (K, T, R, q)

    @classmethod
    def of(
        cls, S: FloatArray, H: FloatArray, shared: FloatArray, weights: FloatArray | None = None
    ) -> _Blocks:
        """Return products weighted by (K, n), one where none are given."""
        (M, s, n), (T, q, _), R = S.shape, H.shape, len(shared)

        def by(values: FloatArray) -> FloatArray:
            if weights is None:
                return values[None]
            return values * np.expand_dims(weights, tuple(range(1, values.ndim)))

        weighted, K = by(S), 1 if weights is None else len(weights)
        if M == 1:
            across = H.reshape(-1, n) @ np.swapaxes(weighted[:, 0], 1, 2)
            across = np.swapaxes(across.reshape(K, T, q, s), 2, 3)
        else:
            across = weighted @ np.swapaxes(H, 1, 2)
        if not shared.any():  # of one response all is its own
            with_rows, with_columns = np.zeros((K, M, R, s)), np.zeros((K, T, R, q))
        else:
            responses = by(shared)
            with_rows, with_columns = (
                np.swapaxes((responses @ v.reshape(-1, n).T).reshape(K, R, *v.shape[:2]), 1, 2)
                for v in (S, H)
            )
        return cls(
            weighted @ np.swapaxes(S, 1, 2),
            across,
            by(H) @ np.swapaxes(H, 1, 2),
            np.einsum("krn,rn->kr", by(shared), shared)[:, None],
            with_rows,
            with_columns,
        )


def _without_parameters(
    seen: _Seen,
    blocks: _Blocks,
    sigma: float,
    log_det: FloatArray,
    squared: FloatArray,
    rounding: FloatArray,
) -> Products:
    """Integrate the parameters out: they have a standard normal prior around zero."""
    u, k = seen.u, seen.u.shape[1]
    K, M, s, _ = blocks.rows.shape
    d, own = s - k, blocks.rows[..., :k, :k]
    squares = blocks.shared - 2 * np.sum(blocks.shared_rows[..., :k] * u, axis=3)
    squares = squares + np.sum((u @ own) * u, axis=3)
    along = blocks.shared_columns - u @ blocks.across[..., :k, :]
    inner, log_det = blocks.columns, np.broadcast_to(log_det[:, None], (K, M))
    if d:
        g = u @ np.swapaxes(seen.start, 1, 2)  # (M, R, d)
        right = blocks.shared_rows[..., k:] - u @ blocks.rows[..., :k, k:] - sigma**2 * g
        precision = blocks.rows[..., k:, k:] + (sigma**2 + rounding[:, k:, None]) * np.eye(d)
        factor = nudged_cholesky(precision.reshape(-1, d, d))
        inverse = np.linalg.inv(factor).reshape(K, M, d, d)
        right = right @ np.swapaxes(inverse, 2, 3)
        across = inverse @ blocks.across[..., k:, :]  # (K, T, d, q)
        squares = squares + sigma**2 * np.sum(g**2, axis=2) - np.sum(right**2, axis=3)
        along = along - right @ across
        inner = inner - np.swapaxes(across, 2, 3) @ across
        log_det = log_det + log_det_of(factor).reshape(K, M) - d * np.log(sigma)
    return Products(squares, log_det, along, inner, squared)


# a prior scale that is as good as zero, whose square is a number still
_SMALLEST_SCALE = 1e-100

# whitened values (..., n), rows along the last axis
Whiten = Callable[[FloatArray], FloatArray]


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
        Log integral over sigma as a function of the residual sum of squares.
    sizes : ndarray of shape (K,)
        Prior scales of the effect's root mean square, equally probable.
    """
    evidence = []
    for unit, factor in parts.by_noise():
        y, covariance = responses / factor, known_covariance(unit.U, sigma)
        for piece in unit.pieces(len(responses)):
            (products,) = node_products(piece, y, sigma, [covariance])
            found = _of_products(products, piece, y.shape[1], sigma, log_marginal, sizes)[0]
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
    y = whiten(response / factor)[None]
    if unit.U.size:  # then no known covariance ties the rows
        G, H = (np.swapaxes(whiten(np.swapaxes(a, 1, 2)), 1, 2) for a in (unit.G, unit.H))
        unit = replace(unit, mean=whiten(unit.mean), G=G, H=H, U=unit.U[:, :0])
    covariances = [
        scaled_covariances(whiten(basis.T / factor).T, process_sizes, sigma) for basis in bases
    ]
    out = [
        [
            _of_products(products, piece, y.shape[1], sigma, log_marginal, sizes)[:, 0]
            for products in node_products(piece, y, sigma, covariances)
        ]
        for piece in unit.pieces(1)
    ]
    return np.concatenate(out, axis=2) - log_det - np.sum(np.log(factor))


def _of_products(
    products: Products,
    parts: Linearised,
    n: int,
    sigma: float,
    log_marginal: Callable[[FloatArray], FloatArray],
    sizes: FloatArray,
) -> FloatArray:
    """Return the log evidence (K, R, T) of n rows: sizes and noise integrated out as well."""
    # rounding is the affair of `log_marginal`, in shares of the spread of y: y itself may be far
    # from zero, and a share of its square would be more than the noise
    least = np.finfo(float).tiny
    squares, log_base = products.squares, (parts.log_weight - products.log_det)[..., None]
    _, T, _, q = products.along.shape
    if not q:
        out = log_marginal(np.maximum(squares, least)) + log_base
        return np.swapaxes(np.where(np.isnan(out), -np.inf, out), 1, 2)
    # where the simulation failed, or overflowed, there is nothing to decompose
    failed = np.asarray(~np.isfinite(products.inner).all(axis=(2, 3)))[..., None]
    inner = np.where(failed[..., None], 0.0, products.inner)
    # one column, as most causes have: half the time of `eigh`
    eigenvalue, vector = np.linalg.eigh(inner) if q > 1 else (inner[..., 0], np.ones((1, 1)))
    # what G can draw as well leaves rounding, by the rule of `numpy.linalg.matrix_rank`
    informed = eigenvalue > n * np.finfo(float).eps * products.squared[:, None]
    eigenvalue = np.where(informed, eigenvalue, 0.0)[:, :, None]
    along = (products.along @ (vector * informed[:, :, None])) ** 2
    # one size for all directions of a cause; caps bind only parameters, which come alone
    scales = np.maximum(np.minimum(sizes[:, None], parts.cap.min(axis=1)), _SMALLEST_SCALE)
    terms = []
    for scale in np.array_split(scales, -(-scales.size * along.size // (BLOCK * T))):
        ridge = ((sigma / scale) ** 2)[:, None, :, None, None]
        reduced = squares - np.sum(along / (eigenvalue + ridge), axis=4)
        log_det = 0.5 * np.sum(np.log1p(eigenvalue / ridge), axis=4)
        terms.append(log_marginal(np.maximum(reduced, least)) - log_det)
    # NaN marks a simulation that failed, and is sorted out here
    with np.errstate(invalid="ignore"):
        out = np.logaddexp.reduce(np.concatenate(terms), axis=0) - np.log(len(sizes))
    out = out + log_base
    return np.swapaxes(np.where(np.isnan(out) | failed, -np.inf, out), 1, 2)


def _whitener(U: FloatArray, sigma: float) -> tuple[Whiten, float]:
    """Return a map that gives rows with covariance sigma^2 I + U U' the covariance sigma^2 I."""
    if not U.size:
        return (lambda values: values), 0.0
    # with L L' = I + U'U / sigma^2 the map W = I - U (L' + I)^-1 L^-1 U' / sigma^2 has
    # W'W = (I + U U' / sigma^2)^-1, and the determinant is that of L: no decomposition of n rows
    one = np.eye(U.shape[1])
    factor = nudged_cholesky((one + U.T @ U / sigma**2)[None])[0]
    taken = (U @ np.linalg.solve(factor.T + one, np.linalg.inv(factor)) / sigma**2).T

    def whiten(values: FloatArray) -> FloatArray:
        flat = values.reshape(-1, len(U))
        return (flat - (flat @ U) @ taken).reshape(values.shape)

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
    possible: Noise,
    columns: Columns | None = None,
    recent: RecentSlopes | None = None,
) -> LocalMode:
    """Follow the linearised model to its best fit by Gauss-Newton steps, nodes re-enumerated.

    Where it has outliers, rows have the scales that the best node gives them at the start: a call
    from where this one ended is a step of the EM algorithm.

    Parameters
    ----------
    z : ndarray of shape (n_unknowns,)
        Starting point.
    sigma : float
        Noise scale of the penalised fit, relative to the priors.
    size : float
        Prior scale of the effect's size, in units of y; large means free.
    possible : callable
        Of estimates of sigma (T,): those that are possible.
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
    noise, factor = None, 0.0
    if model.acts_on("outliers"):
        plain = linearise(model, X, emulator, grid, point, columns, recent)
        parts = as_normal_rows(plain, model, grid, point, y, sigma, size, possible)
        nodes = scan(parts, y[None], sigma, _free_noise(len(y)), np.array([size]))[0]
        followed = np.argmax(nodes, keepdims=True)
        grid, columns, parts = grid.at(followed), columns.at(followed), parts.at(followed)
        noise, factor = parts.noise, float((parts.log_weight - plain.log_weight[followed])[0])
    costly = bool(len(grid.nodes)) and model.effects[-1].touches_simulation
    for _ in range(SETTINGS.optimiser_steps):
        parts = linearise(model, X, emulator, grid, proposal, columns, recent)
        parts = parts if noise is None else replace(parts, noise=noise)
        here, move, deviance = _solve(parts, y, grid, proposal, sigma, size)
        promised = here.objective - float((deviance + 2 * parts.log_weight)[here.node])
        here = here._replace(node=int(followed[here.node]))
        if costly and len(followed) > SETTINGS.max_followed and np.isfinite(here.objective):
            index = np.argsort(deviance)[: SETTINGS.max_followed]
            followed, grid, columns = followed[index], grid.at(index), columns.at(index)
        if not np.isfinite(here.objective):
            if best is None:
                return here
            step *= 0.3
        elif best is None or here.objective < best.objective - SETTINGS.converged_gain:
            gain = np.inf if best is None else best.objective - here.objective
            best, point, target, step = here, proposal, move, 1.0
            # where the linear model promises nothing no shorter step is tried: 60 % of all steps
            if gain < SETTINGS.converged_gain or promised < SETTINGS.converged_gain:
                break
        else:
            step *= 0.3
        if step < 0.02:
            break
        proposal = point + step * (target - point)
    assert best is not None
    return best._replace(objective=best.objective - 2 * factor)


def _solve(
    parts: Linearised, y: FloatArray, grid: Grid, z: FloatArray, sigma: float, size: float
) -> tuple[LocalMode, FloatArray, FloatArray]:
    """Return the fit at z, columns free, the z of the best linear model, and (T,) deviance."""
    T, _, q = parts.H.shape
    d, s = parts.G.shape[2], len(grid.sizes)
    units = [_normal_equations(unit, y / factor, sigma) for unit, factor in parts.by_noise()]
    normal, right, total = (np.concatenate(block) for block in list(zip(*units, strict=True))[:3])
    scale = np.maximum(np.minimum(size, parts.cap), _SMALLEST_SCALE)
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
    design = whiten(np.hstack([unit.G[0], unit.H[0]]).T).T
    conditioned = np.concatenate(
        [z[grid.fixed], (z[grid.sizes] - grid.neutral[grid.sizes]) * parts.H_rms[node, :s]]
    )
    free = np.ones(d + q, dtype=bool)
    free[: len(grid.fixed)] = free[d : d + s] = False
    rest = whiten(y / factor - unit.mean[0]) - design[:, ~free] @ conditioned
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
    (T, n, q), d = unit.H.shape, unit.G.shape[2]
    rows = np.concatenate([np.swapaxes(unit.G, 1, 2), (y - unit.mean)[:, None]], axis=1)
    both = whiten(rows)
    inner = both @ np.swapaxes(both, 1, 2)
    normal, right = np.empty((T, d + q, d + q)), np.empty((T, d + q))
    normal[:, :d, :d], right[:, :d] = inner[:, :d, :d], inner[:, :d, d]
    start = 0
    for piece in unit.pieces(1):
        H = whiten(np.swapaxes(piece.H, 1, 2))
        nodes = slice(start, start + len(H))
        if len(both) == 1:
            across = (H.reshape(-1, n) @ both[0].T).reshape(len(H), q, d + 1)
        else:
            across = H @ np.swapaxes(both[nodes], 1, 2)
        normal[nodes, d:, :d] = across[..., :d]
        normal[nodes, :d, d:] = np.swapaxes(across[..., :d], 1, 2)
        normal[nodes, d:, d:] = H @ np.swapaxes(H, 1, 2)
        right[nodes, d:] = across[..., d]
        start += len(H)
    return normal, right, np.broadcast_to(inner[:, d, d], (T,)), log_det, whiten


def _free_noise(n: int) -> Callable[[FloatArray], FloatArray]:
    """Return the log density of n rows as a function of their squares, sigma at its best."""
    return lambda squares: np.asarray(-0.5 * n * np.log(squares))


# nodes that are kept each, and groups of others
_N_SINGLE_NODES, _N_NODE_GROUPS = 300, 100


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
    density = np.concatenate(
        [
            scan(parts, y[None], sigma, _free_noise(len(y)), np.array([size]))[0] - parts.log_weight
            for parts in linearised_pieces(model, X, emulator, grid, z)
        ]
    )
    order = np.argsort(-density)
    groups = np.array_split(order[_N_SINGLE_NODES:], _N_NODE_GROUPS)
    middle = [group[len(group) // 2] for group in groups]
    weight = [np.logaddexp.reduce(grid.log_weight[group]) for group in groups]
    best = order[:_N_SINGLE_NODES]
    return with_cells(
        grid,
        np.concatenate([grid.edges[best], grid.edges[middle]]),
        np.concatenate([grid.log_weight[best], weight]),
    )
