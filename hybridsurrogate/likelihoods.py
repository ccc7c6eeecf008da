"""Likelihoods: how a measured value scatters around what the surrogate says.

A likelihood that is normal after a transformation of y keeps everything conditionally Gaussian:
the surrogate then describes the transformed output ``eta``, and ``sigma`` is the scatter there.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from scipy import special

from hybridsurrogate.priors import FloatArray

_LOG_2PI = float(np.log(2 * np.pi))


class Likelihood(ABC):
    """Normal noise with scale ``sigma`` around ``eta`` after a transformation of y.

    ``eta`` and ``sigma`` broadcast against each other; by convention draws come first and rows
    last, so ``eta`` has shape (n_draws, n) and ``sigma`` (n_draws, 1). ``log_scale`` says whether
    eta is the logarithm of the output.
    """

    log_scale = False

    @abstractmethod
    def check(self, y: FloatArray, source: str = "measured") -> None:
        """Raise ValueError when y cannot come from this likelihood; name its source."""

    @abstractmethod
    def transform(self, y: FloatArray) -> FloatArray:
        """Return y on the scale of eta."""

    @abstractmethod
    def inverse(self, eta: FloatArray) -> FloatArray:
        """Return the noise-free output in the units of y."""

    @abstractmethod
    def log_jacobian(self, y: FloatArray) -> FloatArray:
        """Return log |d transform / dy|, shape of y."""

    @abstractmethod
    def mean(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the mean of y."""

    @abstractmethod
    def variance(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the variance of y."""

    def log_density(self, y: FloatArray, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the log density of each y."""
        standardised = (self.transform(y) - eta) / sigma
        return -0.5 * standardised**2 - np.log(sigma) - 0.5 * _LOG_2PI + self.log_jacobian(y)

    def cumulative(self, y: FloatArray, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return P(Y <= y)."""
        return special.ndtr((self.transform(y) - eta) / sigma)

    def sample(
        self, eta: FloatArray, sigma: FloatArray, random_state: np.random.RandomState
    ) -> FloatArray:
        """Draw y once for each eta."""
        eta = np.asarray(eta)
        return self.inverse(eta + sigma * random_state.standard_normal(eta.shape))


@dataclass(frozen=True)
class Normal(Likelihood):
    """Normal noise with standard deviation ``sigma`` in the units of y."""

    def check(self, y: FloatArray, source: str = "measured") -> None:
        """Accept every finite y."""

    def transform(self, y: FloatArray) -> FloatArray:
        """Return y."""
        return np.asarray(y, dtype=float)

    def inverse(self, eta: FloatArray) -> FloatArray:
        """Return eta."""
        return eta

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
class LogNormal(Likelihood):
    """Log-normal noise: log y is normal around eta with standard deviation ``sigma``."""

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

    def transform(self, y: FloatArray) -> FloatArray:
        """Return log y."""
        return np.log(y)

    def inverse(self, eta: FloatArray) -> FloatArray:
        """Return exp(eta), the median of y."""
        return np.exp(np.minimum(eta, 700.0))

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


LIKELIHOODS: dict[str, Likelihood] = {"normal": Normal(), "lognormal": LogNormal()}


def as_likelihood(likelihood: str | Likelihood) -> Likelihood:
    """Return the likelihood object for a name, or the object itself."""
    if isinstance(likelihood, Likelihood):
        return likelihood
    try:
        return LIKELIHOODS[likelihood]
    except (KeyError, TypeError):
        raise ValueError(
            f"likelihood must be one of {sorted(LIKELIHOODS)} or a Likelihood object, "
            f"got {likelihood!r}."
        ) from None
