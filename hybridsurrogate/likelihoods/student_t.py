"""Heavy tails: single measurements may be far off without moving the rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special

from hybridsurrogate.arguments.scalars import as_real
from hybridsurrogate.likelihoods.base import register
from hybridsurrogate.likelihoods.heavy_tailed import HeavyTailed
from hybridsurrogate.types import FloatArray


@dataclass(frozen=True)
class StudentT(HeavyTailed):
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

    def check(self, y: FloatArray, source: str = "measured") -> None:
        """Accept every finite y; raise ValueError for degrees of freedom without use."""
        as_real(self.df, "df", finite=False)
        if not 0 < self.df < np.inf:
            raise ValueError(
                f"StudentT needs a df that is positive and finite, got {self.df!r}; without end it "
                "is likelihood='normal'."
            )
        # P(|z| > r) falls as r^-df: where it has come to the rounding error, r^2 is a number or not
        double = np.finfo(float)
        if self.df < -2 * np.log(double.eps) / np.log(double.max):
            raise ValueError(
                f"StudentT({self.df!r}) has tails so heavy that squares of its draws overflow. "
                "Most data have a df of 2 to 30."
            )

    def log_density(self, y: FloatArray, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the log density of each y."""
        z = (y - eta) / sigma
        constant = special.gammaln((self.df + 1) / 2) - special.gammaln(self.df / 2)
        constant -= 0.5 * np.log(self.df * np.pi)
        return constant - np.log(sigma) - (self.df + 1) / 2 * np.log1p(z**2 / self.df)

    def log_below(self, y: FloatArray, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the log probability of y or less."""
        return np.log(special.stdtr(self.df, (y - eta) / sigma))

    def log_above(self, y: FloatArray, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the log probability of y or more."""
        return np.log(special.stdtr(self.df, (eta - y) / sigma))

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

    def information(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return (df + 1) / (df + 3) / sigma^2 (Lange, Little and Taylor 1989, JASA 84:881)."""
        share = (self.df + 1) / (self.df + 3)
        return np.broadcast_to(share * np.asarray(sigma) ** -2.0, np.shape(eta))

    def precision(self, residual: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the expected precision of each row in the scale mixture of normals."""
        return (self.df + 1) / (self.df + np.square(residual / sigma)) / np.square(sigma)


register("student-t", StudentT())
