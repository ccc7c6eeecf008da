"""A cause linearised: how well the measured rows speak for it at every node of its grid.

Around one point the model of the measured rows is linear in the simulation's parameters (as
standard normal z) and in the *sizes* of the cause: the coefficients of its columns, or a gain, a
constant, a slope measured from the value at which it changes nothing. Given the nodes of what is
left (a period, a location) the evidence is closed form, for any number of responses at once.

Sizes have a scale mixture as prior: the root mean square of the effect over the measured rows is
spread evenly, on a logarithmic scale, between a fraction of the noise and several times the spread
of the output, the same for every cause, so that no cause is favoured by the units of its size.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hybridsurrogate.inference.collapsed import Statistics
from hybridsurrogate.inference.layout import Layout
from hybridsurrogate.inference.measured import MeasuredModel
from hybridsurrogate.priors import FloatArray
from hybridsurrogate.surrogates.base import Basis

_STEP = 1e-3
_MAX_CLIMB = 12
_ABSURD = 1e100
# a size that is a parameter of its own keeps within its prior: z displaced by its prior sd at most
_SIZE_CAP = 1.0
# nodes that are followed where each needs runs of the simulation
_FOLLOWED = 16
# a prior scale that is as good as zero, whose square is a number still
_NO_SIZE = 1e-100


class Belief(NamedTuple):
    """Gaussian belief about the surrogate's coefficients: mean (p,) and factor (p, p) of V."""

    mean: FloatArray
    factor: FloatArray


def coefficient_belief(basis: Basis, simulation: Statistics | None, power: float = 1.0) -> Belief:
    """Return what the simulation alone says about the coefficients, its noise estimated."""
    precision = basis.coefficient_sd**-2.0
    mean = basis.coefficient_mean
    if simulation is None or not power or not len(mean):
        return Belief(mean, np.diag(basis.coefficient_sd))
    variance = max(simulation.yy / simulation.n, 1e-300)
    for _ in range(8):
        matrix = np.diag(precision) + power * simulation.ff / variance
        right = precision * basis.coefficient_mean + power * simulation.fy / variance
        mean = np.linalg.solve(matrix, right)
        squares = simulation.yy - 2 * mean @ simulation.fy + mean @ simulation.ff @ mean
        used = np.trace(np.linalg.solve(matrix, power * simulation.ff / variance))
        variance = max(squares, 1e-14 * simulation.yy) / max(simulation.n - used, 1.0)
    lower = np.linalg.cholesky(np.diag(precision) + power * simulation.ff / variance)
    return Belief(mean, np.linalg.inv(lower).T)


@dataclass(frozen=True)
class Linearised:
    """The model of measured rows around one point, rows scaled to unit noise factor.

    ``y = mean + G @ g + H_t @ h + noise`` with g ~ N(0, I), columns of H with unit root mean
    square, so that h is the size of the effect in units of y.

    Attributes
    ----------
    mean : ndarray of shape (M, n)
        M is 1 where the nodes do not touch the simulation, else T.
    G : ndarray of shape (M, n, d)
    H : ndarray of shape (T, n, q)
    H_rms : ndarray of shape (T, q)
        What was divided out of H.
    cap : ndarray of shape (T, q)
        Largest prior scale of each size in units of y; infinity for columns.
    U : ndarray of shape (n, r)
        Factor of the known covariance: the emulator's own error, a remainder.
    log_weight : ndarray of shape (T,)
    """

    mean: FloatArray
    G: FloatArray
    H: FloatArray
    H_rms: FloatArray
    cap: FloatArray
    U: FloatArray
    log_weight: FloatArray


def columns_at_nodes(
    model: MeasuredModel, X: FloatArray, plan: Layout, z: FloatArray
) -> FloatArray:
    """Return the columns of all causes at every node, (T, n, q)."""
    values = np.repeat(model.values(z[None]), len(plan.grid), axis=0)
    values[:, plan.nodes] = plan.grid
    return model.added(X, values)


