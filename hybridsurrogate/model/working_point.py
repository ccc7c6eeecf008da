"""Where the likelihood of measured rows is expanded, so that they are normal to first order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hybridsurrogate.likelihoods import Likelihood
from hybridsurrogate.types import FloatArray


@dataclass(frozen=True)
class WorkingPoint:
    """Where the likelihood of measured rows is expanded.

    Attributes
    ----------
    likelihood : Likelihood
    eta : ndarray of shape (n,)
        Output without a cause, on the scale of eta.
    sigma : float
        The likelihood's second parameter there.
    draws : ndarray of shape (S,)
        Draws of that parameter, for replicates.
    factor : ndarray of shape (n,) or float, default=1.0
        On that parameter in each row.
    """

    likelihood: Likelihood
    eta: FloatArray
    sigma: float
    draws: FloatArray
    factor: FloatArray | float = 1.0

    def response(self, y: FloatArray) -> FloatArray:
        """Return the working response of measured values (..., n)."""
        eta = np.broadcast_to(self.eta, np.shape(y))
        return self.likelihood.working_rows(y, eta, np.array(self.sigma * self.factor))[0]

    def replicates(self, eta: FloatArray, random_state: np.random.RandomState) -> FloatArray:
        """Draw working responses of new data at outputs eta (R, n)."""
        sigma = random_state.choice(self.draws, size=len(eta))[:, None] * self.factor
        return self.response(self.likelihood.sample(eta, sigma, random_state))

    def noise(self) -> FloatArray:
        """Return the noise of each row, (n,); in units of sigma there where that is its scale."""
        sigma = np.array(self.sigma * self.factor)
        _, noise = self.likelihood.working_rows(self.eta, self.eta, sigma)
        return noise / sigma if self.likelihood.scales_noise else noise
