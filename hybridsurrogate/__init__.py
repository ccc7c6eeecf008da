"""Surrogates trained on simulations and measurements, and what the simulation gets wrong."""

from hybridsurrogate.diagnosis import CauseFinding, DiscrepancyDiagnosis
from hybridsurrogate.effects import (
    Bump,
    Cause,
    DynamicDrift,
    DynamicTerm,
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
from hybridsurrogate.estimators import (
    KennedyOHaganSurrogate,
    MultiSourceSurrogate,
    PowerScaledSurrogate,
    PredictiveWeightedSurrogate,
    Source,
    beta_path,
    choose_beta,
)
from hybridsurrogate.exceptions import (
    DiagnosisWarning,
    ExtrapolationWarning,
    FailedRunsWarning,
    HybridSurrogateWarning,
    PriorWarning,
    SamplingWarning,
)
from hybridsurrogate.inference.ensemble import EnsembleSampler
from hybridsurrogate.likelihoods import (
    CustomLikelihood,
    LogNormal,
    NegativeBinomial,
    Normal,
    Poisson,
    StudentT,
)
from hybridsurrogate.ode import OdeSimulator
from hybridsurrogate.priors import truncated_normal
from hybridsurrogate.simulation import Assumed, SimulationData, Simulator, read_simulation
from hybridsurrogate.surrogates import (
    ExactSurrogate,
    FeatureSurrogate,
    GaussianProcess,
    NetworkSurrogate,
    ParametricSurrogate,
    PolynomialChaos,
)

__version__ = "0.1.0"

__all__ = [
    "Assumed",
    "Bump",
    "Cause",
    "CauseFinding",
    "CustomLikelihood",
    "DiagnosisWarning",
    "DiscrepancyDiagnosis",
    "DynamicDrift",
    "DynamicTerm",
    "EnsembleSampler",
    "ExactSurrogate",
    "ExtrapolationWarning",
    "FailedRunsWarning",
    "FeatureSurrogate",
    "Gain",
    "GaussianProcess",
    "GaussianProcessDiscrepancy",
    "HybridSurrogateWarning",
    "KennedyOHaganSurrogate",
    "LogNormal",
    "MissingInput",
    "MultiSourceSurrogate",
    "NegativeBinomial",
    "NetworkSurrogate",
    "Normal",
    "OdeSimulator",
    "Offset",
    "ParameterDrift",
    "ParametricSurrogate",
    "Periodic",
    "Poisson",
    "PolynomialChaos",
    "PowerScaledSurrogate",
    "PredictiveWeightedSurrogate",
    "PriorWarning",
    "SamplingWarning",
    "SimulationData",
    "Simulator",
    "Source",
    "Step",
    "StudentT",
    "Trend",
    "WrongConstant",
    "beta_path",
    "choose_beta",
    "read_simulation",
    "truncated_normal",
]
