"""Normal noise with a share of outliers that differs from draw to draw."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from hybridsurrogate.likelihoods.base import Likelihood
from hybridsurrogate.likelihoods.heavy_tailed import HeavyTailed
from hybridsurrogate.likelihoods.normal import TransformedNormal
from hybridsurrogate.types import FloatArray, Prior

# standard deviations of outliers in those of the rest, log-uniform between
SMALLEST, LARGEST = 3.0, 30.0
_LOG_RANGE = float(np.log(LARGEST / SMALLEST))
_ROOT = np.sqrt(2 * np.pi)
# mean square of the scale of an outlier
OUTLIER_VARIANCE = (LARGEST**2 - SMALLEST**2) / (2 * _LOG_RANGE)
# nearer to the middle the density is flat, and its formula 0 / 0
_FLAT = 1e-2
# so far off only the logarithm of the density is a number
_BEYOND = 900.0


def log_shape(z: FloatArray, share: FloatArray | float) -> FloatArray:
    """Return the log density of a standardised residual, with so many outliers.

    ``(1 - share) phi(z) + share (Phi(z / 3) - Phi(z / 30)) / (z log 10)``, the second part being
    the integral of normal densities over the logarithm of their scale.
    """
    size = np.maximum(np.abs(z), _FLAT)
    near = (1 - share) * np.exp(-0.5 * size**2) / _ROOT
    far = special.ndtr(-size / LARGEST) - special.ndtr(-size / SMALLEST)
    with np.errstate(divide="ignore"):
        out = np.log(near + share * far / (size * _LOG_RANGE))
    beyond = size > _BEYOND
    if beyond.any():
        with np.errstate(divide="ignore"):
            far = special.log_ndtr(-size / LARGEST) + np.log(share / (size * _LOG_RANGE))
        out = np.where(beyond, far, out)
    return out


def precision_at(z: FloatArray, share: FloatArray | float) -> FloatArray:
    """Return the mean precision of a measurement given its standardised residual.

    One for those that surely are no outliers; the weights of the EM algorithm, and the slope of
    minus `log_shape` over z.
    """
    size = np.maximum(np.abs(z), _FLAT)
    near = (1 - share) * np.exp(-0.5 * size**2) / _ROOT
    inner, outer = size / SMALLEST, size / LARGEST
    far = (special.ndtr(-outer) - special.ndtr(-inner)) / size
    drop = np.exp(-0.5 * inner**2) / SMALLEST - np.exp(-0.5 * outer**2) / LARGEST
    steep = (far - drop / _ROOT) / size**2
    factor = share / _LOG_RANGE
    with np.errstate(invalid="ignore", divide="ignore"):
        out = (near + factor * steep) / (near + factor * far)
    return np.where(np.isfinite(out), np.clip(out, LARGEST**-2.0, 1.0), LARGEST**-2.0)


@dataclass(frozen=True)
class Contaminated(HeavyTailed):
    """A normal (or log-normal) likelihood of which a share of rows are outliers.

    Attributes
    ----------
    plain : TransformedNormal
        Of rows that are none; ``sigma`` is theirs.
    share : ndarray of shape (J, 1)
        For each draw.

    Examples
    --------
    >>> import numpy as np
    >>> from hybridsurrogate.likelihoods import Normal
    >>> some = Contaminated(Normal(), np.array([[0.1]]))
    >>> some.log_density(np.array([8.0]), np.zeros((1, 1)), np.ones((1, 1))).round(2).tolist()
    [[-6.16]]
    """

    plain: TransformedNormal
    share: FloatArray
    name = "normal with outliers"

    @property
    def log_scale(self) -> bool:  # type: ignore[override]
        """Whether eta is the logarithm of the output."""
        return self.plain.log_scale

    def take(self, index: FloatArray) -> Likelihood:
        """Return the likelihood of some of the draws."""
        return replace(self, share=self.share[index])

    def check(self, y: FloatArray, source: str = "measured") -> None:
        """Accept what the plain likelihood accepts."""
        self.plain.check(y, source)

    def working(self, y: FloatArray) -> FloatArray:
        """Return y on the scale of eta."""
        return self.plain.working(y)

    def link(self, output: FloatArray) -> FloatArray:
        """Return the eta of an output."""
        return self.plain.link(output)

    def inverse(self, eta: FloatArray) -> FloatArray:
        """Return the output of eta."""
        return self.plain.inverse(eta)

    def log_density(self, y: FloatArray, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the log density of each y."""
        z = (self.plain.link(y) - eta) / sigma
        return log_shape(z, self.share) - np.log(sigma) + self.plain.log_jacobian(y)

    def mean(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the mean of a measurement that is no outlier: on the scale of y that of all."""
        return self.plain.mean(eta, sigma)

    def variance(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the variance, outliers included."""
        factor = 1 + self.share * (OUTLIER_VARIANCE - 1)
        return self.plain.variance(eta, sigma * np.sqrt(factor))

    def sample(
        self, eta: FloatArray, sigma: FloatArray, random_state: np.random.RandomState
    ) -> FloatArray:
        """Draw y once for each eta."""
        shape = np.shape(eta)
        scale = SMALLEST * np.exp(_LOG_RANGE * random_state.uniform(size=shape))
        scale = np.where(random_state.uniform(size=shape) < self.share, scale, 1.0)
        return self.plain.sample(eta, sigma * scale, random_state)

    def noise_prior(self, scale: float) -> Prior:
        """Return that of the plain likelihood."""
        return self.plain.noise_prior(scale)

    def precision(self, residual: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the expected precision of each row, given its residual on the scale of eta."""
        return precision_at(residual / sigma, self.share) / np.square(sigma)
