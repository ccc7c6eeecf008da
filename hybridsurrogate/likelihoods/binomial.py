"""Successes among a number of trials, independent or not, with the log odds of one as eta."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special, stats

from hybridsurrogate.arguments import as_real
from hybridsurrogate.likelihoods.base import MAX_ETA, SMALLEST_COUNT, Likelihood, positive, register
from hybridsurrogate.likelihoods.student_t import GivenScale
from hybridsurrogate.types import FloatArray, Prior

# numbers of successes over which an information is summed: all at both ends, where there may be
# peaks, and some between
_N_AT_ENDS, _N_BETWEEN = 16, 97


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
        return special.logit(np.clip(y, SMALLEST_COUNT, self.trials - SMALLEST_COUNT) / self.trials)

    def rounding(self, eta: FloatArray) -> FloatArray:
        """Return 1 / (sqrt(12) trials p (1 - p)): uniform errors of the mean, to first order."""
        slope = self.trials * special.expit(eta) * special.expit(-np.asarray(eta))
        return 1 / (np.sqrt(12) * np.maximum(slope, np.finfo(float).tiny))

    def link(self, output: FloatArray) -> FloatArray:
        """Return the log odds of an expected number of successes."""
        share = np.asarray(output, dtype=float) / self.trials
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.clip(special.logit(share), -MAX_ETA, MAX_ETA)

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

    def overdispersed(self, scatter: FloatArray) -> Likelihood | None:
        """Return the beta-binomial likelihood with this second parameter, None of single trials."""
        return GivenScale(BetaBinomial(self.trials), scatter) if self.trials > 1 else None


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
        if n < 2 * _N_AT_ENDS + _N_BETWEEN:
            return np.arange(n + 1.0), np.ones(n + 1)
        between = np.round(np.linspace(_N_AT_ENDS, n - _N_AT_ENDS, _N_BETWEEN))
        y = np.concatenate([np.arange(_N_AT_ENDS), between, n - np.arange(_N_AT_ENDS)[::-1]])
        edges = np.concatenate([[-0.5], (y[1:] + y[:-1]) / 2, [n + 0.5]])
        return y, np.diff(edges)

    def overdispersed(self, scatter: FloatArray) -> Likelihood | None:
        """Return None: it has a scale of its own."""
        return None

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
    precision = np.maximum(sigma, SMALLEST_COUNT) ** -2.0
    eta = np.clip(eta, -MAX_ETA, MAX_ETA)
    return precision * special.expit(eta), precision * special.expit(-eta)


register("binomial", Binomial())
register("beta-binomial", BetaBinomial())
