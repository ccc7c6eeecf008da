"""A likelihood of the user's own, from one to three functions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from hybridsurrogate.arguments import check_callable, check_flag, state_to_pickle
from hybridsurrogate.likelihoods.base import Likelihood
from hybridsurrogate.types import FloatArray


@dataclass(frozen=True)
class CustomLikelihood(Likelihood):
    """A user-defined likelihood: a log density, and optionally its mean and a sampler.

    Parameters
    ----------
    log_density_function : callable
        ``log_density(y, eta, sigma)``: y of shape (n,), eta (n_draws, n), sigma (n_draws, 1);
        returns (n_draws, n). It need not be log-concave or have derivatives.
    mean_function : callable or None, default=None
        ``mean(eta, sigma) -> (n_draws, n)``. None: the average of samples.
    sample_function : callable or None, default=None
        ``sample(eta, sigma, random_state) -> (n_draws, n)``, random_state a numpy RandomState.
        None: the model can be fitted and scored; predictions, intervals and a diagnosis need it.
    log_scale : bool, default=False
        Whether eta is the logarithm of the output.
    has_scale : bool, default=True
        Whether sigma is used.

    Examples
    --------
    Laplace noise:

    >>> import numpy as np
    >>> laplace = CustomLikelihood(
    ...     lambda y, eta, sigma: -np.abs(y - eta) / sigma - np.log(2 * sigma))
    >>> laplace.log_density(np.array([1.0]), np.zeros((1, 1)), np.ones((1, 1))).round(3)
    array([[-1.693]])
    """

    log_density_function: Callable[[FloatArray, FloatArray, FloatArray], FloatArray]
    mean_function: Callable[[FloatArray, FloatArray], FloatArray] | None = None
    sample_function: (
        Callable[[FloatArray, FloatArray, np.random.RandomState], FloatArray] | None
    ) = None
    log_scale: bool = False
    has_scale: bool = True

    name = "user's own"
    rough = True

    def check_training(self, y: FloatArray, source: str = "measured") -> None:
        """Raise ValueError where y needs a logarithm and has none, or no density is finite.

        The density is evaluated at the data themselves, with sigma = 1. A function that returns the
        wrong shape, or NaN or minus infinity everywhere, raises an error before anything is fitted.
        """
        check_callable(self.log_density_function, "log_density_function", "def f(y, eta, sigma)")
        for name in ("mean_function", "sample_function"):
            if getattr(self, name) is not None:
                check_callable(getattr(self, name), name, "def f(eta, sigma, ...), or None")
        for name in ("log_scale", "has_scale"):
            check_flag(getattr(self, name), name)
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
        if self.mean_function is not None:
            self._shaped("mean_function", batch, batch, np.ones((2, 1)))
        if self.sample_function is not None:
            random_state = np.random.RandomState(0)
            self._shaped("sample_function", batch, batch, np.ones((2, 1)), random_state)

    def __getstate__(self) -> dict[str, Any]:
        return state_to_pickle(self.__dict__, "CustomLikelihood")

    def _shaped(self, function: str, eta: FloatArray, *arguments: object) -> FloatArray:
        values = np.asarray(getattr(self, function)(*arguments), dtype=float)
        if values.shape != eta.shape:
            raise ValueError(
                f"{function} of {self!r} must return the shape of eta, {eta.shape}, "
                f"got {values.shape}."
            )
        return values

    def log_density(self, y: FloatArray, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the user's log density, minus infinity where it is NaN."""
        with np.errstate(all="ignore"):
            values = np.asarray(self.log_density_function(y, eta, sigma), dtype=float)
        return np.where(np.isnan(values), -np.inf, values)

    def mean(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the user's mean, or the average of samples."""
        if self.mean_function is None:
            return super().mean(eta, sigma)
        return np.asarray(self.mean_function(eta, sigma), dtype=float)

    def sample(
        self, eta: FloatArray, sigma: FloatArray, random_state: np.random.RandomState
    ) -> FloatArray:
        """Return the user's samples."""
        if self.sample_function is None:
            return super().sample(eta, sigma, random_state)
        return np.asarray(self.sample_function(eta, sigma, random_state), dtype=float)
