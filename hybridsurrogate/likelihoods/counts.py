"""Counts: negative binomial and Poisson, with the logarithm of the mean as eta."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special, stats

from hybridsurrogate.likelihoods.base import MAX_ETA, SMALLEST_COUNT, Likelihood, register
from hybridsurrogate.likelihoods.student_t import GivenScale
from hybridsurrogate.types import FloatArray, Prior


class _Counts(Likelihood):
    log_scale = True
    means_as_runs = True

    def check(self, y: FloatArray, source: str = "measured") -> None:
        """Raise ValueError unless all y are whole numbers from zero on.

        Simulated values may be expected counts: any finite numbers from zero on.
        """
        whole = y == np.round(y) if source != "simulated" else np.isfinite(y)
        bad = np.flatnonzero(~((y >= 0) & whole))
        if bad.size:
            what = "negative" if y[bad[0]] < 0 else "no whole number"
            needed = (
                "expected counts of zero or more"
                if source == "simulated"
                else "counts 0, 1, 2, ..."
            )
            raise ValueError(
                f"The {self.name} likelihood needs {needed}, but {bad.size} of {y.size} "
                f"{source} values are not (first at row {bad[0]}: {y[bad[0]]:g} is {what}). Use "
                "likelihood='lognormal' or 'normal' for outputs that are no counts."
            )

    def working(self, y: FloatArray) -> FloatArray:
        """Return log(y + 1/2)."""
        return np.log(y + 0.5)

    def working_runs(self, y: FloatArray) -> FloatArray:
        """Return log(y + 1/2) of whole numbers, and log(y) of expected counts."""
        if np.all(y == np.round(y)):
            return self.working(y)
        return np.log(np.maximum(y, SMALLEST_COUNT))

    def rounding(self, eta: FloatArray) -> FloatArray:
        """Return 1 / (sqrt(12) mean): uniform errors of the mean, to first order."""
        return 1 / (np.sqrt(12) * self.inverse(eta))

    def inverse(self, eta: FloatArray) -> FloatArray:
        """Return exp(eta)."""
        return np.exp(np.minimum(eta, MAX_ETA))

    def mean(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return exp(eta)."""
        return self.inverse(eta)


