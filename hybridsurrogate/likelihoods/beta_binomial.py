"""Successes that scatter more than independent trials do, with the log odds as eta."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special, stats

from hybridsurrogate.likelihoods.base import register
from hybridsurrogate.likelihoods.binomial import Binomial
from hybridsurrogate.likelihoods.smoothing import positive
from hybridsurrogate.types import FloatArray, Prior

# below this sigma a beta-binomial is a binomial distribution to all digits
_MIN_SIGMA = 1e-4
# log odds beyond which a shape of the beta distribution is no number
_MAX_ETA = 36.0
# numbers of successes over which an information is summed: all at both ends, where there may be
# peaks, and some between
_AT_ENDS, _BETWEEN = 16, 97


@dataclass(frozen=True)
class BetaBinomial(Binomial):
    """Number of successes in ``trials`` trials whose probability differs from row to row.

    That of a row is beta distributed with mean p and precision phi, so that the variance is
    ``trials p (1 - p) (1 + (trials - 1) / (phi + 1))``. ``sigma`` is 1 / sqrt(phi).

    Attributes
    ----------
    trials : int
        At least two: single trials do not scatter more.

    Examples
    --------
    >>> eta, sigma = np.zeros((1, 1)), np.full((1, 1), 18.0**-0.5)
    >>> BetaBinomial(trials=20).variance(eta, sigma).round(6)
    array([[10.]])
    """

    name = "beta-binomial"
    has_scale = True
    remedy_of_scatter = ""

    def check_training(self, y: FloatArray, source: str = "measured") -> None:
        """Raise ValueError where there is a single trial a row."""
        self.check(y, source)
        if self.trials == 1:
            raise ValueError(
                "The beta-binomial likelihood needs two or more trials a row, as a single one does "
                "not show their scatter: set BetaBinomial(trials=...), or use 'binomial'."
            )

    def log_density(self, y: FloatArray, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the log probability of each y."""
        n, (a, b) = self.trials, _shapes(eta, sigma)
        ways = -np.log(n + 1) - special.betaln(n - y + 1, y + 1)
        return ways + special.betaln(y + a, n - y + b) - special.betaln(a, b)

    def variance(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return trials p (1 - p) (1 + (trials - 1) sigma^2 / (1 + sigma^2))."""
        square = np.square(sigma)
        return super().variance(eta, sigma) * (1 + (self.trials - 1) * square / (1 + square))

    def sample(
        self, eta: FloatArray, sigma: FloatArray, random_state: np.random.RandomState
    ) -> FloatArray:
        """Draw y once for each eta."""
        a, b = _shapes(eta, sigma)
        return random_state.binomial(self.trials, random_state.beta(a, b)).astype(float)

    def noise_prior(self, scale: float) -> Prior:
        """Return a half-normal prior with scale one, as of a negative binomial."""
        return stats.halfnorm(scale=1.0)

    def information(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the mean square of the score, a sum over the possible y.

        Of many trials over some of them; never less than the bound by mean and variance.
        """
        mass, square = 0.0, 0.0
        for y, weight in zip(*self._nodes(), strict=True):
            density = weight * np.exp(self.log_density(y, eta, sigma))
            mass = mass + density
            square = square + density * np.square(self._score(y, eta, sigma)[0])
        least = Binomial.variance(self, eta, sigma) ** 2 / self.variance(eta, sigma)
        with np.errstate(invalid="ignore"):  # with few nodes all may have no mass
            return np.fmax(square / mass, least) + 1e-12

    def _nodes(self) -> tuple[FloatArray, FloatArray]:
        """Return numbers of successes, and how many each stands for."""
        n = int(self.trials)
        if n < 2 * _AT_ENDS + _BETWEEN:
            return np.arange(n + 1.0), np.ones(n + 1)
        between = np.round(np.linspace(_AT_ENDS, n - _AT_ENDS, _BETWEEN))
        y = np.concatenate([np.arange(_AT_ENDS), between, n - np.arange(_AT_ENDS)[::-1]])
        edges = np.concatenate([[-0.5], (y[1:] + y[:-1]) / 2, [n + 0.5]])
        return y, np.diff(edges)

    def derivatives(
        self, y: FloatArray, eta: FloatArray, sigma: FloatArray, width: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Return score and curvature in eta, or a stand-in where that is not positive."""
        score, slope = self._score(y, eta, sigma)
        return score, positive(-slope, score)

    def _score(
        self, y: FloatArray, eta: FloatArray, sigma: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the first and second derivative of the log density in eta."""
        a, b = _shapes(eta, sigma)
        # da / deta = a b / (a + b) = -db / deta
        rate, failures = a * b / (a + b), self.trials - y
        gap = special.digamma(y + a) - special.digamma(a)
        gap = gap - special.digamma(failures + b) + special.digamma(b)
        bend = special.polygamma(1, y + a) - special.polygamma(1, a)
        bend = bend + special.polygamma(1, failures + b) - special.polygamma(1, b)
        return rate * gap, rate * (b - a) / (a + b) * gap + rate**2 * bend


def _shapes(eta: FloatArray, sigma: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the shapes p phi and (1 - p) phi of the beta distribution."""
    precision = np.maximum(sigma, _MIN_SIGMA) ** -2.0
    eta = np.clip(eta, -_MAX_ETA, _MAX_ETA)
    return precision * special.expit(eta), precision * special.expit(-eta)


register("beta-binomial", BetaBinomial())
