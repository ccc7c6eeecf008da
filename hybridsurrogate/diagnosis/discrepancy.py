"""The linearised model of one cause, given the data: what it says at any inputs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from hybridsurrogate.diagnosis.evidence import Search, Weighed
from hybridsurrogate.inference.linearised import Linearised, linearise
from hybridsurrogate.priors import FloatArray

_Z90 = 1.6448536269514722


@dataclass(frozen=True)
class Discrepancy:
    """Where and how much the simulation is wrong, on the scale of eta.

    Attributes
    ----------
    grid : ndarray of shape (m, n_columns)
        Rows that vary one input over its measured range, the other columns at their medians.
    column : str
        The input that varies.
    mean, lower, upper : ndarray of shape (m,)
        Measured minus simulated, with a pointwise 90 % band.
    """

    grid: FloatArray
    column: str
    mean: FloatArray
    lower: FloatArray
    upper: FloatArray

    @property
    def share_outside(self) -> float:
        """Share of the range in which the band excludes zero."""
        return float(np.mean((self.lower > 0) | (self.upper < 0)))


class _Local(NamedTuple):
    """Gaussian posterior of the linear coefficients [g, u, h] of a cause at its best node."""

    mean: FloatArray
    covariance: FloatArray


class _Rows(NamedTuple):
    """Rows under one cause at its best node.

    ``offset`` (n,), ``design`` (n, d + r + q) with raw columns, the sizes from column ``first`` on,
    ``noise`` (n,) the factor on sigma.
    """

    offset: FloatArray
    design: FloatArray
    first: int
    noise: FloatArray


def _rows(found: Search, w: Weighed, X: FloatArray) -> _Rows:
    parts = _at_best_node(found, w, X)
    H = parts.H[0] * parts.H_rms[0]
    design = np.hstack([parts.G[0], parts.U, H])
    noise = np.ones(len(X)) if parts.noise is None else parts.noise[0]
    return _Rows(parts.mean[0], design, design.shape[1] - H.shape[1], noise)


def _at_best_node(found: Search, w: Weighed, X: FloatArray) -> Linearised:
    plan = w.plan
    if len(plan.nodes):
        index = slice(w.peak.node, w.peak.node + 1)
        plan = replace(plan, grid=plan.grid[index], edges=plan.edges[index], log_weight=np.zeros(1))
    return linearise(w.model, X, found.belief, plan, w.peak.z)


def _posterior(found: Search, w: Weighed, size: float) -> _Local:
    rows = _rows(found, w, found.problem.X)
    design, first = rows.design, rows.first
    H = design[:, first:]
    if w.cause is not None and w.cause.kind == "unexplained":
        rms = np.full(H.shape[1], np.sqrt(np.mean(np.sum(H**2, axis=1))))
    else:
        rms = np.sqrt(np.mean(H**2, axis=0))
    scale = np.concatenate([np.ones(first), size / np.maximum(rms, 1e-300)])
    design = design / rows.noise[:, None]
    residual = (found.problem.y - rows.offset) / rows.noise
    precision = design.T @ design / w.sigma**2 + np.diag(scale**-2.0)
    covariance = np.linalg.inv(precision)
    mean = covariance @ design.T @ residual / w.sigma**2
    return _Local(mean, covariance)


def predict_locally(found: Search, w: Weighed, X: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return mean and variance of a new noisy eta at rows X (n, n_columns) under one cause."""
    local = _posterior(found, w, float(found.sizes[-1]))
    rows = _rows(found, w, X)
    variance = np.einsum("nk,kl,nl->n", rows.design, local.covariance, rows.design)
    return rows.offset + rows.design @ local.mean, variance + (w.sigma * rows.noise) ** 2


def estimate_discrepancy(found: Search, column: str, n_grid: int = 200) -> Discrepancy:
    """Return the smooth discrepancy over one input, by the catch-all Gaussian process."""
    problem = found.problem
    process = next(w for w in found.weighed if w.cause and w.cause.kind == "unexplained")
    k = problem.model.columns.index(column)
    grid = np.repeat(np.median(problem.X, axis=0)[None], n_grid, axis=0)
    grid[:, k] = np.linspace(problem.X[:, k].min(), problem.X[:, k].max(), n_grid)
    # the size that the residuals themselves suggest, so that noise is not drawn as a curve
    residual = problem.y - _fitted(found)
    size = float(np.clip(np.std(residual), found.sizes[0], found.sizes[-1]))
    local = _posterior(found, process, size)
    rows = _rows(found, process, grid)
    H = rows.design[:, rows.first :]
    mean = H @ local.mean[rows.first :]
    sd = np.sqrt(np.einsum("nk,kl,nl->n", H, local.covariance[rows.first :, rows.first :], H))
    return Discrepancy(grid, column, mean, mean - _Z90 * sd, mean + _Z90 * sd)


def _fitted(found: Search) -> FloatArray:
    return predict_locally(found, found.weighed[0], found.problem.X)[0]


def next_measurement(found: Search, grid: FloatArray) -> FloatArray:
    """Return for each row of inputs how much one more measurement there tells rivals apart.

    Expected information between the causes in nats, by the variance of their predictive means
    against their predictive variance: 1/2 log(1 + between / within).

    Parameters
    ----------
    grid : ndarray of shape (m, n_columns)

    Returns
    -------
    ndarray of shape (m,)
    """
    order = np.argsort(-found.probability)[:4]
    weight = found.probability[order] + 1e-3
    weight = weight / weight.sum()
    means, variances = map(
        np.array, zip(*(predict_locally(found, found.weighed[k], grid) for k in order), strict=True)
    )
    centre = weight @ means
    between = weight @ (means - centre) ** 2
    return 0.5 * np.log1p(between / (weight @ variances))
