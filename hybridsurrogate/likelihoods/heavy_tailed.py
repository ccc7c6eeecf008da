"""What likelihoods with heavy tails have in common."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from hybridsurrogate.likelihoods.base import Likelihood
from hybridsurrogate.likelihoods.smoothing import positive, smoothed_moments
from hybridsurrogate.types import FloatArray


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
