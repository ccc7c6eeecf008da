"""Likelihoods that are normal after a transformation of y.

The surrogate describes the transformed output ``eta``, and ``sigma`` is the scatter there.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np
from scipy import special, stats

from hybridsurrogate.likelihoods.base import Likelihood, register
from hybridsurrogate.types import FloatArray, Prior

_LOG_2PI = float(np.log(2 * np.pi))


class TransformedNormal(Likelihood):
    """Normal noise with scale ``sigma`` around ``eta`` after a transformation of y.

    Everything stays conditionally Gaussian.

    Examples
    --------
    The derivative of the log density in eta, (5 - 3) / 2^2, and the curvature, 1 / 2^2:

    >>> Normal().derivatives(np.array([5.0]), np.array([[3.0]]), np.array([[2.0]]))
    (array([[0.5]]), array([[0.25]]))
    """

    scales_noise = True
    gaussian = True

    def information(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return 1 / sigma^2."""
        return np.broadcast_to(np.asarray(sigma) ** -2.0, np.shape(eta))

    @abstractmethod
    def log_jacobian(self, y: FloatArray) -> FloatArray:
        """Return log |d link / dy|, shape of y."""

    def working(self, y: FloatArray) -> FloatArray:
        """Return the link of y."""
        return self.link(y)

    def scatter(self, errors: FloatArray, y: FloatArray) -> FloatArray:
        """Return errors times |d link / dy|: of log y relative errors."""
        return errors * np.exp(self.log_jacobian(y))

    def noise_prior(self, scale: float) -> Prior:
        """Return a half-normal prior with the spread of the output as scale."""
        return stats.halfnorm(scale=scale)

    def log_density(self, y: FloatArray, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the log density of each y."""
        standardised = (self.link(y) - eta) / sigma
        return -0.5 * standardised**2 - np.log(sigma) - 0.5 * _LOG_2PI + self.log_jacobian(y)

    def log_below(self, y: FloatArray, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the log probability of y or less."""
        return np.asarray(special.log_ndtr((self._link(y) - eta) / sigma))

    def log_above(self, y: FloatArray, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the log probability of y or more."""
        return np.asarray(special.log_ndtr((eta - self._link(y)) / sigma))

    def _link(self, y: FloatArray) -> FloatArray:
        """Return the link of any y: the least where a positive value was rounded to nothing."""
        return self.link(np.maximum(y, np.finfo(float).tiny)) if self.log_scale else self.link(y)

    def derivatives(
        self, y: FloatArray, eta: FloatArray, sigma: FloatArray, width: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Return (link(y) - eta) / sigma^2, and 1 / sigma^2."""
        precision = np.broadcast_to(np.asarray(sigma) ** -2.0, np.shape(eta))
        return (self.link(y) - eta) * precision, precision

    def sample(
        self, eta: FloatArray, sigma: FloatArray, random_state: np.random.RandomState
    ) -> FloatArray:
        """Draw y once for each eta."""
        eta = np.asarray(eta)
        return self.inverse(eta + sigma * random_state.standard_normal(eta.shape))


@dataclass(frozen=True)
class Normal(TransformedNormal):
    """Normal noise with standard deviation ``sigma`` in the units of y.

    Examples
    --------
    >>> eta, sigma = np.array([[20.0]]), np.array([[3.0]])
    >>> Normal().mean(eta, sigma), Normal().variance(eta, sigma)
    (array([[20.]]), array([[9.]]))
    """

    name = "normal"

    def log_jacobian(self, y: FloatArray) -> FloatArray:
        """Return zeros."""
        return np.zeros_like(y, dtype=float)

    def mean(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return eta."""
        return eta

    def variance(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return sigma squared."""
        return np.broadcast_to(np.square(sigma), np.broadcast_shapes(eta.shape, np.shape(sigma)))


@dataclass(frozen=True)
class LogNormal(TransformedNormal):
    """Log-normal noise: log y is normal around eta with standard deviation ``sigma``.

    Examples
    --------
    With sigma^2 = 2 log 2 the mean is twice the median:

    >>> eta, sigma = np.log([[20.0]]), np.sqrt(2 * np.log([[2.0]]))
    >>> LogNormal().inverse(eta).round(6), LogNormal().mean(eta, sigma).round(6)
    (array([[20.]]), array([[40.]]))
    """

    name = "log-normal"
    log_scale = True

    def check(self, y: FloatArray, source: str = "measured") -> None:
        """Raise ValueError unless all y are positive."""
        bad = np.flatnonzero(~(y > 0))
        if bad.size:
            raise ValueError(
                f"The log-normal likelihood needs y > 0, but {bad.size} of {y.size} {source} "
                f"values are zero or negative (first at row {bad[0]}: {y[bad[0]]:g}). Use "
                "likelihood='normal', or shift measured and simulated values alike (counts: "
                "y + 1)."
            )

    def log_jacobian(self, y: FloatArray) -> FloatArray:
        """Return -log y."""
        return -np.log(y)

    def mean(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return exp(eta + sigma^2 / 2)."""
        return self.inverse(eta + 0.5 * np.square(sigma))

    def variance(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return (exp(sigma^2) - 1) exp(2 eta + sigma^2)."""
        with np.errstate(over="ignore"):
            return np.expm1(np.square(sigma)) * self.inverse(2 * eta + np.square(sigma))


register("normal", Normal())
register("lognormal", LogNormal())
