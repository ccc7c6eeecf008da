"""Surrogates trained on simulations and measurements, and what the simulation gets wrong."""

from .diagnosis import CauseFinding, DiscrepancyDiagnosis
from .effects import (
    Bump,
    Cause,
    Gain,
    GaussianProcessDiscrepancy,
    MissingInput,
    Offset,
    ParameterDrift,
    Periodic,
    Step,
    Trend,
    WrongConstant,
)
from .estimators import PowerScaledSurrogate, PredictiveWeightedSurrogate
from .exceptions import (
    DiagnosisWarning,
    ExtrapolationWarning,
    FailedRunsWarning,
    HybridSurrogateWarning,
    PriorWarning,
    SamplingWarning,
)
from .likelihoods import LogNormal, Normal
from .priors import truncated_normal
from .simulation import Assumed, SimulationData, Simulator, read_simulation
from .surrogates import ExactSurrogate, PolynomialChaos

__version__ = "0.1.0"

__all__ = [
    "Assumed",
    "Bump",
    "Cause",
    "CauseFinding",
    "DiagnosisWarning",
    "DiscrepancyDiagnosis",
    "ExactSurrogate",
    "ExtrapolationWarning",
    "FailedRunsWarning",
    "Gain",
    "GaussianProcessDiscrepancy",
    "HybridSurrogateWarning",
    "LogNormal",
    "MissingInput",
    "Normal",
    "Offset",
    "ParameterDrift",
    "Periodic",
    "PolynomialChaos",
    "PowerScaledSurrogate",
    "PredictiveWeightedSurrogate",
    "PriorWarning",
    "SamplingWarning",
    "SimulationData",
    "Simulator",
    "Step",
    "Trend",
    "WrongConstant",
    "read_simulation",
    "truncated_normal",
]
