"""Successes among a number of trials, with the log odds of a success as eta."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special

from hybridsurrogate.arguments.scalars import as_real
from hybridsurrogate.likelihoods.base import Likelihood, register
from hybridsurrogate.types import FloatArray

# log odds beyond which a success is certain to all digits
_MAX_ETA = 36.0
# fewer expected successes, or failures, are none with so much probability
_LEAST_MEAN = 1e-4


@dataclass(frozen=True)
class Binomial(Likelihood):
    """Number of successes in ``trials`` trials; eta is the logarithm of their odds.

    The simulation gives the expected number of successes, between 0 and ``trials``. Where rows
    have trials of different numbers, give each row twice, y = 1 and y = 0 with ``trials=1``, and
    the numbers of successes and failures as ``sample_weight``.

    Attributes
    ----------
    trials : int

    Examples
    --------
    >>> eta = np.zeros((1, 1))
    >>> Binomial(trials=20).mean(eta, None), Binomial(trials=20).variance(eta, None)
    (array([[10.]]), array([[5.]]))
    """

    trials: int = 1
    name = "binomial"
    has_scale = False
    means_as_runs = True
    remedy_of_scatter = (
        "use likelihood=BetaBinomial(trials=...), or look for what trials of one row share, such "
        "as a batch (experiment=...)"
    )

    def check(self, y: FloatArray, source: str = "measured") -> None:
        """Raise ValueError unless all y are whole numbers from zero to ``trials``."""
        as_real(self.trials, "trials")
        if not (self.trials >= 1 and self.trials == np.round(self.trials)):
            raise ValueError(
                f"{type(self).__name__} needs a number of trials of 1, 2, ..., got {self.trials!r}."
            )
        whole = y == np.round(y) if source != "simulated" else np.full(np.shape(y), True)
        bad = np.flatnonzero(~((y >= 0) & (y <= self.trials) & whole))
        if bad.size:
            raise ValueError(
                f"The {self.name} likelihood needs successes 0 to {self.trials}, but {bad.size} of "
                f"{y.size} {source} values are not (first at row {bad[0]}: {y[bad[0]]:g}). Set "
                f"{type(self).__name__}(trials=...), and give numbers of successes, not shares."
            )

    def working(self, y: FloatArray) -> FloatArray:
        """Return the log odds of (y + 1/2) / (trials + 1)."""
        return special.logit((np.asarray(y, dtype=float) + 0.5) / (self.trials + 1))

    def working_runs(self, y: FloatArray) -> FloatArray:
        """Return the log odds as `working` of whole numbers, and those of expected successes."""
        if np.all(y == np.round(y)):
            return self.working(y)
        return special.logit(np.clip(y, _LEAST_MEAN, self.trials - _LEAST_MEAN) / self.trials)

    def rounding(self, eta: FloatArray) -> FloatArray:
        """Return 1 / (sqrt(12) trials p (1 - p)): uniform errors of the mean, to first order."""
        slope = self.trials * special.expit(eta) * special.expit(-np.asarray(eta))
        return 1 / (np.sqrt(12) * np.maximum(slope, np.finfo(float).tiny))

    def link(self, output: FloatArray) -> FloatArray:
        """Return the log odds of an expected number of successes."""
        share = np.asarray(output, dtype=float) / self.trials
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.clip(special.logit(share), -_MAX_ETA, _MAX_ETA)

    def inverse(self, eta: FloatArray) -> FloatArray:
        """Return the expected number of successes."""
        return self.trials * special.expit(eta)

    def log_density(self, y: FloatArray, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the log probability of each y."""
        ways = (
            special.gammaln(self.trials + 1)
            - special.gammaln(y + 1)
            - special.gammaln(self.trials - y + 1)
        )
        return ways + y * special.log_expit(eta) + (self.trials - y) * special.log_expit(-eta)

    def mean(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the expected number of successes."""
        return self.inverse(eta)

    def variance(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return trials p (1 - p)."""
        return self.trials * special.expit(eta) * special.expit(-np.asarray(eta))

    def sample(
        self, eta: FloatArray, sigma: FloatArray, random_state: np.random.RandomState
    ) -> FloatArray:
        """Draw y once for each eta."""
        return random_state.binomial(self.trials, special.expit(eta)).astype(float)

    def information(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return trials p (1 - p), as the variance."""
        return self.variance(eta, sigma) + 1e-12

    def derivatives(
        self, y: FloatArray, eta: FloatArray, sigma: FloatArray, width: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Return y - mean, and the variance."""
        return y - self.inverse(eta), self.information(eta, sigma)


register("binomial", Binomial())
