"""A Bayesian linear layer on features: of any scikit-learn transformer, or of a trained network."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import special
from sklearn.base import BaseEstimator, TransformerMixin, clone
from sklearn.exceptions import ConvergenceWarning, NotFittedError
from sklearn.preprocessing import PolynomialFeatures

from hybridsurrogate.exceptions import did_you_mean
from hybridsurrogate.priors import check_prior
from hybridsurrogate.surrogates.basis import Basis, Domain, Surrogate, register
from hybridsurrogate.surrogates.families.polynomial_chaos import RELATIVE_SD, PolynomialChaos
from hybridsurrogate.types import FloatArray, Prior


class FeatureSurrogate(Surrogate):
    """Features from a scikit-learn transformer or pipeline, plus an intercept.

    A clone of the transformer is fitted on the runs (inputs and parameters scaled to [-1, 1], y
    their outputs), so splines, `Nystroem`, `RBFSampler`, `PolynomialFeatures` and pipelines of them
    work as they are.

    Parameters
    ----------
    transformer : scikit-learn transformer
        Where it draws at random and has no ``random_state``, that is 0: a fit and its repetition
        have the same features.
    coefficient_prior : frozen scipy.stats distribution or None, default=None
        Prior of each coefficient; its mean and standard deviation are used. None: mean zero and
        such that each feature moves the output by five of its standard deviations.

    Raises
    ------
    ValueError
        In ``fit`` of an estimator: a transformer that cannot be fitted or applied, that returns
        NaN, or whose number of features changes.

    Examples
    --------
    >>> import hybridsurrogate as hs
    >>> from sklearn.preprocessing import SplineTransformer
    >>> surrogate = hs.FeatureSurrogate(SplineTransformer(n_knots=6))
    >>> surrogate.get_params()["transformer__n_knots"]
    6
    """

    def __init__(self, transformer: Any = None, coefficient_prior: Prior | None = None):
        self.transformer = transformer
        self.coefficient_prior = coefficient_prior

    def build(self, domain: Domain) -> Basis:
        """Return the basis on a domain."""
        if not hasattr(self.transformer, "fit") or not hasattr(self.transformer, "transform"):
            raise TypeError(
                "FeatureSurrogate needs a scikit-learn transformer such as "
                f"SplineTransformer(), got {self.transformer!r}."
            )
        points = domain.scaled(domain.X, domain.omega)
        try:
            transformer = clone(self.transformer)
            if seeds := _unseeded(transformer):
                transformer.set_params(**seeds)
            transformer.fit(points, domain.eta)
        except NotFittedError as error:
            raise ValueError(
                f"{self.transformer!r} is not fitted and cannot be: {error} A frozen transformer "
                "has to be fitted beforehand, on inputs and parameters scaled to [-1, 1]."
            ) from error
        except Exception as error:
            raise ValueError(
                f"{self.transformer!r} cannot be fitted on the {len(points)} training rows of the "
                f"surrogate: {error}"
            ) from error
        features = _transformed(transformer, points, None)
        size = np.sqrt(np.mean(features**2, axis=0))
        mean = np.zeros(features.shape[1])
        sd = RELATIVE_SD * domain.scale / np.where(size > 0, size, 1.0)
        if self.coefficient_prior is not None:
            prior = check_prior(self.coefficient_prior, "coefficient_prior")
            mean[:], sd[:] = float(prior.mean()), float(prior.std())
        return _FeatureBasis(
            np.append(0.0, mean),
            np.append(RELATIVE_SD * domain.scale, sd),
            domain,
            transformer,
        )


@dataclass(frozen=True)
class _FeatureBasis(Basis):
    domain: Domain
    transformer: Any

    def known(
        self, X: FloatArray, omega: FloatArray, hyper: FloatArray | None = None
    ) -> FloatArray:
        return np.full(len(X), self.domain.location)

    def features(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        width = len(self.coefficient_mean) - 1
        out = np.ones((len(X), width + 1))
        out[:, 1:] = _transformed(self.transformer, self.domain.scaled(X, omega), width)
        return out


def _unseeded(transformer: Any) -> dict[str, int]:
    """Return a seed for each random state of a transformer, or of its parts, that has none."""
    return {
        name: 0
        for name, value in transformer.get_params().items()
        if name.split("__")[-1] == "random_state" and value is None
    }


def _transformed(transformer: Any, points: FloatArray, width: int | None) -> FloatArray:
    """Return features of points (n, d), checked against the width that was fitted."""
    if not len(points):
        return np.empty((0, width or 0))
    features = transformer.transform(points)
    if hasattr(features, "toarray"):
        features = features.toarray()
    features = np.asarray(features, dtype=float)
    if features.ndim != 2 or len(features) != len(points):
        raise ValueError(
            f"{transformer!r} must return shape ({len(points)}, n_features) for {len(points)} "
            f"rows, got {features.shape}."
        )
    if width is not None and features.shape[1] != width:
        raise ValueError(
            f"{transformer!r} changed its width: {width} features when fitted, "
            f"{features.shape[1]} now. A surrogate needs the same features for every row."
        )
    if not np.isfinite(features).all():
        raise ValueError(
            f"{transformer!r} returned NaN or infinity on inputs and parameters scaled to [-1, 1]."
        )
    return features


register("feature", FeatureSurrogate(PolynomialFeatures(3)))


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
        from sklearn.neural_network import MLPRegressor

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
