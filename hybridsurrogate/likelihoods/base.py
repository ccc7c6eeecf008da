"""What an estimator needs of a likelihood, and log densities averaged over a normal kernel.

A Gaussian approximation of a posterior is best where log density and derivatives are averaged over
the approximation itself (Opper and Archambeau 2009, Neural Computation 21:786).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from hybridsurrogate.registration import add
from hybridsurrogate.types import FloatArray, Prior

# an eta beyond which odds are those of certainty to all digits, and a mean of counts has no use
MAX_ETA = -float(np.log(np.finfo(float).eps))
# a scatter below this is none to all digits; an expected count below it is none, with so much
# probability
SMALLEST_COUNT = 1e-4
# standard deviations beyond which a normal density is none
MAX_Z = 30.0
_NODE, _WEIGHT = np.polynomial.hermite_e.hermegauss(9)
_WEIGHT = _WEIGHT / _WEIGHT.sum()


def smoothed_moments(
    log_density: Callable[[FloatArray, FloatArray, FloatArray], FloatArray],
    y: FloatArray,
    eta: FloatArray,
    sigma: FloatArray,
    width: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return value, slope and curvature of the smoothed log density, by Stein's identities.

    With e standard normal and h the width, the slope is ``E[e log p(eta + h e)] / h`` and the
    curvature ``-E[(e^2 - 1) log p(eta + h e)] / h^2``: no derivatives of the density are needed.

    Parameters
    ----------
    log_density : callable
        Of (y, eta, sigma).
    y : ndarray of shape (n,)
    eta : ndarray of shape (J, n)
    sigma : ndarray of shape (J, 1) or (J, n)
    width : ndarray that broadcasts to eta
    """
    middle = log_density(y, eta, sigma)
    value, gradient, curvature = (np.zeros(eta.shape) for _ in range(3))
    with np.errstate(invalid="ignore"):
        for node, weight in zip(_NODE, _WEIGHT, strict=True):
            # differences from the middle: narrow kernels would drown in rounding
            excess = log_density(y, eta + width * node, sigma) - middle
            value += weight * excess
            gradient += weight * node * excess
            curvature -= weight * (node**2 - 1) * excess
        return middle + value, gradient / width, curvature / width**2


def positive(curvature: FloatArray, gradient: FloatArray) -> FloatArray:
    """Return the curvature where it is positive, else a small stand-in that keeps steps short."""
    stand_in = 0.1 * gradient**2 + 1e-12
    with np.errstate(invalid="ignore"):
        return np.where(curvature > 1e-3 * stand_in, curvature, stand_in)


# samples of a row from which expectations are averaged where no formula is given
_N_SAMPLES = 400
# width of the first smoothing of a density that may have kinks, in units of sigma
_KERNEL_WIDTH = 0.8


