"""What an estimator asks of a likelihood."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from hybridsurrogate.priors import FloatArray, Prior

# samples of a row from which its Fisher information is averaged where no formula is given
_SAMPLES = 400


class Likelihood(ABC):
    """How a measured value scatters around what the surrogate says.

    ``eta``, the surrogate's output, and ``sigma``, the second parameter, broadcast against each
    other; by convention draws come first and rows last, so ``eta`` has shape (n_draws, n) and
    ``sigma`` (n_draws, 1).

    Attributes
    ----------
    name : str
        The word for it in messages.
    log_scale : bool
        Whether eta is the logarithm of the output.
    has_scale : bool
        Whether there is a second parameter.
    scales_noise : bool
        Whether the second parameter is the scale of the noise on that of eta, which is never less
        than what rounding leaves.
    rough : bool
        Whether the density may have kinks in eta, so that derivatives at a point mislead.
    gaussian : bool
        Whether ``working(y)`` is normal around eta with standard deviation sigma, so that whatever
        is linear in eta can be integrated out in closed form.

    Examples
    --------
    >>> from hybridsurrogate.likelihoods import Poisson
    >>> isinstance(Poisson(), Likelihood), Poisson().log_scale, Poisson().has_scale
    (True, True, False)
    """

    name = "likelihood"
    log_scale = False
    has_scale = True
    scales_noise = False
    rough = False
    gaussian = False

    @abstractmethod
    def check(self, y: FloatArray, source: str = "measured") -> None:
        """Raise ValueError when y cannot come from this likelihood; name its source."""

    def check_training(self, y: FloatArray, source: str = "measured") -> None:
        """Raise ValueError when nothing can be fitted to y; scores need `check` alone."""
        self.check(y, source)

    @abstractmethod
    def working(self, y: FloatArray) -> FloatArray:
        """Return y on the scale of eta, nudged off the ends where that is not finite.

        Scales, defaults and starting points come from it.
        """

    @abstractmethod
    def link(self, output: FloatArray) -> FloatArray:
        """Return the eta of a noise-free output."""

    @abstractmethod
    def inverse(self, eta: FloatArray) -> FloatArray:
        """Return the noise-free output of eta."""

    @abstractmethod
    def log_density(self, y: FloatArray, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the log density (or log probability) of each y."""

    @abstractmethod
    def mean(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the mean of y."""

    @abstractmethod
    def variance(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the variance of y."""

    @abstractmethod
    def sample(
        self, eta: FloatArray, sigma: FloatArray, random_state: np.random.RandomState
    ) -> FloatArray:
        """Draw y once for each eta."""

    @abstractmethod
    def noise_prior(self, scale: float) -> Prior:
        """Return the default prior of sigma for outputs with this spread on the scale of eta."""

    def information(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the Fisher information of each row about its eta, in the shape of eta.

        By default the mean square of the score over samples of y.
        """
        random_state = np.random.RandomState(0)
        total = np.zeros(np.shape(eta))
        for _ in range(_SAMPLES):
            score, _ = self.derivatives(self.sample(eta, sigma, random_state), eta, sigma)
            total += np.nan_to_num(np.square(score), posinf=0.0)
        return np.maximum(total / _SAMPLES, np.finfo(float).tiny)

    def working_rows(
        self, y: FloatArray, eta: FloatArray, sigma: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return rows z that are normal around eta to first order, and their noise.

        Fisher scoring (McCullagh and Nelder 1989, Generalized Linear Models, section 2.5):
        ``z = eta + score / information`` with variance ``1 / information``, for which only the
        score depends on y.
        """
        information = self.information(eta, sigma)
        score, _ = self.derivatives(y, eta, sigma)
        return eta + score / information, information**-0.5

    def take(self, index: FloatArray) -> Likelihood:
        """Return the likelihood of some of the draws, where it has something of each."""
        return self

    def smoothed(
        self, y: FloatArray, eta: FloatArray, sigma: FloatArray, width: FloatArray | None = None
    ) -> FloatArray:
        """Return a stand-in for the log density that an optimiser can climb.

        Where the density is `rough`: its mean over eta ~ N(eta, width^2), width like eta or None
        for a guess.
        """
        return self.log_density(y, eta, sigma)

    @abstractmethod
    def derivatives(
        self, y: FloatArray, eta: FloatArray, sigma: FloatArray, width: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Return d smoothed / d eta and a positive curvature, -d^2 / d eta^2 where that is.

        Curvature only shapes proposals, so where the density is not log-concave a positive stand-in
        does.
        """
