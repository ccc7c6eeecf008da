"""Surrogates: one file a family, which registers an instance."""

from typing import TYPE_CHECKING

from hybridsurrogate.registration import import_all
from hybridsurrogate.surrogates.base import SURROGATES, Surrogate
from hybridsurrogate.surrogates.basis import Basis, Factors
from hybridsurrogate.surrogates.domain import Domain

import_all(__name__)

# what a file registers is public
_CLASSES = {type(surrogate).__name__: type(surrogate) for surrogate in SURROGATES.values()}
globals().update(_CLASSES)
__all__ = ["SURROGATES", "Basis", "Domain", "Factors", "Surrogate", *_CLASSES]

if TYPE_CHECKING:  # for type checkers and editors, which do not run the loop
    from hybridsurrogate.surrogates.exact import ExactSurrogate as ExactSurrogate
    from hybridsurrogate.surrogates.feature import FeatureSurrogate as FeatureSurrogate
    from hybridsurrogate.surrogates.gaussian_process import GaussianProcess as GaussianProcess
    from hybridsurrogate.surrogates.kriging import Kriging as Kriging
    from hybridsurrogate.surrogates.network import NetworkSurrogate as NetworkSurrogate
    from hybridsurrogate.surrogates.parametric import ParametricSurrogate as ParametricSurrogate
    from hybridsurrogate.surrogates.polynomial_chaos import PolynomialChaos as PolynomialChaos
