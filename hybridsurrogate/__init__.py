"""Surrogates trained on simulations and measurements, and what the simulation gets wrong."""

from hybridsurrogate.diagnosis import CauseFinding, DiscrepancyDiagnosis
from hybridsurrogate.effects import (
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
from hybridsurrogate.estimators import PowerScaledSurrogate, PredictiveWeightedSurrogate
from hybridsurrogate.exceptions import (
    DiagnosisWarning,
    ExtrapolationWarning,
    FailedRunsWarning,
    HybridSurrogateWarning,
    PriorWarning,
    SamplingWarning,
)
from hybridsurrogate.likelihoods import LogNormal, Normal
from hybridsurrogate.priors import truncated_normal
from hybridsurrogate.simulation import Assumed, SimulationData, Simulator, read_simulation
from hybridsurrogate.surrogates import ExactSurrogate, PolynomialChaos

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