def linearise(
    model: MeasuredModel,
    X: FloatArray,
    belief: Belief,
    plan: Layout,
    z: FloatArray,
    columns: FloatArray | None = None,
) -> Linearised:
    """Linearise around z (n_unknowns,), at all nodes of the grid.

    The columns of earlier causes join G with their prior sd; those of the last one are sizes.
    ``columns`` may be given where they are known from `columns_at_nodes`.
    """
    in_simulation = bool(len(plan.nodes)) and model.effects[-1].touches_simulation
    T = len(plan.grid)
    M = T if in_simulation else 1
    directions = np.concatenate([plan.fixed, plan.sizes])
    points = np.broadcast_to(z, (M, 1 + 2 * len(directions), len(z))).copy()
    for k, position in enumerate(directions):
        points[:, 1 + 2 * k, position] += _STEP
        points[:, 2 + 2 * k, position] -= _STEP
    values = model.values(points)
    if in_simulation:
        values[:, :, plan.nodes] = plan.grid[:, None, :]
    known, features, noise = model.simulated(X, values.reshape(-1, len(z)))
    response = (known + features @ belief.mean) / noise
    # a simulation may fail far out: NaN marks the place and is never better than another one
    response = np.where(np.abs(response) < _ABSURD, response, np.nan)
    response = response.reshape(M, 1 + 2 * len(directions), len(X))
    slopes = (response[:, 1::2] - response[:, 2::2]) / (2 * _STEP)
    slopes = np.where(np.isfinite(slopes), slopes, 0.0)
    d = len(plan.fixed)
    G = np.swapaxes(slopes[:, :d], 1, 2)
    H: FloatArray = np.swapaxes(slopes[:, d:], 1, 2)
    # expand around the prior's centre: fixed directions at 0, sizes at their neutral value
    mean = response[:, 0] - G @ z[plan.fixed] - H @ (z[plan.sizes] - plan.neutral[plan.sizes])

    own = np.array([owner == len(model.effects) - 1 for owner, _ in model.column_names], dtype=bool)
    if len(own):
        if columns is None:
            columns = columns_at_nodes(model, X, plan, z)
        if noise.shape[1] > 1:
            columns = columns / noise[0][:, None]
        earlier = columns[:1, :, ~own] * model.column_sd[~own]
        G = np.concatenate([G, np.broadcast_to(earlier, (M, *earlier.shape[1:]))], axis=2)
        if H.shape[2]:
            H = np.concatenate([np.broadcast_to(H, (T, *H.shape[1:])), columns[:, :, own]], axis=2)
        else:
            H = columns[:, :, own]
    H = np.broadcast_to(H, (T, len(X), H.shape[2]))
    rms: FloatArray = np.sqrt(np.mean(H**2, axis=1))
    if model.effects and model.effects[-1].kind == "unexplained":
        # the basis of a process is one object: its prior variance per row, not per column
        rms = np.broadcast_to(np.sqrt(np.sum(rms**2, axis=1, keepdims=True)), rms.shape)
    rms = np.maximum(rms, 1e-12 * max(float(np.max(rms, initial=0.0)), 1e-300))
    cap = np.full(rms.shape, np.inf)
    cap[:, : len(plan.sizes)] = _SIZE_CAP * rms[:, : len(plan.sizes)]
    U = (features[0] / noise[0][:, None]) @ belief.factor
    return Linearised(mean, G, H / rms[:, None, :], rms, cap, U, plan.log_weight)


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
        Noise scale against which the priors of parameters and sizes are weighed.
    log_marginal : callable
        Log integral over sigma as a function of the residual sum of squares.
    sizes : ndarray of shape (K,)
        Prior scales of the effect's root mean square, equally probable.
    """
    whiten, log_det = _whitener(parts.U, sigma)
    G, mean = whiten(parts.G, 1), whiten(parts.mean[..., None], 1)[..., 0]
    y = whiten(responses.T, 0).T
    d, n = G.shape[2], y.shape[1]
    inner = np.swapaxes(G, 1, 2) @ G + sigma**2 * np.eye(d)
    factor = np.linalg.cholesky(inner)
    project = np.linalg.solve(factor, np.swapaxes(G, 1, 2))  # (M, d, n)
    residual = y[:, None, :] - mean  # (R, M, n)
    along = np.einsum("mdn,rmn->rmd", project, residual)
    squares = np.einsum("rmn,rmn->rm", residual, residual) - np.einsum("rmd,rmd->rm", along, along)
    log_base = (
        -np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1) + d * np.log(sigma) - log_det
    )
    T, _, q = parts.H.shape
    floor = 1e-12 * np.maximum(np.einsum("rn,rn->r", y, y), 1e-300)[:, None]
    if not q:
        out = log_marginal(np.maximum(squares, floor)) + log_base + parts.log_weight
        return np.where(np.isnan(out), -np.inf, out)
    H = whiten(parts.H, 1)
    rest = H - np.swapaxes(project, 1, 2) @ (project @ H)  # (T, n, q), G projected out
    eigenvalue, vector = np.linalg.eigh(np.swapaxes(H, 1, 2) @ rest)
    eigenvalue = np.maximum(eigenvalue, 0.0)
    rotated = rest @ vector
    if len(residual[0]) == 1:
        along_h = residual[:, 0] @ rotated.transpose(1, 0, 2).reshape(n, -1)
        along_h = along_h.reshape(len(y), T, q)
    else:
        along_h = np.einsum("rtn,tnq->rtq", residual, rotated)
    terms = []
    for size in sizes:
        # one size for all directions of a cause; caps bind only parameters, which come alone
        scale = np.maximum(np.minimum(size, parts.cap.min(axis=1)), _NO_SIZE)[:, None]
        ridge = (sigma / scale) ** 2
        reduced = squares - np.sum(along_h**2 / (eigenvalue + ridge), axis=2)
        log_det_h = 0.5 * np.sum(np.log1p(eigenvalue / ridge), axis=1)
        terms.append(log_marginal(np.maximum(reduced, floor)) - log_det_h)
    out = np.logaddexp.reduce(terms, axis=0) - np.log(len(sizes))
    out = out + log_base + parts.log_weight
    return np.where(np.isnan(out), -np.inf, out)


def _whitener(U: FloatArray, sigma: float) -> tuple[Callable[[FloatArray, int], FloatArray], float]:
    """Return a map that gives rows with covariance sigma^2 I + U U' the covariance sigma^2 I."""
    if not U.size:
        return (lambda values, axis: values), 0.0
    Q, singular, _ = np.linalg.svd(U, full_matrices=False)
    ratio = 1 + (singular / sigma) ** 2
    shrink = 1 - 1 / np.sqrt(ratio)

    def whiten(values: FloatArray, axis: int) -> FloatArray:
        moved = np.moveaxis(values, axis, 0)
        flat = moved.reshape(len(moved), -1)
        flat = flat - Q @ (shrink[:, None] * (Q.T @ flat))
        return np.moveaxis(flat.reshape(moved.shape), 0, axis)

    return whiten, 0.5 * float(np.sum(np.log(ratio)))