@dataclass(frozen=True)
class Poisson(_Counts):
    """Counts whose variance is their mean; there is no second parameter.

    Examples
    --------
    >>> eta = np.log([[20.0]])
    >>> Poisson().variance(eta, None).round(6)
    array([[20.]])
    """

    name = "Poisson"
    has_scale = False
    remedy_of_scatter = "use likelihood='negative-binomial'"

    def log_density(self, y: FloatArray, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the log probability of each y."""
        return y * eta - self.inverse(eta) - special.gammaln(y + 1)

    def log_below(self, y: FloatArray, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the log probability of y or less: an incomplete gamma function."""
        return _log_tail(special.gammaincc(np.floor(y) + 1, self.inverse(eta)), self, y, eta, sigma)

    def log_above(self, y: FloatArray, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the log probability of y or more."""
        y = np.ceil(y)
        found = np.where(y > 0, special.gammainc(np.maximum(y, 1), self.inverse(eta)), 1.0)
        return _log_tail(found, self, y, eta, sigma)

    def variance(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return exp(eta)."""
        return self.inverse(eta)

    def sample(
        self, eta: FloatArray, sigma: FloatArray, random_state: np.random.RandomState
    ) -> FloatArray:
        """Draw y once for each eta."""
        return random_state.poisson(np.minimum(self.inverse(eta), np.exp(MAX_ETA))).astype(float)

    def information(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the mean."""
        return self.inverse(eta) + 1e-12

    def overdispersed(self, scatter: FloatArray) -> Likelihood:
        """Return the negative binomial likelihood with this second parameter."""
        return GivenScale(NegativeBinomial(), scatter)

    def derivatives(
        self, y: FloatArray, eta: FloatArray, sigma: FloatArray, width: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Return y - mean, and the mean."""
        mean = self.inverse(eta)
        return y - mean, mean + 1e-12


@dataclass(frozen=True)
class NegativeBinomial(_Counts):
    """Counts with mean mu and precision phi: variance mu + mu^2 / phi.

    ``sigma`` is 1 / sqrt(phi), the relative scatter beyond a Poisson distribution's; phi is
    ``sigma ** -2``.

    Examples
    --------
    >>> import numpy as np
    >>> eta, sigma = np.log([[20.0]]), np.array([[5.0**-0.5]])
    >>> NegativeBinomial().variance(eta, sigma).round(6)
    array([[100.]])
    """

    name = "negative binomial"

    def log_density(self, y: FloatArray, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the log probability of each y."""
        precision = np.maximum(sigma, SMALLEST_COUNT) ** -2.0
        ratio = self.inverse(eta) / precision
        return (
            special.gammaln(y + precision)
            - special.gammaln(precision)
            - special.gammaln(y + 1)
            - (precision + y) * np.log1p(ratio)
            + y * (np.minimum(eta, MAX_ETA) - np.log(precision))
        )

    def log_below(self, y: FloatArray, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the log probability of y or less: an incomplete beta function."""
        precision, mean = np.maximum(sigma, SMALLEST_COUNT) ** -2.0, self.inverse(eta)
        found = special.betainc(precision, np.floor(y) + 1, precision / (precision + mean))
        return _log_tail(found, self, y, eta, sigma)

    def log_above(self, y: FloatArray, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the log probability of y or more."""
        precision, mean = np.maximum(sigma, SMALLEST_COUNT) ** -2.0, self.inverse(eta)
        y = np.ceil(y)
        found = special.betainc(np.maximum(y, 1), precision, mean / (precision + mean))
        return _log_tail(np.where(y > 0, found, 1.0), self, y, eta, sigma)

    def variance(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return mu + sigma^2 mu^2."""
        mean = self.inverse(eta)
        return mean + np.square(sigma * mean)

    def sample(
        self, eta: FloatArray, sigma: FloatArray, random_state: np.random.RandomState
    ) -> FloatArray:
        """Draw y once for each eta: a Poisson count whose mean is gamma distributed."""
        precision = np.broadcast_to(np.maximum(sigma, SMALLEST_COUNT) ** -2.0, np.shape(eta))
        factor = random_state.standard_gamma(precision) / precision
        mean = np.minimum(self.inverse(eta) * factor, np.exp(MAX_ETA))
        return random_state.poisson(mean).astype(float)

    def noise_prior(self, scale: float) -> Prior:
        """Return a half-normal prior with scale one: a relative scatter of up to 200 %."""
        return stats.halfnorm(scale=1.0)

    def information(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return mu / (1 + sigma^2 mu)."""
        mean = self.inverse(eta)
        return mean / (1 + np.square(sigma) * mean) + 1e-12

    def derivatives(
        self, y: FloatArray, eta: FloatArray, sigma: FloatArray, width: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Return score and curvature in eta."""
        precision = np.maximum(sigma, SMALLEST_COUNT) ** -2.0
        mean = self.inverse(eta)
        share = precision / (precision + mean)
        return (y - mean) * share, mean * share * (precision + y) / (precision + mean) + 1e-12


def _log_tail(
    probability: FloatArray,
    likelihood: Likelihood,
    y: FloatArray,
    eta: FloatArray,
    sigma: FloatArray,
) -> FloatArray:
    """Return the log of a tail's probability; that of y itself is most of one that underflows."""
    with np.errstate(divide="ignore"):
        found = np.log(probability)
    low = ~(probability > 1e-290)
    if not low.any():
        return found
    return np.where(low, likelihood.log_density(np.round(y), eta, sigma), found)


register("poisson", Poisson())
register("negative-binomial", NegativeBinomial())
