"""A likelihood of the user's own, from three functions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import stats

from hybridsurrogate.likelihoods.base import Likelihood
from hybridsurrogate.likelihoods.smoothing import positive, smoothed_moments
from hybridsurrogate.priors import FloatArray, Prior

_N_VARIANCE = 200
# width of the first smoothing of a density that may have kinks, in units of sigma
_KERNEL = 0.8


@dataclass(frozen=True)
class CustomLikelihood(Likelihood):
    """A likelihood of your own: log density, mean and sample.

    Parameters
    ----------
    log_density_function : callable
        ``log_density(y, eta, sigma)``: y of shape (n,), eta (n_draws, n), sigma (n_draws, 1);
        returns (n_draws, n). It need not be log-concave or have derivatives.
    mean_function : callable
        ``mean(eta, sigma) -> (n_draws, n)``.
    sample_function : callable
        ``sample(eta, sigma, random_state) -> (n_draws, n)``, random_state a numpy RandomState.
    log_scale : bool, default=False
        Whether eta is the logarithm of the output.
    has_scale : bool, default=True
        Whether sigma is used.

    Examples
    --------
    Laplace noise:

    >>> import numpy as np
    >>> laplace = CustomLikelihood(
    ...     lambda y, eta, sigma: -np.abs(y - eta) / sigma - np.log(2 * sigma),
    ...     lambda eta, sigma: eta,
    ...     lambda eta, sigma, random_state: random_state.laplace(eta, sigma))
    >>> laplace.log_density(np.array([1.0]), np.zeros((1, 1)), np.ones((1, 1))).round(3)
    array([[-1.693]])
    """

    log_density_function: Callable[[FloatArray, FloatArray, FloatArray], FloatArray]
    mean_function: Callable[[FloatArray, FloatArray], FloatArray]
    sample_function: Callable[[FloatArray, FloatArray, np.random.RandomState], FloatArray]
    log_scale: bool = False
    has_scale: bool = True

    name = "user's own"
    rough = True

    def check(self, y: FloatArray, source: str = "measured") -> None:
        """Raise ValueError where a logarithm is asked for and y has none."""
        if self.log_scale and not (y >= 0).all():
            raise ValueError(
                f"The likelihood has log_scale=True, but {np.sum(y < 0)} {source} values are "
                "negative: eta would be the logarithm of their mean."
            )

    def check_training(self, y: FloatArray, source: str = "measured") -> None:
        """Raise ValueError where y has no logarithm that is asked for, or no density is finite.

        The density is tried at the data themselves, with sigma = 1: a function that gives the wrong
        shape, NaN or minus infinity everywhere is told so before anything is fitted.
        """
        self.check(y, source)
        eta = self.working(np.asarray(y, dtype=float))
        batch = np.stack([eta, np.full_like(eta, eta.mean())])
        density = self._shaped("log_density_function", batch, y, batch, np.ones((2, 1)))
        if not np.isfinite(density).any():
            raise ValueError(
                f"log_density_function of {self!r} is NaN or infinite for every {source} value at "
                "eta = y, sigma = 1. Check its support and the order of its arguments "
                "(y, eta, sigma)."
            )
        self._shaped("mean_function", batch, batch, np.ones((2, 1)))
        random_state = np.random.RandomState(0)
        self._shaped("sample_function", batch, batch, np.ones((2, 1)), random_state)

    def _shaped(self, function: str, eta: FloatArray, *arguments: object) -> FloatArray:
        values = np.asarray(getattr(self, function)(*arguments), dtype=float)
        if values.shape != eta.shape:
            raise ValueError(
                f"{function} of {self!r} must return the shape of eta, {eta.shape}, "
                f"got {values.shape}."
            )
        return values

    def working(self, y: FloatArray) -> FloatArray:
        """Return y, or its logarithm kept finite."""
        if not self.log_scale:
            return np.asarray(y, dtype=float)
        smallest = np.min(y[y > 0], initial=1.0)
        return np.log(np.maximum(y, 0.5 * smallest))

    def link(self, output: FloatArray) -> FloatArray:
        """Return the output, or its logarithm."""
        return np.log(output) if self.log_scale else np.asarray(output, dtype=float)

    def inverse(self, eta: FloatArray) -> FloatArray:
        """Return eta, or its exponential."""
        return np.exp(np.minimum(eta, 700.0)) if self.log_scale else eta

    def log_density(self, y: FloatArray, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the user's log density, minus infinity where it is NaN."""
        with np.errstate(all="ignore"):
            values = np.asarray(self.log_density_function(y, eta, sigma), dtype=float)
        return np.where(np.isnan(values), -np.inf, values)

    def smoothed(
        self, y: FloatArray, eta: FloatArray, sigma: FloatArray, width: FloatArray | None = None
    ) -> FloatArray:
        """Return the log density averaged over eta ~ N(eta, width^2)."""
        return self._moments(y, eta, sigma, width)[0]

    def derivatives(
        self, y: FloatArray, eta: FloatArray, sigma: FloatArray, width: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Return the slope and a positive curvature of the smoothed log density."""
        _, gradient, curvature = self._moments(y, eta, sigma, width)
        return gradient, positive(curvature, gradient)

    def _moments(
        self, y: FloatArray, eta: FloatArray, sigma: FloatArray, width: FloatArray | None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return value, slope and curvature of the smoothed log density."""
        eta = np.asarray(eta, dtype=float)
        narrow = 1e-3 * (1 + np.abs(eta))
        if width is None:
            width = _KERNEL * sigma if self.has_scale else narrow
        wide = smoothed_moments(self.log_density, y, eta, sigma, width)
        # near the end of a support some values of eta are impossible
        bad = ~np.isfinite(wide[0])
        if not bad.any():
            return wide
        sharp = smoothed_moments(self.log_density, y, eta, sigma, np.minimum(narrow, width))
        value, gradient, curvature = (np.where(bad, b, a) for a, b in zip(wide, sharp, strict=True))
        return value, gradient, curvature

    def mean(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the user's mean."""
        return np.asarray(self.mean_function(eta, sigma), dtype=float)

    def variance(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the variance of 200 samples of each row."""
        random_state = np.random.RandomState(0)
        total = np.zeros(np.shape(eta))
        mean = self.mean(eta, sigma)
        for _ in range(_N_VARIANCE):
            total += (self.sample(eta, sigma, random_state) - mean) ** 2
        return total / _N_VARIANCE

    def sample(
        self, eta: FloatArray, sigma: FloatArray, random_state: np.random.RandomState
    ) -> FloatArray:
        """Return the user's samples."""
        return np.asarray(self.sample_function(eta, sigma, random_state), dtype=float)

    def noise_prior(self, scale: float) -> Prior:
        """Return a half-normal prior: the spread of the output, or one on a log scale."""
        if not self.has_scale:
            return stats.lognorm(1.0)
        return stats.halfnorm(scale=1.0 if self.log_scale else scale)