class Likelihood(ABC):
    """How a measured value scatters around the surrogate's output.

    A subclass needs ``log_density`` to be fitted, and ``sample`` for all that draws of y are needed
    for: predictions, intervals, a diagnosis. Mean, variance and Fisher information are averages
    over samples where no formula is given.

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
        Whether the second parameter is the noise's standard deviation on the scale of eta, which is
        at least the rounding error.
    rough : bool
        Whether the density may have kinks in eta, so that derivatives at a point mislead.
    gaussian : bool
        Whether ``working(y)`` is normal around eta with standard deviation sigma, so that whatever
        is linear in eta can be integrated out in closed form.
    remedy_of_scatter : str
        What to do where values scatter more than the likelihood allows; empty where that is what
        its second parameter is for.
    means_as_runs : bool
        Whether y are whole numbers, and runs of a simulation may be their expected values.

    Examples
    --------
    >>> from hybridsurrogate.likelihoods import Poisson
    >>> isinstance(Poisson(), Likelihood), Poisson().log_scale, Poisson().has_scale
    (True, True, False)

    Laplace noise, whose variance is 2 sigma^2:

    >>> class Laplace(Likelihood):
    ...     rough = True
    ...     def log_density(self, y, eta, sigma):
    ...         return -np.abs(y - eta) / sigma - np.log(2 * sigma)
    ...     def sample(self, y, sigma, random_state):
    ...         return random_state.laplace(y, sigma)
    >>> many = Laplace().variance(np.zeros((1, 1000)), np.full((1, 1), 3.0))
    >>> round(float(many.mean()))
    18
    """

    name = "likelihood"
    log_scale = False
    has_scale = True
    scales_noise = False
    rough = False
    gaussian = False
    remedy_of_scatter = ""
    means_as_runs = False

    def check(self, y: FloatArray, source: str = "measured") -> None:
        """Raise ValueError when y cannot come from this likelihood; name its source.

        By default where y needs a logarithm and has none.
        """
        if self.log_scale and not (y >= 0).all():
            raise ValueError(
                f"The likelihood has log_scale=True, but {np.sum(y < 0)} {source} values are "
                "negative: eta would be the logarithm of their mean."
            )

    def check_training(self, y: FloatArray, source: str = "measured") -> None:
        """Raise ValueError when nothing can be fitted to y; scores need `check` alone."""
        self.check(y, source)

    def __eq__(self, other: object) -> bool:
        """Whether another one is of the same class and holds the same, as a copy does."""
        if type(self) is not type(other):
            return NotImplemented
        own, others = vars(self), vars(other)
        return own.keys() == others.keys() and all(np.array_equal(own[k], others[k]) for k in own)

    def __hash__(self) -> int:
        return hash(type(self))

    def working(self, y: FloatArray) -> FloatArray:
        """Return y on the scale of eta, nudged off the ends where that is not finite.

        Scales, defaults and starting points come from it. By default y, or its logarithm.
        """
        if not self.log_scale:
            return np.asarray(y, dtype=float)
        smallest = np.min(y[y > 0], initial=1.0)
        return np.log(np.maximum(y, 0.5 * smallest))

    def working_runs(self, y: FloatArray) -> FloatArray:
        """Return outputs of runs on the scale of eta: draws of y or, of counts, expected values."""
        return self.working(y)

    def rounding(self, eta: FloatArray) -> FloatArray:
        """Return the standard deviation of eta where means are rounded to whole numbers.

        Zero where `means_as_runs` is not set.
        """
        return np.zeros(np.shape(eta))

    def link(self, output: FloatArray) -> FloatArray:
        """Return the eta of a noise-free output; by default the output, or its logarithm."""
        return np.log(output) if self.log_scale else np.asarray(output, dtype=float)

    def inverse(self, eta: FloatArray) -> FloatArray:
        """Return the noise-free output of eta; by default eta, or its exponential."""
        return np.exp(np.minimum(eta, 700.0)) if self.log_scale else eta

    def scatter(self, errors: FloatArray, y: FloatArray) -> FloatArray:
        """Return known errors of measurements y, in their units, as standard deviations of eta.

        By default the errors themselves.
        """
        return errors

    @abstractmethod
    def log_density(self, y: FloatArray, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the log density (or log probability) of each y."""

    def side(self, y: FloatArray) -> NDArray[np.int_]:
        """Return -1 for values at a lower limit, 1 for those at an upper one, else 0."""
        return np.zeros(np.shape(y), dtype=int)

    def log_below(self, y: FloatArray, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the log probability of y or less, which rows beyond a limit need."""
        raise ValueError(
            f"The {self.name} likelihood has no distribution function, which Censored needs: "
            'choose "normal", "lognormal", "student-t", "poisson" or "negative-binomial".'
        )

    def log_above(self, y: FloatArray, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the log probability of y or more."""
        return self.log_below(y, eta, sigma)

    @property
    def of_runs(self) -> Likelihood:
        """The likelihood of runs that train a surrogate: by default itself."""
        return self

    def mean(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the mean of y."""
        return self._expected(lambda y, eta, sigma: y, eta, sigma)

    def variance(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the variance of y."""
        mean = np.broadcast_to(self.mean(eta, sigma), np.shape(eta))
        return self._expected(lambda y, eta, sigma, mean: np.square(y - mean), eta, sigma, mean)

    def sample(
        self, eta: FloatArray, sigma: FloatArray, random_state: np.random.RandomState
    ) -> FloatArray:
        """Draw y once for each eta."""
        raise ValueError(
            f"Draws of y are needed, and the {self.name} likelihood has a log density alone. Give "
            "it samples: sample_function=def f(eta, sigma, random_state) of a CustomLikelihood, or "
            "the method `sample` of a class."
        )

    def noise_prior(self, scale: float) -> Prior:
        """Return the default prior of sigma for outputs with this spread on the scale of eta.

        Half-normal: the spread of the output, or one on a logarithmic scale.
        """
        if not self.has_scale:
            # of a number that nothing depends on
            return stats.lognorm(1.0)
        return stats.halfnorm(scale=1.0 if self.log_scale else scale)

    def _expected(
        self,
        function: Callable[..., FloatArray],
        eta: FloatArray,
        sigma: FloatArray,
        *others: FloatArray,
    ) -> FloatArray:
        """Return the mean of ``function(y, eta, sigma, *others)`` over y, all in eta's shape."""
        eta = np.asarray(eta, dtype=float)
        out = np.zeros(eta.shape)
        random_state = np.random.RandomState(0)
        for _ in range(_N_SAMPLES):
            out += function(self.sample(eta, sigma, random_state), eta, sigma, *others)
        return out / _N_SAMPLES

    def information(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the Fisher information of each row about its eta, in the shape of eta.

        By default the mean square of the score over samples of y.
        """

        def square(y: FloatArray, eta: FloatArray, sigma: FloatArray) -> FloatArray:
            score, _ = self.derivatives(y, eta, sigma)
            return np.nan_to_num(np.square(score), posinf=0.0)

        return np.maximum(self._expected(square, eta, sigma), np.finfo(float).tiny)

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

    def overdispersed(self, scatter: FloatArray) -> Likelihood | None:
        """Return the likelihood of values that scatter more, None where it has no such form.

        Parameters
        ----------
        scatter : ndarray of shape (J, 1)
            Its second parameter for each draw; zero is this likelihood.
        """
        return None

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
        if not self.rough:
            return self.log_density(y, eta, sigma)
        return self._moments(y, eta, sigma, width)[0]

    def derivatives(
        self, y: FloatArray, eta: FloatArray, sigma: FloatArray, width: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Return d smoothed / d eta and a positive curvature, -d^2 / d eta^2 where that is.

        Curvature only shapes proposals, so where the density is not log-concave a positive stand-in
        does.
        """
        _, gradient, curvature = self._moments(y, eta, sigma, width)
        return gradient, positive(curvature, gradient)

    def _moments(
        self, y: FloatArray, eta: FloatArray, sigma: FloatArray, width: FloatArray | None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return value, slope and curvature of the smoothed log density."""
        eta = np.asarray(eta, dtype=float)
        narrow = 1e-3 * (1 + np.abs(eta))
        if width is None:
            width = _KERNEL_WIDTH * sigma if self.has_scale and self.rough else narrow
            if self.scales_noise and not self.rough:
                width = 0.01 * sigma
        wide = smoothed_moments(self.log_density, y, eta, sigma, width)
        # near the end of a support some values of eta are impossible
        bad = ~np.isfinite(wide[0])
        if not bad.any():
            return wide
        sharp = smoothed_moments(self.log_density, y, eta, sigma, np.minimum(narrow, width))
        value, gradient, curvature = (np.where(bad, b, a) for a, b in zip(wide, sharp, strict=True))
        return value, gradient, curvature


# an instance by the name that `likelihood=` takes; property tests run over it
LIKELIHOODS: dict[str, Likelihood] = {}


def register(name: str, likelihood: Likelihood) -> None:
    """Give a likelihood a name and make its class public; its file calls it at the end.

    Examples
    --------
    >>> from hybridsurrogate.likelihoods.base import register
    >>> register("gamma", stats.gamma)  # doctest: +ELLIPSIS
    Traceback (most recent call last):
        ...
    TypeError: register('gamma', ...) needs a Likelihood object, got <scipy...
    """
    if not isinstance(likelihood, Likelihood):
        raise TypeError(f"register({name!r}, ...) needs a Likelihood object, got {likelihood!r}.")
    add(LIKELIHOODS, name, likelihood)
