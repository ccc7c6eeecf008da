"""Heavy tails: single measurements may be far off without moving the rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special, stats

from hybridsurrogate.likelihoods.base import Likelihood
from hybridsurrogate.likelihoods.smoothing import positive, smoothed_moments
from hybridsurrogate.priors import FloatArray, Prior


@dataclass(frozen=True)
class StudentT(Likelihood):
    """Student-t noise with scale ``sigma`` in the units of y.

    Attributes
    ----------
    df : float
        Degrees of freedom; fewer mean heavier tails. At 2 and below the variance is infinite.

    Examples
    --------
    >>> import numpy as np
    >>> density = StudentT(df=4).log_density(np.array([8.0]), np.zeros((1, 1)), np.ones((1, 1)))
    >>> round(density.item(), 2)
    -8.06
    """

    df: float = 4.0
    name = "Student-t"
    # several outliers make single curvatures negative: averages over what is open of eta are not
    rough = True

    def check(self, y: FloatArray, source: str = "measured") -> None:
        """Accept every finite y; raise ValueError for degrees of freedom that are not positive."""
        if not self.df > 0:
            raise ValueError(f"StudentT needs df > 0, got {self.df!r}.")

    def working(self, y: FloatArray) -> FloatArray:
        """Return y."""
        return np.asarray(y, dtype=float)

    def link(self, output: FloatArray) -> FloatArray:
        """Return the output."""
        return np.asarray(output, dtype=float)

    def inverse(self, eta: FloatArray) -> FloatArray:
        """Return eta."""
        return eta

    def log_density(self, y: FloatArray, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the log density of each y."""
        z = (y - eta) / sigma
        constant = special.gammaln((self.df + 1) / 2) - special.gammaln(self.df / 2)
        constant -= 0.5 * np.log(self.df * np.pi)
        return constant - np.log(sigma) - (self.df + 1) / 2 * np.log1p(z**2 / self.df)

    def mean(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return eta, the median, which is the mean where there is one."""
        return eta

    def variance(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return sigma^2 df / (df - 2), infinite for df <= 2."""
        ratio = self.df / (self.df - 2) if self.df > 2 else np.inf
        shape = np.broadcast_shapes(np.shape(eta), np.shape(sigma))
        return np.broadcast_to(np.square(sigma) * ratio, shape)

    def sample(
        self, eta: FloatArray, sigma: FloatArray, random_state: np.random.RandomState
    ) -> FloatArray:
        """Draw y once for each eta."""
        return eta + sigma * random_state.standard_t(self.df, size=np.shape(eta))

    def noise_prior(self, scale: float) -> Prior:
        """Return a half-normal prior with the spread of the output as scale."""
        return stats.halfnorm(scale=scale)

    def smoothed(
        self, y: FloatArray, eta: FloatArray, sigma: FloatArray, width: FloatArray | None = None
    ) -> FloatArray:
        """Return the log density averaged over eta ~ N(eta, width^2)."""
        if width is None:
            return self.log_density(y, eta, sigma)
        return smoothed_moments(self.log_density, y, eta, sigma, width)[0]

    def derivatives(
        self, y: FloatArray, eta: FloatArray, sigma: FloatArray, width: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Return slope and curvature; at first the row's weight in the scale mixture of normals.

        With that curvature a Newton step is one of the EM algorithm and always climbs.
        """
        if width is not None:
            _, gradient, curvature = smoothed_moments(self.log_density, y, eta, sigma, width)
            return gradient, positive(curvature, gradient)
        z = (y - eta) / sigma
        weight = (self.df + 1) / (self.df + z**2) / np.square(sigma)
        return weight * (y - eta), weight