class Peak(NamedTuple):
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


def climb(
    model: MeasuredModel,
    X: FloatArray,
    y: FloatArray,
    belief: Belief,
    plan: Layout,
    z: FloatArray,
    sigma: float,
    size: float,
) -> Peak:
    """Follow the linearised model to its best fit by Gauss-Newton steps, nodes re-enumerated.

    Parameters
    ----------
    z : ndarray of shape (n_unknowns,)
        Starting point.
    sigma : float
        Noise scale against which priors are weighed.
    size : float
        Prior scale of the effect's size, in units of y; large means free.
    """
    best: Peak | None = None
    point, step = np.array(z, dtype=float), 1.0
    proposal = point
    # columns move only with the cause's own parameters, and these are enumerated or fixed
    columns = columns_at_nodes(model, X, plan, point)
    followed = np.arange(len(plan.grid))
    costly = bool(len(plan.nodes)) and model.effects[-1].touches_simulation
    for _ in range(_MAX_CLIMB):
        parts = linearise(model, X, belief, plan, proposal, columns)
        here, move, badness = _solve(parts, y, plan, proposal, sigma, size)
        here = here._replace(node=int(followed[here.node]))
        if costly and len(followed) > _FOLLOWED and np.isfinite(here.objective):
            index = np.argsort(badness)[:_FOLLOWED]
            followed, plan, columns = followed[index], plan.at(index), columns[index]
        if not np.isfinite(here.objective):
            if best is None:
                return here
            step *= 0.3
        elif best is None or here.objective < best.objective - 1e-4:
            gain = np.inf if best is None else best.objective - here.objective
            best, point, target, step = here, proposal, move, 1.0
            if gain < 1e-3:
                break
        else:
            step *= 0.3
        if step < 0.02:
            break
        proposal = point + step * (target - point)
    assert best is not None
    return best


