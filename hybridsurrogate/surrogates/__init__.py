"""Surrogates.

base        what a family is, and the register
basis       a family for given runs: features, a fixed part, hyperparameters
domain      what a family may know of the runs
families/   one file each, which registers an instance
emulation/  processes over runs, and over curves
"""

from typing import TYPE_CHECKING

from hybridsurrogate.registration import import_all
from hybridsurrogate.surrogates.base import SURROGATES, Surrogate
from hybridsurrogate.surrogates.basis import Basis, Factors
from hybridsurrogate.surrogates.domain import Domain

if TYPE_CHECKING:  # for type checkers and editors, which do not run `import_all`
    from hybridsurrogate.surrogates.families.exact import ExactSurrogate
    from hybridsurrogate.surrogates.families.feature import FeatureSurrogate
    from hybridsurrogate.surrogates.families.gaussian_process import GaussianProcess
    from hybridsurrogate.surrogates.families.kriging import Kriging
    from hybridsurrogate.surrogates.families.network import NetworkSurrogate
    from hybridsurrogate.surrogates.families.parametric import ParametricSurrogate
    from hybridsurrogate.surrogates.families.polynomial_chaos import PolynomialChaos

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

import_all(f"{__name__}.families")

# what a file registers is public
_CLASSES = {type(surrogate).__name__: type(surrogate) for surrogate in SURROGATES.values()}
globals().update(_CLASSES)
__all__ += sorted(_CLASSES.keys() - set(__all__))
