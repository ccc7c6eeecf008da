"""Heavy tails: single measurements may be far off without moving the rest, or be outliers."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import special

from hybridsurrogate.arguments import as_real
from hybridsurrogate.likelihoods.base import MAX_Z, Likelihood, positive, register, smoothed_moments
from hybridsurrogate.likelihoods.normal import TransformedNormal
from hybridsurrogate.types import FloatArray, Prior


class HeavyTailed(Likelihood):
    """Noise that is normal but for a factor on its variance that differs from row to row."""

    scales_noise = True
    # several outliers make single curvatures negative: averages over what is open of eta are not
    rough = True

    @abstractmethod
    def precision(self, residual: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the expected precision of each row, given its residual on the scale of eta."""

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
        """Return slope and curvature; without a width the row's expected precision.

        With that curvature a Newton step is one of the EM algorithm and always climbs.
        """
        if width is not None:
            _, gradient, curvature = smoothed_moments(self.log_density, y, eta, sigma, width)
            return gradient, positive(curvature, gradient)
        residual = np.asarray(self.working(y) - eta)
        weight = self.precision(residual, sigma)
        return weight * residual, weight


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


def of_plain(word: str) -> Any:
    """Return a property that is that of the plain likelihood."""
    return property(lambda self: getattr(self.plain, word), doc="As the plain likelihood.")


