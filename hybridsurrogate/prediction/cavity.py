"""Each row given all others, the coefficients of causes integrated out in closed form.

Given everything else, measured rows are jointly Gaussian: y = f + noise, f = eta + H a with
a ~ N(0, I). The density of row i given the others follows from the posterior of f_i by taking the
row's own likelihood out of it (the cavity; Burkner, Gabry and Vehtari 2021, Computational
Statistics 36:1243, do so with the inverse of the covariance). Draws of a, of which a process has
dozens that follow each row, would make importance weights fail.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from hybridsurrogate.model.posterior import Posterior
from hybridsurrogate.model.problem import Problem
from hybridsurrogate.numerics.blocks import LARGE_BLOCK, blocks
from hybridsurrogate.numerics.cholesky import nudged_cholesky
from hybridsurrogate.types import FloatArray


def without_each(
    problem: Problem, posterior: Posterior, index: NDArray[np.intp], less: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return log densities of rows given all others, and what leaving them out takes away.

    Parameters
    ----------
    problem : Problem
        Whose coefficients are Gaussian.
    posterior : Posterior
        S draws; of those of the causes' coefficients nothing is used.
    index : ndarray of int of shape (m,)
        Rows of the problem.
    less : ndarray of shape (m,)
        How much weight each of these loses.

    Returns
    -------
    predicted : ndarray of shape (S, m)
        Log density of a measurement of weight one.
    removed : ndarray of shape (S, m)
        Log of the integral of the likelihood, to the power ``less``, over the cavity.
    """
    n, q = len(problem.y), posterior.effect_coefficients.shape[1]
    parts = [
        _of_some(problem, posterior.take(np.arange(some.start, some.stop)), index, less)
        for some in blocks(posterior.n_draws, n * (q + 2), LARGE_BLOCK)
    ]
    predicted, removed = (np.concatenate(part) for part in zip(*parts, strict=True))
    # densities of y, where the likelihood is normal on another scale
    y, eta = problem.observed[index], problem.y[index]
    jacobian = problem.likelihood.log_density(y, eta, np.ones(len(y))) - norm.logpdf(0.0)
    return predicted + jacobian, removed + less * jacobian


def _of_some(
    problem: Problem, posterior: Posterior, index: NDArray[np.intp], less: FloatArray
) -> tuple[FloatArray, FloatArray]:
    model, X = problem.model, problem.X
    plain = replace(posterior, effect_coefficients=np.zeros_like(posterior.effect_coefficients))
    eta, scale = plain.eta(X)
    columns = model.added(X, posterior.values) * model.column_sd
    root = np.sqrt(problem.weights) / scale
    scaled, residual = columns * root[..., None], (problem.y - eta) * root
    transposed = np.swapaxes(scaled, 1, 2)
    factor = nudged_cholesky(np.eye(columns.shape[2]) + transposed @ scaled)
    # with F F' = I + H'H the posterior of f_i has mean h_i F'^-1 F^-1 H'r and variance |F^-1 h_i|^2
    half = np.linalg.solve(factor, transposed @ residual[..., None])
    asked = np.linalg.solve(factor, np.swapaxes(columns[:, index], 1, 2))
    mean, variance = (np.swapaxes(asked, 1, 2) @ half)[..., 0], np.sum(asked**2, axis=1)
    noise, y = scale[:, index] ** 2, (problem.y - eta)[:, index]
    variance = variance / np.maximum(1 - less * variance / noise, np.finfo(float).eps)
    mean = mean + variance * less * (mean - y) / noise
    predicted = norm.logpdf(y, mean, np.sqrt(variance + noise))
    # N(y; f, s^2)^w = (2 pi s^2)^((1 - w) / 2) w^(-1/2) N(y; f, s^2 / w)
    removed = norm.logpdf(y, mean, np.sqrt(variance + noise / less))
    removed = removed + 0.5 * (1 - less) * np.log(2 * np.pi * noise) - 0.5 * np.log(less)
    return predicted, removed
