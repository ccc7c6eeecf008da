"""Surrogates.

basis       what a family is; a family for given runs: features, a fixed part, hyperparameters
families/   each registers an instance
emulation/  processes over runs, and over curves
"""

from typing import TYPE_CHECKING

from hybridsurrogate.registration import import_all
from hybridsurrogate.surrogates.basis import SURROGATES, Basis, Domain, Factors, Surrogate

if TYPE_CHECKING:  # for type checkers and editors, which do not run `import_all`
    from hybridsurrogate.surrogates.families.feature import FeatureSurrogate, NetworkSurrogate
    from hybridsurrogate.surrogates.families.gaussian_process import GaussianProcess
    from hybridsurrogate.surrogates.families.kriging import Kriging
    from hybridsurrogate.surrogates.families.parametric import ExactSurrogate, ParametricSurrogate
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