class OfPlain(Likelihood):
    """A likelihood around a plain one, on the same scale of eta.

    Attributes
    ----------
    plain : Likelihood
    """

    plain: Likelihood
    name, log_scale, rough = (of_plain(word) for word in ("name", "log_scale", "rough"))

    def check(self, y: FloatArray, source: str = "measured") -> None:
        """Accept what the plain likelihood accepts."""
        self.plain.check(y, source)

    def working(self, y: FloatArray) -> FloatArray:
        """Return y on the scale of eta."""
        return self.plain.working(y)

    def rounding(self, eta: FloatArray) -> FloatArray:
        """Return the standard deviation of eta where means are rounded."""
        return self.plain.rounding(eta)

    def link(self, output: FloatArray) -> FloatArray:
        """Return the eta of an output."""
        return self.plain.link(output)

    def inverse(self, eta: FloatArray) -> FloatArray:
        """Return the output of eta."""
        return self.plain.inverse(eta)

    def mean(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the mean of a plain value."""
        return self.plain.mean(eta, sigma)

    def noise_prior(self, scale: float) -> Prior:
        """Return that of the plain likelihood."""
        return self.plain.noise_prior(scale)


@dataclass(frozen=True)
class GivenScale(OfPlain):
    """A likelihood whose second parameter a cause sets, so that ``sigma`` has no meaning.

    Attributes
    ----------
    plain : Likelihood
    scale : ndarray of shape (J, 1)
        Its second parameter for each draw.

    Examples
    --------
    >>> import numpy as np
    >>> from hybridsurrogate.likelihoods import NegativeBinomial
    >>> wide = GivenScale(NegativeBinomial(), np.array([[0.0], [5.0**-0.5]]))
    >>> wide.variance(np.log([[20.0]]), None).round().tolist()
    [[20.0], [100.0]]
    """

    plain: Likelihood
    scale: FloatArray
    has_scale = False

    def take(self, index: FloatArray) -> Likelihood:
        """Return the likelihood of some of the draws."""
        return replace(self, scale=self.scale[index])

    def log_density(self, y: FloatArray, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the log density of each y."""
        return self.plain.log_density(y, eta, self.scale)

    def mean(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the mean of y."""
        return self.plain.mean(eta, self.scale)

    def variance(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the variance of y."""
        return self.plain.variance(eta, self.scale)

    def sample(
        self, eta: FloatArray, sigma: FloatArray, random_state: np.random.RandomState
    ) -> FloatArray:
        """Draw y once for each eta."""
        return self.plain.sample(eta, self.scale, random_state)

    def information(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the Fisher information of each row about its eta."""
        return self.plain.information(eta, self.scale)

    def derivatives(
        self, y: FloatArray, eta: FloatArray, sigma: FloatArray, width: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Return slope and curvature of the log density in eta."""
        return self.plain.derivatives(y, eta, self.scale, width)

    def log_below(self, y: FloatArray, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the log probability of y or less."""
        return self.plain.log_below(y, eta, self.scale)

    def log_above(self, y: FloatArray, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the log probability of y or more."""
        return self.plain.log_above(y, eta, self.scale)


# standard deviations of outliers in those of the rest, log-uniform between
NARROWEST, WIDEST = 3.0, 30.0
_LOG_RANGE = float(np.log(WIDEST / NARROWEST))
_ROOT = np.sqrt(2 * np.pi)
# mean square of the scale of an outlier
_OUTLIER_VARIANCE = (WIDEST**2 - NARROWEST**2) / (2 * _LOG_RANGE)
# nearer to the middle the density is flat, and its formula 0 / 0
_FLAT_BELOW = 1e-2
# scales of an outlier and their weights: of 24 the logarithm of its distribution function is right
# to 1e-10 within 100 standard deviations
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)
_SCALES, _WEIGHTS = NARROWEST * np.exp(_LOG_RANGE * (_NODES + 1) / 2), _WEIGHTS / 2
# so far off only the logarithm of the density is a number
_BEYOND = MAX_Z * WIDEST


def log_shape(z: FloatArray, share: FloatArray | float) -> FloatArray:
    """Return the log density of a standardised residual, with so many outliers.

    ``(1 - share) phi(z) + share (Phi(z / 3) - Phi(z / 30)) / (z log 10)``, the second part being
    the integral of normal densities over the logarithm of their scale.
    """
    size = np.maximum(np.abs(z), _FLAT_BELOW)
    near = (1 - share) * np.exp(-0.5 * size**2) / _ROOT
    far = special.ndtr(-size / WIDEST) - special.ndtr(-size / NARROWEST)
    with np.errstate(divide="ignore"):
        out = np.log(near + share * far / (size * _LOG_RANGE))
    beyond = size > _BEYOND
    if beyond.any():
        with np.errstate(divide="ignore"):
            far = special.log_ndtr(-size / WIDEST) + np.log(share / (size * _LOG_RANGE))
        out = np.where(beyond, far, out)
    return out


def precision_at(z: FloatArray, share: FloatArray | float) -> FloatArray:
    """Return the mean precision of a measurement given its standardised residual.

    One for those that surely are no outliers; the weights of the EM algorithm, and the slope of
    minus `log_shape` over z.
    """
    size = np.maximum(np.abs(z), _FLAT_BELOW)
    near = (1 - share) * np.exp(-0.5 * size**2) / _ROOT
    inner, outer = size / NARROWEST, size / WIDEST
    far = (special.ndtr(-outer) - special.ndtr(-inner)) / size
    drop = np.exp(-0.5 * inner**2) / NARROWEST - np.exp(-0.5 * outer**2) / WIDEST
    steep = (far - drop / _ROOT) / size**2
    factor = share / _LOG_RANGE
    with np.errstate(invalid="ignore", divide="ignore"):
        out = (near + factor * steep) / (near + factor * far)
    return np.where(np.isfinite(out), np.clip(out, WIDEST**-2.0, 1.0), WIDEST**-2.0)


@dataclass(frozen=True)
class Contaminated(HeavyTailed, OfPlain):
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

    def take(self, index: FloatArray) -> Likelihood:
        """Return the likelihood of some of the draws."""
        return replace(self, share=self.share[index])

    def log_density(self, y: FloatArray, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the log density of each y."""
        z = (self.plain.link(y) - eta) / sigma
        return log_shape(z, self.share) - np.log(sigma) + self.plain.log_jacobian(y)

    def log_below(self, y: FloatArray, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the log probability of y or less."""
        return self._log_tail(self.plain.log_below, y, eta, sigma)

    def log_above(self, y: FloatArray, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the log probability of y or more."""
        return self._log_tail(self.plain.log_above, y, eta, sigma)

    def _log_tail(
        self,
        tail: Callable[[FloatArray, FloatArray, FloatArray], FloatArray],
        y: FloatArray,
        eta: FloatArray,
        sigma: FloatArray,
    ) -> FloatArray:
        """Return the log of the mixture of tails, that of outliers over their scale."""
        out = np.log1p(-self.share) + tail(y, eta, sigma)
        for scale, weight in zip(_SCALES, _WEIGHTS, strict=True):
            out = np.logaddexp(out, np.log(self.share * weight) + tail(y, eta, sigma * scale))
        return out

    def variance(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the variance, outliers included."""
        factor = 1 + self.share * (_OUTLIER_VARIANCE - 1)
        return self.plain.variance(eta, sigma * np.sqrt(factor))

    def sample(
        self, eta: FloatArray, sigma: FloatArray, random_state: np.random.RandomState
    ) -> FloatArray:
        """Draw y once for each eta."""
        shape = np.shape(eta)
        scale = NARROWEST * np.exp(_LOG_RANGE * random_state.uniform(size=shape))
        scale = np.where(random_state.uniform(size=shape) < self.share, scale, 1.0)
        return self.plain.sample(eta, sigma * scale, random_state)

    def precision(self, residual: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the expected precision of each row, given its residual on the scale of eta."""
        return precision_at(residual / sigma, self.share) / np.square(sigma)
