"""A trained network whose last layer is Bayesian."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy import special
from sklearn.base import BaseEstimator, TransformerMixin, clone
from sklearn.exceptions import ConvergenceWarning
from sklearn.neural_network import MLPRegressor

from hybridsurrogate.exceptions import did_you_mean
from hybridsurrogate.surrogates.base import Surrogate, register
from hybridsurrogate.surrogates.basis import Basis
from hybridsurrogate.surrogates.domain import Domain
from hybridsurrogate.surrogates.families.feature import FeatureSurrogate
from hybridsurrogate.surrogates.families.polynomial_chaos import PolynomialChaos
from hybridsurrogate.types import FloatArray

ACTIVATIONS: dict[str, Callable[[FloatArray], FloatArray]] = {
    "logistic": special.expit,
    "relu": lambda x: np.maximum(x, 0.0),
    "tanh": np.tanh,
}


class NetworkSurrogate(Surrogate):
    """Multilayer perceptron trained on the runs; its last layer has Gaussian coefficients.

    The hidden layers are fixed after training, so everything stays conditionally linear: the
    weights of the last layer, and with them the uncertainty, are inferred from both data sources.
    It fits kinks, plateaus and thresholds, where polynomials oscillate.

    Parameters
    ----------
    hidden_layer_sizes : sequence of int, default=(32, 16)
    activation : {"tanh", "relu", "logistic"}, default="tanh"
    alpha : float, default=1e-4
        Penalty on the weights in training.
    max_iter : int, default=2000
        Of L-BFGS.
    random_state : int, default=0
        Of the initial weights; an int, so that the same runs give the same features in every fit.

    Examples
    --------
    >>> import hybridsurrogate as hs
    >>> hs.NetworkSurrogate(hidden_layer_sizes=(16,)).hidden_layer_sizes
    (16,)
    """

    def __init__(
        self,
        hidden_layer_sizes: Sequence[int] = (32, 16),
        activation: str = "tanh",
        alpha: float = 1e-4,
        max_iter: int = 2000,
        random_state: int = 0,
    ):
        self.hidden_layer_sizes = hidden_layer_sizes
        self.activation = activation
        self.alpha = alpha
        self.max_iter = max_iter
        self.random_state = random_state

    def build(self, domain: Domain) -> Basis:
        """Return the basis on a domain, the network trained on its rows."""
        if self.activation not in ACTIVATIONS:
            raise ValueError(
                f"activation must be one of {sorted(ACTIVATIONS)}, got {self.activation!r}."
                f"{did_you_mean(self.activation, ACTIVATIONS)}"
            )
        network = MLPRegressor(solver="lbfgs", **self.get_params())
        return FeatureSurrogate(HiddenLayers(network)).build(domain)

    def of_measured_data(self) -> Surrogate:
        """Return a polynomial: measured rows are too few to train a network."""
        return PolynomialChaos()


class HiddenLayers(TransformerMixin, BaseEstimator):
    """Output of the last hidden layer of a network that is trained in ``fit``."""

    def __init__(self, network: Any):
        self.network = network

    def fit(self, X: FloatArray, y: FloatArray) -> HiddenLayers:
        """Train the network on standardised outputs."""
        spread = float(np.std(y)) or 1.0
        with warnings.catch_warnings():
            # features need not be at an optimum: the last layer is inferred afterwards
            warnings.simplefilter("ignore", ConvergenceWarning)
            self.network_ = clone(self.network).fit(X, (y - np.mean(y)) / spread)
        return self

    def transform(self, X: FloatArray) -> FloatArray:
        """Return the activations of the last hidden layer, (n, n_units)."""
        activate = ACTIVATIONS[self.network_.activation]
        weights, shifts = self.network_.coefs_[:-1], self.network_.intercepts_[:-1]
        for weight, shift in zip(weights, shifts, strict=True):
            X = activate(X @ weight + shift)
        return X


register("network", NetworkSurrogate(hidden_layer_sizes=(16,)))
