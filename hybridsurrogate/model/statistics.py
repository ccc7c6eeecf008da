"""Sufficient statistics of rows, the prior of their unknowns, the powers of likelihoods.

The posterior of a surrogate's coefficients given the simulation alone follows from them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from hybridsurrogate.numerics.linear_algebra import LARGE_BLOCK, NEGLIGIBLE, blocks
from hybridsurrogate.surrogates.basis import Basis
from hybridsurrogate.types import FloatArray, Prior


def powers_of(beta: Any) -> tuple[Any, Any]:
    """Return (alpha_S, alpha_R), the powers of the two likelihoods (arXiv 2412.11875, section 2).

    For a weight or an array of weights.

    Examples
    --------
    >>> powers_of(0.5), powers_of(0.0), powers_of(1.0)
    ((1.0, 1.0), (0.0, 1.0), (1.0, 0.0))
    """
    if np.ndim(beta):
        return np.minimum(beta / np.maximum(1 - beta, 1e-300), 1.0), np.minimum(
            (1 - beta) / np.maximum(beta, 1e-300), 1.0
        )
    if beta < 0.5:
        return beta / (1 - beta), 1.0
    return 1.0, (1 - beta) / beta


def prior_log_density(z: FloatArray) -> FloatArray:
    """Return the log density of standard normal coordinates (J, k), without its constant."""
    return -0.5 * np.einsum("jk,jk->j", z, z)


def prior_of_unknowns(u: FloatArray, noise_prior: Prior) -> FloatArray:
    """Return the log density of u (J, d), without the constant of z."""
    sigma = np.exp(u[:, -1])
    with np.errstate(divide="ignore"):
        return prior_log_density(u[:, :-1]) + noise_prior.logpdf(sigma) + u[:, -1]


@dataclass(frozen=True)
class Statistics:
    """Sufficient statistics of rows ``y = features @ c + noise``: all that a fit needs of them."""

    n: float
    ff: FloatArray
    fy: FloatArray
    yy: float


def statistics(
    features: FloatArray, y: FloatArray, scale: float, weights: FloatArray | None = None
) -> Statistics:
    """Return the sufficient statistics of n rows with features (n, p) and weights (n,)."""
    n = float(len(y))
    if weights is not None:
        n = float(weights.sum())
        features, y = features * np.sqrt(weights)[:, None], y * np.sqrt(weights)
    rounding = n * (NEGLIGIBLE * scale) ** 2
    return Statistics(n, features.T @ features, features.T @ y, float(y @ y) + rounding)


def statistics_of_runs(
    basis: Basis,
    X: FloatArray,
    omega: FloatArray,
    eta: FloatArray,
    scale: float,
    weights: FloatArray | None = None,
) -> Statistics:
    """Return the sufficient statistics of runs, some at a time: they may be on disk.

    Parameters
    ----------
    basis : Basis
    X, omega, eta : ndarray of shape (n, n_inputs), (n, n_parameters), (n,)
    scale : float
        Spread of the outputs.
    weights : ndarray of shape (n,) or None
    """
    p = len(basis.coefficient_mean)
    total = Statistics(0.0, np.zeros((p, p)), np.zeros(p), 0.0)
    for some in blocks(len(eta), 3 * (1 + p), LARGE_BLOCK):
        inputs, parameters = X[some], omega[some]
        part = statistics(
            basis.features(inputs, parameters),
            eta[some] - basis.known(inputs, parameters),
            scale,
            None if weights is None else weights[some],
        )
        total = Statistics(
            total.n + part.n, total.ff + part.ff, total.fy + part.fy, total.yy + part.yy
        )
    return total


class EmulatorPosterior(NamedTuple):
    """Gaussian posterior of the surrogate's coefficients: mean (p,) and factor (p, p) of V."""

    mean: FloatArray
    factor: FloatArray


def emulator_posterior(
    basis: Basis, simulation: Statistics | None, power: float = 1.0
) -> EmulatorPosterior:
    """Return the posterior of the coefficients given the simulation alone, its noise estimated."""
    precision = basis.coefficient_sd**-2.0
    mean = basis.coefficient_mean
    if simulation is None or not power or not simulation.n or not len(mean):
        return EmulatorPosterior(mean, np.diag(basis.coefficient_sd))
    variance = max(simulation.yy / simulation.n, 1e-300)
    for _ in range(8):
        matrix = np.diag(precision) + power * simulation.ff / variance
        right = precision * basis.coefficient_mean + power * simulation.fy / variance
        mean = np.linalg.solve(matrix, right)
        squares = simulation.yy - 2 * mean @ simulation.fy + mean @ simulation.ff @ mean
        used = np.trace(np.linalg.solve(matrix, power * simulation.ff / variance))
        variance = max(squares, 1e-14 * simulation.yy) / max(simulation.n - used, 1.0)
    lower = np.linalg.cholesky(np.diag(precision) + power * simulation.ff / variance)
    return EmulatorPosterior(mean, np.linalg.inv(lower).T)
