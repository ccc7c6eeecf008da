"""The noise scale sigma integrated out on a one-dimensional grid."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hybridsurrogate.numerics.linear_algebra import NEGLIGIBLE, blocks
from hybridsurrogate.priors import N_TABLE
from hybridsurrogate.types import FloatArray, Prior

# log integral over sigma of prior times likelihood, for residual sums of squares
LogMarginal = Callable[[FloatArray], FloatArray]


def noise_grid(noise_prior: Prior, scale: float, n: float) -> tuple[FloatArray, FloatArray]:
    """Return nodes of log sigma and the log prior density there, fine enough for n rows."""
    bottom, top = float(noise_prior.ppf(1e-12)), float(noise_prior.isf(1e-12))
    low, high = np.log(max(bottom, np.exp(-1) * NEGLIGIBLE * scale)), np.log(max(top, 10 * scale))
    # a prior that says little leaves room for outputs far off; a narrow one must be resolved
    if top <= 2 * bottom:
        low, high = np.log(bottom), np.log(top)
    # given n rows log sigma has a standard deviation of about 1 / sqrt(2 n)
    n_nodes = max(int(np.ceil((high - low) * 3 * np.sqrt(2 * n))), 60)
    nodes = np.linspace(low, high, n_nodes + 1)
    with np.errstate(divide="ignore"):
        return nodes, noise_prior.logpdf(np.exp(nodes)) + nodes


def marginal_over_noise(
    squares: FloatArray,
    n: float,
    log_sigma: FloatArray,
    log_weight: FloatArray,
    n_nodes: int = 160,
    width: float | None = None,
) -> FloatArray:
    """Return log of the integral over sigma of prior times likelihood, for each sum of squares.

    It depends on the sum alone, so it is tabulated once and interpolated. ``width`` is that of the
    cells to which the weights belong; None: of those of log sigma, which is even.
    """
    low, high = np.log(squares.min()) - 1e-6, np.log(squares.max()) + 1e-6
    table = np.linspace(low, high, n_nodes)
    width = log_sigma[1] - log_sigma[0] if width is None else width
    values, constant = np.empty(n_nodes), log_weight - n * log_sigma
    # half a sum of squares over sigma^2 as a product: one exponential fewer of each pair
    share, largest = np.exp(table - high), 0.5 * np.exp(high - 2 * log_sigma)
    for block in blocks(n_nodes, len(log_sigma)):
        log_terms = constant - share[block, None] * largest
        peak = log_terms.max(axis=1)
        log_terms -= peak[:, None]
        values[block] = peak + np.log(np.exp(log_terms, out=log_terms).sum(axis=1) * width)
    # linear interpolation on even nodes, without the search of np.interp
    flat, out, slope = squares.ravel(), np.empty(squares.size), np.diff(values)
    for block in blocks(flat.size, 1):
        position = (np.log(flat[block]) - low) * ((len(table) - 1) / (high - low))
        index = np.minimum(position.astype(np.intp), len(table) - 2)
        out[block] = values[index] + slope[index] * (position - index)
    return out.reshape(squares.shape)


class NoiseTable:
    """Log of the integral over sigma of prior times likelihood, for any residual sum of squares.

    Tabulated once over all sums that can occur, for the many calls of a search.

    Parameters
    ----------
    noise_prior : prior of sigma
    scale : float
        Spread of the output.
    n : int
        Number of rows.
    least : float, default=0.0
        Known noise, to which that of the prior is added in quadrature.
    """

    def __init__(self, noise_prior: Prior, scale: float, n: int, least: float = 0.0):
        self._low = np.log(n) + 2 * np.log(NEGLIGIBLE * scale)
        self._high = np.log(n) + 2 * np.log(1e4 * scale)
        squares = np.exp(np.linspace(self._low, self._high, N_TABLE))
        log_sigma, log_weight = noise_grid(noise_prior, scale, n)
        width = log_sigma[1] - log_sigma[0]
        if least:
            log_sigma = np.log(np.hypot(np.exp(log_sigma), least))
        self._values = marginal_over_noise(squares, n, log_sigma, log_weight, N_TABLE, width)
        self._values -= 0.5 * n * np.log(2 * np.pi)
        self._slopes = np.diff(self._values)

    def __call__(self, squares: FloatArray) -> FloatArray:
        """Return the log integral, linear in log squares between the nodes; NaN stays NaN."""
        step = (self._high - self._low) / (N_TABLE - 1)
        position = np.maximum((np.log(squares) - self._low) / step, 0.0)
        index = np.fmin(position, N_TABLE - 2.0).astype(np.intp)
        return self._values[index] + self._slopes[index] * (position - index)


class KnownNoise:
    """As `NoiseTable` where every row has the noise that it carries, times a known sigma.

    Parameters
    ----------
    n : int
        Number of rows.
    sigma : float, default=1.0
    """

    def __init__(self, n: int, sigma: float = 1.0):
        self._constant = -0.5 * n * float(np.log(2 * np.pi * sigma**2))
        self._precision = sigma**-2.0

    def __call__(self, squares: FloatArray) -> FloatArray:
        """Return the log density of rows with these sums of squares."""
        return self._constant - 0.5 * self._precision * squares