def _solve(
    parts: Linearised, y: FloatArray, plan: Layout, z: FloatArray, sigma: float, size: float
) -> tuple[Peak, FloatArray, FloatArray]:
    """Return the fit at z, columns free, the z of the best linear model, and (T,) badness."""
    whiten, _ = _whitener(parts.U, sigma)
    T, n, q = parts.H.shape
    d, s = parts.G.shape[2], len(plan.sizes)
    G = np.broadcast_to(whiten(parts.G, 1), (T, n, d))
    H = whiten(parts.H, 1)
    design = np.concatenate([G, H], axis=2)
    scale = np.maximum(np.minimum(size, parts.cap), _NO_SIZE)
    penalty = np.concatenate([np.ones((T, d)), scale**-2.0], axis=1) * sigma**2
    residual = whiten((y - parts.mean)[..., None], 1)[..., 0]
    residual = np.broadcast_to(residual, (T, n))
    normal = np.swapaxes(design, 1, 2) @ design
    normal[:, np.arange(d + q), np.arange(d + q)] += penalty
    right = np.einsum("tnk,tn->tk", design, residual)
    try:
        solution = np.linalg.solve(normal, right[..., None])[..., 0]
    except np.linalg.LinAlgError:  # slopes without bound: the simulation breaks down around here
        return Peak(z.copy(), np.inf, np.inf, 0), z, np.full(T, np.inf)
    best_linear = np.einsum("tn,tn->t", residual, residual) - np.einsum("tk,tk->t", right, solution)
    badness = best_linear / sigma**2 - 2 * parts.log_weight
    badness = np.where(np.isnan(badness), np.inf, badness)
    node = int(np.argmin(badness))
    # the fit at z itself: what is nonlinear stays, columns are estimated anew
    held = np.concatenate(
        [z[plan.fixed], (z[plan.sizes] - plan.neutral[plan.sizes]) * parts.H_rms[node, :s]]
    )
    kept = np.r_[: len(plan.fixed), d : d + s]
    free = np.setdiff1d(np.arange(d + q), kept)
    columns = design[node][:, free]
    rest = residual[node] - design[node][:, kept] @ held
    fitted = np.linalg.solve(normal[node][np.ix_(free, free)], columns.T @ rest)
    rest = rest - columns @ fitted
    squares = float(rest @ rest)
    prior = float(penalty[node, kept] @ held**2 + penalty[node, free] @ fitted**2)
    objective = (squares + prior) / sigma**2
    peak = Peak(z.copy(), squares, objective if np.isfinite(objective) else np.inf, node)
    move = z.copy()
    move[plan.fixed] = np.clip(solution[node, : len(plan.fixed)], -6, 6)
    size_move = solution[node, d : d + s] / parts.H_rms[node, :s]
    move[plan.sizes] = np.clip(plan.neutral[plan.sizes] + size_move, -6, 6)
    return peak, move, badness
