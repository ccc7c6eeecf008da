"""What an estimator asks of a surrogate.

A surrogate turns the domain of a simulation into a *basis*: a known part m0(x, omega) plus
features phi(x, omega) whose coefficients c have a Gaussian prior,
``eta(x, omega; c) = m0(x, omega) + phi(x, omega)' c``. Everything else, from the collapsed
likelihood to the diagnosis, is written on those two functions.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from sklearn.base import BaseEstimator

from hybridsurrogate.priors import FloatArray


@dataclass(frozen=True)
class Domain:
    """Where the surrogate lives.

    Attributes
    ----------
    input_ranges : ndarray of shape (n_inputs, 2)
        Simulated range of each input.
    parameter_ranges : ndarray of shape (n_parameters, 2)
        Simulated range of each parameter, the assumed constants last.
    location, scale : float
        Mean and standard deviation of the outputs on the scale of eta, for default priors.
    simulate : callable or None
        ``simulate(X, omega) -> (n,)`` on the scale of eta; None when there are only runs.
    """

    input_ranges: FloatArray
    parameter_ranges: FloatArray
    location: float
    scale: float
    simulate: Callable[[FloatArray, FloatArray], FloatArray] | None = None


@dataclass(frozen=True)
class Basis(ABC):
    """A surrogate on a domain: known part, features, and the prior of the coefficients.

    Attributes
    ----------
    coefficient_mean, coefficient_sd : ndarray of shape (p,)
        Independent normal priors.
    """

    coefficient_mean: FloatArray
    coefficient_sd: FloatArray

    @abstractmethod
    def known(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Return m0 for rows of inputs (n, n_inputs) and parameters (n, n_parameters): (n,)."""

    @abstractmethod
    def features(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Return phi for the same rows: (n, p)."""

    def outer(self, X: FloatArray, omega: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return known part (J, n) and features (J, n, p) of n inputs for each of J parameters.

        A basis whose features factorise overrides this for speed.
        """
        J, n = len(omega), len(X)
        rows, points = np.tile(X, (J, 1)), np.repeat(omega, n, axis=0)
        features = self.features(rows, points)
        return self.known(rows, points).reshape(J, n), features.reshape(J, n, features.shape[1])


class Surrogate(BaseEstimator, ABC):
    """Base of the surrogates: constructor parameters only, no state.

    A surrogate of your own implements ``build`` and returns a `Basis`.

    Examples
    --------
    >>> import numpy as np
    >>> from hybridsurrogate.surrogates import Basis, Surrogate
    >>> class LineBasis(Basis):
    ...     def known(self, X, omega):
    ...         return np.zeros(len(X))
    ...     def features(self, X, omega):
    ...         return np.column_stack([np.ones(len(X)), X, omega])
    >>> class Line(Surrogate):
    ...     def build(self, domain):
    ...         p = 1 + len(domain.input_ranges) + len(domain.parameter_ranges)
    ...         return LineBasis(np.zeros(p), np.full(p, 10 * domain.scale))
    """

    @abstractmethod
    def build(self, domain: Domain) -> Basis:
        """Return the basis on a domain."""

    def of_measured_data(self) -> Surrogate:
        """Return the surrogate of measured data alone that predictive weighting puts beside it."""
        return self
