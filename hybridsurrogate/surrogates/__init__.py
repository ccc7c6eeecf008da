"""Surrogates: one file a family, which registers an instance."""

from typing import TYPE_CHECKING

from hybridsurrogate.registration import import_all
from hybridsurrogate.surrogates.base import SURROGATES, Surrogate
from hybridsurrogate.surrogates.basis import Basis, Factors
from hybridsurrogate.surrogates.domain import Domain

if TYPE_CHECKING:  # for type checkers and editors, which do not run `import_all`
    from hybridsurrogate.surrogates.exact import ExactSurrogate
    from hybridsurrogate.surrogates.feature import FeatureSurrogate
    from hybridsurrogate.surrogates.gaussian_process import GaussianProcess
    from hybridsurrogate.surrogates.kriging import Kriging
    from hybridsurrogate.surrogates.network import NetworkSurrogate
    from hybridsurrogate.surrogates.parametric import ParametricSurrogate
    from hybridsurrogate.surrogates.polynomial_chaos import PolynomialChaos

__all__ = [
    "SURROGATES",
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

import_all(__name__)

# what a file registers is public
_CLASSES = {type(surrogate).__name__: type(surrogate) for surrogate in SURROGATES.values()}
globals().update(_CLASSES)
__all__ += sorted(_CLASSES.keys() - set(__all__))
