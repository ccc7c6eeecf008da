"""A likelihood whose second parameter is given for each draw."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hybridsurrogate.likelihoods.base import Likelihood
from hybridsurrogate.types import FloatArray


class OfPlain(Likelihood):
    """A likelihood around a plain one, on the same scale of eta.

    Attributes
    ----------
    plain : Likelihood
    """

    plain: Likelihood

    @property
    def name(self) -> str:  # type: ignore[override]
        """That of the plain likelihood."""
        return self.plain.name

    @property
    def log_scale(self) -> bool:  # type: ignore[override]
        """As the plain likelihood."""
        return self.plain.log_scale

    @property
    def rough(self) -> bool:  # type: ignore[override]
        """As the plain likelihood."""
        return self.plain.rough

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
