"""Surrogates: one file a family."""

from .base import Basis, Domain, Surrogate
from .exact import ExactSurrogate
from .polynomial_chaos import PolynomialChaos

__all__ = ["Basis", "Domain", "ExactSurrogate", "PolynomialChaos", "Surrogate"]
