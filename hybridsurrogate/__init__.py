"""Surrogates trained on simulations and measurements, and what the simulation gets wrong."""

from hybridsurrogate.diagnosis import CauseFinding, DiscrepancyDiagnosis, refine
from hybridsurrogate.effects import (
    SIMULATED,
    Autocorrelation,
    Bump,
    Cause,
    Decay,
    Delay,
    DynamicDelay,
    DynamicDrift,
    DynamicTerm,
    Gain,
    GaussianProcessDiscrepancy,
    InOutput,
    Interaction,
    MissingInput,
    Noise,
    NoiseOfMean,
    Offset,
    Outliers,
    ParameterDrift,
    Periodic,
    Ramp,
    Remainder,
    Saturation,
    Step,
    Trend,
    WrongConstant,
)
from hybridsurrogate.effects.registry import classes as _causes
from hybridsurrogate.estimators import (
    AveragedSurrogate,
    KennedyOHaganSurrogate,
    MultiSourceSurrogate,
    PowerScaledSurrogate,
    PredictiveWeightedSurrogate,
    Source,
    beta_path,
    choose_beta,
)
from hybridsurrogate.estimators.sensitivity import sobol_indices
from hybridsurrogate.exceptions import (
    ConfoundingWarning,
    DiagnosisWarning,
    ExtrapolationWarning,
    FailedRunsWarning,
    HybridSurrogateWarning,
    PriorWarning,
    SamplingWarning,
    SolverWarning,
)
from hybridsurrogate.inference.sampling.emcee_sampler import EnsembleSampler
from hybridsurrogate.likelihoods import (
    LIKELIHOODS,
    Binomial,
    CustomLikelihood,
    LogNormal,
    NegativeBinomial,
    Normal,
    Poisson,
    StudentT,
)
from hybridsurrogate.ode.simulator import OdeSimulator
from hybridsurrogate.priors import truncated_normal
from hybridsurrogate.simulation.command_simulator import CommandSimulator
from hybridsurrogate.simulation.simulator import Assumed, SimulationData, Simulator, read_simulation
from hybridsurrogate.surrogates import (
    SURROGATES,
    ExactSurrogate,
    FeatureSurrogate,
    GaussianProcess,
    Kriging,
    NetworkSurrogate,
    ParametricSurrogate,
    PolynomialChaos,
)

__version__ = "0.1.0"

__all__ = [
    "SIMULATED",
    "Assumed",
    "Autocorrelation",
    "AveragedSurrogate",
    "Binomial",
    "Bump",
    "Cause",
    "CauseFinding",
    "CommandSimulator",
    "ConfoundingWarning",
    "CustomLikelihood",
    "Decay",
    "Delay",
    "DiagnosisWarning",
    "DiscrepancyDiagnosis",
    "DynamicDelay",
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
    "InOutput",
    "Interaction",
    "KennedyOHaganSurrogate",
    "Kriging",
    "LogNormal",
    "MissingInput",
    "MultiSourceSurrogate",
    "NegativeBinomial",
    "NetworkSurrogate",
    "Noise",
    "NoiseOfMean",
    "Normal",
    "OdeSimulator",
    "Offset",
    "Outliers",
    "ParameterDrift",
    "ParametricSurrogate",
    "Periodic",
    "Poisson",
    "PolynomialChaos",
    "PowerScaledSurrogate",
    "PredictiveWeightedSurrogate",
    "PriorWarning",
    "Ramp",
    "Remainder",
    "SamplingWarning",
    "Saturation",
    "SimulationData",
    "Simulator",
    "SolverWarning",
    "Source",
    "Step",
    "StudentT",
    "Trend",
    "WrongConstant",
    "beta_path",
    "choose_beta",
    "read_simulation",
    "refine",
    "sobol_indices",
    "truncated_normal",
]

# whatever a file registers is public; the lists above are for type checkers
_REGISTERED = {
    **_causes(),
    **{type(one).__name__: type(one) for one in (*LIKELIHOODS.values(), *SURROGATES.values())},
}
globals().update(_REGISTERED)
__all__ += sorted(_REGISTERED.keys() - {*__all__})
