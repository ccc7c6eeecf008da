"""Surrogates: one file a family."""

from hybridsurrogate.surrogates.base import Surrogate
from hybridsurrogate.surrogates.basis import Basis, Factors
from hybridsurrogate.surrogates.domain import Domain
from hybridsurrogate.surrogates.exact import ExactSurrogate
from hybridsurrogate.surrogates.feature import FeatureSurrogate
from hybridsurrogate.surrogates.gaussian_process import GaussianProcess
from hybridsurrogate.surrogates.kriging import Kriging
from hybridsurrogate.surrogates.network import NetworkSurrogate
from hybridsurrogate.surrogates.parametric import ParametricSurrogate
from hybridsurrogate.surrogates.polynomial_chaos import PolynomialChaos

__all__ = [
    "Basis",
    "Domain",
    "ExactSurrogate",
    "Factors",
    "FeatureSurrogate",
    "GaussianProcess",
    "Kriging",
    "NetworkSurrogate",
    "ParametricSurrogate",
    "PolynomialChaos",
    "Surrogate",
]
