"""Any scikit-learn transformer as a surrogate: its output times Gaussian coefficients."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from sklearn.base import clone
from sklearn.exceptions import NotFittedError
from sklearn.preprocessing import PolynomialFeatures

from hybridsurrogate.priors import check_prior
from hybridsurrogate.surrogates.base import Surrogate, register
from hybridsurrogate.surrogates.basis import Basis
from hybridsurrogate.surrogates.domain import Domain
from hybridsurrogate.types import FloatArray, Prior

_DEFAULT_RELATIVE_SD = 5.0


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
        sd = _DEFAULT_RELATIVE_SD * domain.scale / np.where(size > 0, size, 1.0)
        if self.coefficient_prior is not None:
            prior = check_prior(self.coefficient_prior, "coefficient_prior")
            mean[:], sd[:] = float(prior.mean()), float(prior.std())
        return _FeatureBasis(
            np.append(0.0, mean),
            np.append(_DEFAULT_RELATIVE_SD * domain.scale, sd),
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
