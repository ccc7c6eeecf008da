"""The linearised model of one cause, given the data: what it predicts at any rows."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from hybridsurrogate.diagnosis.search.candidate import Candidate
from hybridsurrogate.diagnosis.search.search import Search
from hybridsurrogate.inference.evidence.linearised import Linearised, linearise
from hybridsurrogate.inference.evidence.marginal_likelihood import scan
from hybridsurrogate.types import FloatArray

# two explanations are the same to the measured rows if they are less than so many nats apart, and
# less than this share of how far either is from nothing wrong
_SAME, _OF_EFFECT = 0.5, 0.02


class Local(NamedTuple):
    """Gaussian posterior of the linear coefficients [g, u, h] of a cause at one node."""

    mean: FloatArray
    covariance: FloatArray


class LinearisedRows(NamedTuple):
    """Rows under one cause at one node.

    ``offset`` (n,), ``design`` (n, d + r + q) with raw columns, the sizes from column ``first`` on,
    ``noise`` (n,) the factor on sigma.
    """

    offset: FloatArray
    design: FloatArray
    first: int
    noise: FloatArray


def measured_and_other(
    result: Search, w: Candidate, X: FloatArray, node: int | None = None
) -> tuple[LinearisedRows, LinearisedRows]:
    """Return the measured rows and rows X; what an emulator leaves open they have in common."""
    n = len(result.problem.X)
    both = np.vstack([result.problem.X, result.problem.with_noise(X)])
    parts = _at_node(result, w, both, w.fit.mode.node if node is None else node)
    H = parts.H[0] * parts.H_rms[0]
    design = np.hstack([parts.G[0], parts.U, H])
    first = design.shape[1] - H.shape[1]
    noise = np.ones(len(both)) if parts.noise is None else parts.noise[0]
    pieces = slice(n), slice(n, None)
    measured, others = (
        LinearisedRows(parts.mean[0][k], design[k], first, noise[k]) for k in pieces
    )
    return measured, others


def _at_node(result: Search, w: Candidate, X: FloatArray, node: int) -> Linearised:
    grid = w.fit.grid
    if len(grid.nodes):
        index = slice(node, node + 1)
        grid = replace(
            grid, points=grid.points[index], edges=grid.edges[index], log_weight=np.zeros(1)
        )
    return linearise(w.fit.model, X, result.context.emulator, grid, w.fit.mode.z)


def local_posterior(result: Search, w: Candidate, rows: LinearisedRows, size: float) -> Local:
    """Return the posterior of a cause's linear coefficients, its size of scale ``size``."""
    design, first = rows.design, rows.first
    H = design[:, first:]
    if w.cause is not None and w.cause.is_process:
        rms = np.full(H.shape[1], np.sqrt(np.mean(np.sum(H**2, axis=1))))
    else:
        rms = np.sqrt(np.mean(H**2, axis=0))
    # what moves no measured row, as beyond the range of the runs, is not learned: any scale does
    own = np.divide(size, rms, out=np.ones_like(rms), where=rms > 0)
    scale = np.concatenate([np.ones(first), own])
    design = design / rows.noise[:, None]
    residual = (result.problem.y - rows.offset) / rows.noise
    precision = design.T @ design / w.fit.sigma**2 + np.diag(scale**-2.0)
    covariance = np.linalg.inv(precision)
    mean = covariance @ design.T @ residual / w.fit.sigma**2
    return Local(mean, covariance)


def size_of(result: Search, w: Candidate, node: int | None = None) -> float:
    """Return the prior scale of a cause's size: the largest, or of a process the likeliest.

    A path in the noise, or the curves of experiments, has a size that the measured rows determine:
    other rows and another experiment deviate as far as they do.
    """
    if w.cause is None or "amplitude" not in w.cause.parameters or not w.cause.is_process:
        return float(result.sizes[-1])
    parts = _at_node(result, w, result.problem.X, w.fit.mode.node if node is None else node)
    args = parts, result.problem.y[None], w.fit.sigma, result.context.noise
    evidence = [float(scan(*args, result.sizes[k : k + 1])[0, 0]) for k in range(len(result.sizes))]
    return float(result.sizes[int(np.argmax(evidence))])


def predict_locally(
    result: Search, w: Candidate, X: FloatArray, node: int | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return mean and variance of a new noisy eta at rows X (n, n_columns) under one cause.

    Given what is not a size, such as a period, at one node of its grid; None: the best one.
    """
    mean, loadings, variance = predict_jointly(result, w, X, node)
    return mean, variance + np.sum(loadings**2, axis=1)


def predict_jointly(
    result: Search, w: Candidate, X: FloatArray, node: int | None = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return new noisy eta at rows X (n, n_columns), which share what is not known of the cause.

    Returns
    -------
    mean : ndarray of shape (n,)
    loadings : ndarray of shape (n, k)
        Loadings times their transpose is the covariance of the noise-free values.
    variance : ndarray of shape (n,)
        Of the noise.
    """
    measured, rows = measured_and_other(result, w, X, node)
    local = local_posterior(result, w, measured, size_of(result, w, node))
    # a root that exists where rounding has left a variance a little below zero, too
    variances, directions = np.linalg.eigh((local.covariance + local.covariance.T) / 2)
    loadings = rows.design @ (directions * np.sqrt(np.maximum(variances, 0.0)))
    return rows.offset + rows.design @ local.mean, loadings, (w.fit.sigma * rows.noise) ** 2


def predicted_rows(result: Search, w: Candidate) -> tuple[FloatArray, FloatArray]:
    """Return mean and variance of the noise of the measured rows under a cause at its best."""
    mean, _, variance = predict_jointly(result, w, result.problem.X)
    return mean, variance


def draw_the_same(result: Search, one: Candidate, other: Candidate) -> bool:
    """Return whether no measurement at these rows could separate two causes.

    Their expected log likelihood ratio, the Kullback-Leibler divergence between the noisy rows that
    either predicts, is less than a half, and small against that from what nothing wrong predicts: a
    trend and a drift of the slope of a line, or noise that grows and an input in error.
    """
    first, second, nothing = (predicted_rows(result, w) for w in (one, other, result.candidates[0]))
    return _divergence(first, second) < min(_SAME, _OF_EFFECT * _divergence(first, nothing))


def _divergence(one: tuple[FloatArray, FloatArray], other: tuple[FloatArray, FloatArray]) -> float:
    """Return the Kullback-Leibler divergence between independent normal rows."""
    gap, ratio = one[0] - other[0], one[1] / other[1]
    return float(np.sum(ratio - 1 - np.log(ratio) + gap**2 / other[1]) / 2)
