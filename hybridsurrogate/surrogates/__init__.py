"""Surrogates: one file a family."""

from hybridsurrogate.surrogates.base import Basis, Domain, Surrogate
from hybridsurrogate.surrogates.exact import ExactSurrogate
from hybridsurrogate.surrogates.polynomial_chaos import PolynomialChaos

__all__ = ["Basis", "Domain", "ExactSurrogate", "PolynomialChaos", "Surrogate"]
