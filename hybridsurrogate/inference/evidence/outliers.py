"""Evidence and best fit of linearised rows of which some are outliers.

Rows are independent given the latent directions v ~ N(0, I) of the linearised model and sigma, but
not Gaussian. Their mode is found by the EM algorithm (an outlier counts with the precision that its
residual gives it), and what is around it is integrated by Laplace's approximation, with the true
curvature of the density and a Newton step's worth of what EM left. Against quadrature the evidence
is low by about 2 / n nats (0.05 at 40 rows; at a share at which rows can be read either way it is
off by up to 0.3, and counts little). Everything is done for all nodes at once; the cost is linear
in the rows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from hybridsurrogate.inference.evidence.grid import Grid
from hybridsurrogate.inference.evidence.linearised import Linearised
from hybridsurrogate.inference.evidence.settings import SETTINGS
from hybridsurrogate.likelihoods.student_t import log_shape, precision_at
from hybridsurrogate.types import FloatArray

# a robust guess of sigma from the median residual
_TO_SIGMA = 1.4826

LogPrior = Callable[[FloatArray], FloatArray]

# steps of differences of log sigma and of standardised residuals
_DS, _DZ = 1e-3, 1e-4


class Mode(NamedTuple):
    """Modes of the nodes.

    Attributes
    ----------
    v : ndarray of shape (T, k)
    sigma : ndarray of shape (T,)
    log_joint : ndarray of shape (T,)
        Log density of rows, v and log sigma, less the constant of the prior of v.
    z : ndarray of shape (T, n)
        Standardised residuals.
    """

    v: FloatArray
    sigma: FloatArray
    log_joint: FloatArray
    z: FloatArray


def _find_mode(
    residual: FloatArray,
    design: FloatArray,
    noise: FloatArray,
    share: FloatArray,
    log_prior: LogPrior,
) -> Mode:
    """Climb by EM from a least-squares fit.

    Parameters
    ----------
    residual : ndarray of shape (T or 1, n)
        Response minus mean.
    design : ndarray of shape (T or 1, n, k)
    noise : ndarray of shape (T or 1, n)
        Factor on sigma.
    share : ndarray of shape (T, 1)
        Of outliers.
    log_prior : callable
        Log density of log sigma.
    """
    D, residual = design / noise[..., None], residual / noise
    n, k = design.shape[1:]
    residual = np.broadcast_to(residual, (len(share), n))
    weight: FloatArray = np.ones(residual.shape)
    transposed = np.swapaxes(D, 1, 2)
    sigma: FloatArray = np.maximum(np.std(residual, axis=1), 1e-300)
    v: FloatArray = np.zeros((len(share), k))
    rest = residual
    for step in range(SETTINGS.optimiser_steps):
        if k:
            normal = transposed @ (weight[..., None] * D)
            right = (transposed @ (weight * residual)[..., None])[..., 0]
            normal[..., np.arange(k), np.arange(k)] += (sigma**2)[..., None]
            v = np.linalg.solve(normal, right[..., None])[..., 0]
            rest = residual - (D @ v[..., None])[..., 0]
        if step == 0:
            sigma = _TO_SIGMA * np.median(np.abs(rest), axis=1)
        else:
            before = sigma
            z = rest / sigma[:, None]
            # EM is slow where rows may be outliers or not: Newton's step in log sigma, kept short.
            # The prior of sigma is weak compared with the rows, and left to the evidence
            squares = np.einsum("tn,tn->t", weight, z**2)
            bend = squares + np.einsum("tn,tn->t", _curvature(z, share), z**2)
            move = (squares - n) / np.maximum(bend, SETTINGS.outlier_least_curvature * n)
            sigma = sigma * np.exp(
                np.clip(move, -SETTINGS.outlier_longest_step, SETTINGS.outlier_longest_step)
            )
        sigma = np.maximum(sigma, 1e-300)
        weight = precision_at(rest / sigma[:, None], share)
        if step and np.max(np.abs(sigma / before - 1)) < SETTINGS.outlier_converged:
            break
    z = rest / sigma[:, None]
    log_noise = np.sum(np.log(noise), axis=-1)
    log_joint = log_shape(z, share).sum(axis=1) - n * np.log(sigma) - log_noise
    log_joint += log_prior(np.log(sigma)) - 0.5 * np.sum(v**2, axis=1)
    return Mode(v, sigma, log_joint, z)


def _curvature(z: FloatArray, share: FloatArray) -> FloatArray:
    """Return minus the second derivative of the log density of standardised residuals."""
    upper, lower = ((z + d) * precision_at(z + d, share) for d in (_DZ, -_DZ))
    return (upper - lower) / (2 * _DZ)


def _slope(log_prior: LogPrior, log_sigma: FloatArray) -> FloatArray:
    return (log_prior(log_sigma + _DS) - log_prior(log_sigma - _DS)) / (2 * _DS)


def log_evidence(
    residual: FloatArray,
    design: FloatArray,
    noise: FloatArray,
    share: FloatArray,
    log_prior: LogPrior,
) -> FloatArray:
    """Return the log evidence of every node, (T,); arguments as in `_find_mode`."""
    mode = _find_mode(residual, design, noise, share, log_prior)
    D = design / noise[..., None]
    transposed = np.swapaxes(D, 1, 2)
    z, sigma, k = mode.z, mode.sigma, design.shape[2]
    first, second = z * precision_at(z, share), _curvature(z, share)
    # minus the second derivatives of the log joint density in (v, log sigma), and its gradient
    hessian = np.empty((len(sigma), k + 1, k + 1))
    hessian[:, :k, :k] = transposed @ (second[..., None] * D)
    hessian[:, :k, :k] /= (sigma**2)[:, None, None]
    hessian[:, np.arange(k), np.arange(k)] += 1.0
    mixed = (transposed @ (first + z * second)[..., None])[..., 0] / sigma[:, None]
    hessian[:, :k, k] = hessian[:, k, :k] = mixed
    at = np.log(sigma)
    bend = _slope(log_prior, at + _DS) - _slope(log_prior, at - _DS)
    hessian[:, k, k] = np.sum(z * (first + z * second), axis=1) - bend / (2 * _DS)
    gradient = np.empty((len(sigma), k + 1))
    gradient[:, :k] = (transposed @ first[..., None])[..., 0] / sigma[:, None] - mode.v
    gradient[:, k] = np.sum(z * first, axis=1) - z.shape[1] + _slope(log_prior, at)
    eigenvalue, vector = np.linalg.eigh(hessian)
    # saddles between two readings of a row: no direction is wider than its prior
    eigenvalue = np.maximum(eigenvalue, 0.5)
    along = (np.swapaxes(vector, -1, -2) @ gradient[..., None])[..., 0]
    left = np.minimum(0.5 * np.sum(along**2 / eigenvalue, axis=1), SETTINGS.outlier_newton)
    log_det = np.sum(np.log(eigenvalue), axis=1)
    return mode.log_joint + left + 0.5 * np.log(2 * np.pi) - 0.5 * log_det


def at_best_node(parts: Linearised, y: FloatArray, sigma: float) -> Linearised:
    """Return the model at its first node, where rows are normal and each has a separate scale.

    With outliers the residual of a row gives its scale. The evidence of a further curve then has a
    closed form.
    """
    parts = replace(parts.at(np.array([0])), log_weight=np.zeros(1))
    if parts.outliers is None:
        return parts
    noise, share = _noise(parts), parts.outliers[:, None]
    design = _design(parts, parts.H[..., :0], _emulator_directions(parts.U, sigma))
    mode = _find_mode(y - parts.mean, design, noise, share, np.zeros_like)
    factor = precision_at(mode.z, share) ** -0.5
    return replace(parts, noise=factor * noise, outliers=None)


def _emulator_directions(U: FloatArray, sigma: float) -> FloatArray:
    """Return the directions (n, r) of a fixed covariance that are not small against sigma."""
    if not U.size:
        return U.reshape(len(U), 0)
    Q, singular, _ = np.linalg.svd(U, full_matrices=False)
    large = singular > SETTINGS.emulator_share * sigma
    return Q[:, large] * singular[large]


def _noise(parts: Linearised) -> FloatArray:
    return np.ones((1, parts.H.shape[1])) if parts.noise is None else parts.noise


def _design(parts: Linearised, H: FloatArray, U: FloatArray) -> FloatArray:
    """Return [G, H, U] (M, n, k) of columns H (T, n, q); M is 1 where nodes share all of it."""
    M = max(len(parts.G), len(H) if H.shape[2] else 1)
    return np.concatenate(
        [np.broadcast_to(a, (M, *a.shape[-2:])) for a in (parts.G, H[:M], U)], axis=2
    )


def heavy_scan(
    parts: Linearised,
    y: FloatArray,
    sigma: float,
    log_prior: LogPrior,
    sizes: FloatArray,
) -> FloatArray:
    """Return the log evidence of every node, (T,), for one response y (n,) and outliers.

    Of ``sigma`` only the emulator's error needs a guess.
    """
    assert parts.outliers is not None
    U, share = _emulator_directions(parts.U, sigma), parts.outliers[:, None]
    terms = []
    for size in sizes if parts.H.shape[2] else sizes[:1]:
        design = _design(parts, parts.H * np.minimum(size, parts.cap)[:, None, :], U)
        terms.append(log_evidence(y - parts.mean, design, _noise(parts), share, log_prior))
    out = np.logaddexp.reduce(terms, axis=0) - np.log(len(terms)) + parts.log_weight
    return np.where(np.isnan(out), -np.inf, out)


class HeavyFit(NamedTuple):
    """What an optimiser needs to know of a point, as a `LocalMode` has it, and where to go next."""

    squares: float
    objective: float
    node: int
    move: FloatArray
    deviance: FloatArray


def heavy_fit(
    parts: Linearised, y: FloatArray, grid: Grid, z: FloatArray, sigma: float, size: float
) -> HeavyFit:
    """Fit parts with outliers at z, and find the best of the linear model; sigma is free."""
    assert parts.outliers is not None
    d, s, noise = parts.G.shape[2], len(grid.sizes), _noise(parts)
    scale = np.minimum(size, parts.cap)
    design = _design(parts, parts.H * scale[:, None, :], _emulator_directions(parts.U, sigma))
    residual, share = y - parts.mean, parts.outliers[:, None]
    linear = _find_mode(residual, design, noise, share, np.zeros_like)
    deviance = -2 * (linear.log_joint + parts.log_weight)
    deviance = np.where(np.isnan(deviance), np.inf, deviance)
    node = int(np.argmin(deviance))
    solution = linear.v[node]
    to_z = scale[node, :s] / parts.H_rms[node, :s]
    conditioned = np.concatenate([z[grid.fixed], (z[grid.sizes] - grid.neutral[grid.sizes]) / to_z])
    at = min(node, len(design) - 1)
    kept = np.r_[: len(grid.fixed), d : d + s]
    free = np.setdiff1d(np.arange(design.shape[2]), kept)
    rest = residual[min(node, len(residual) - 1)] - design[at][:, kept] @ conditioned
    noise = noise[min(node, len(noise) - 1)][None]
    here = _find_mode(
        rest[None], design[at][None, :, free], noise, share[node : node + 1], np.zeros_like
    )
    objective = -2 * float(here.log_joint[0]) + float(conditioned @ conditioned)
    move = z.copy()
    move[grid.fixed] = np.clip(solution[: len(grid.fixed)], -6, 6)
    move[grid.sizes] = np.clip(grid.neutral[grid.sizes] + solution[d : d + s] * to_z, -6, 6)
    squares = len(y) * float(here.sigma[0]) ** 2
    return HeavyFit(squares, objective if np.isfinite(objective) else np.inf, node, move, deviance)
