"""Surrogates trained on simulations and measurements, and what the simulation gets wrong."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from hybridsurrogate.effects import (
    SIMULATED,
    SLOPE,
    Autocorrelation,
    BuildUp,
    Bump,
    Cause,
    CurveByExperiment,
    Decay,
    Delay,
    DynamicDelay,
    DynamicDrift,
    DynamicTerm,
    Episode,
    Friction,
    Gain,
    GaussianProcessDiscrepancy,
    GrossError,
    InOutput,
    InputError,
    Interaction,
    Limit,
    Loss,
    MissingInput,
    NarrowPrior,
    Noise,
    NoiseAtLevel,
    NoiseOfMean,
    Offset,
    Outliers,
    Overdispersion,
    ParameterByExperiment,
    ParameterDrift,
    Periodic,
    Ramp,
    RandomParameter,
    Remainder,
    Saturation,
    SecondStore,
    SensorResponse,
    Step,
    TermByExperiment,
    Trend,
    TrendSinceStart,
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
    EmulationWarning,
    ExtrapolationWarning,
    FailedRunsWarning,
    HybridSurrogateWarning,
    MissingMeasurementWarning,
    PriorWarning,
    RowByRowWarning,
    SamplingWarning,
    SolverWarning,
)
from hybridsurrogate.inference.sampling.emcee_sampler import EnsembleSampler
from hybridsurrogate.likelihoods import (
    LIKELIHOODS,
    BetaBinomial,
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
from hybridsurrogate.saved_file import load, save
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

if TYPE_CHECKING:  # imported when they are first used, see `__getattr__`
    from hybridsurrogate.diagnosis import CauseFinding, DiscrepancyDiagnosis, refine

__version__ = "0.2.0"

__all__ = [
    "SIMULATED",
    "SLOPE",
    "Assumed",
    "Autocorrelation",
    "AveragedSurrogate",
    "BetaBinomial",
    "Binomial",
    "BuildUp",
    "Bump",
    "Cause",
    "CauseFinding",
    "CommandSimulator",
    "ConfoundingWarning",
    "CurveByExperiment",
    "CustomLikelihood",
    "Decay",
    "Delay",
    "DiagnosisWarning",
    "DiscrepancyDiagnosis",
    "DynamicDelay",
    "DynamicDrift",
    "DynamicTerm",
    "EmulationWarning",
    "EnsembleSampler",
    "Episode",
    "ExactSurrogate",
    "ExtrapolationWarning",
    "FailedRunsWarning",
    "FeatureSurrogate",
    "Friction",
    "Gain",
    "GaussianProcess",
    "GaussianProcessDiscrepancy",
    "GrossError",
    "HybridSurrogateWarning",
    "InOutput",
    "InputError",
    "Interaction",
    "KennedyOHaganSurrogate",
    "Kriging",
    "Limit",
    "LogNormal",
    "Loss",
    "MissingInput",
    "MissingMeasurementWarning",
    "MultiSourceSurrogate",
    "NarrowPrior",
    "NegativeBinomial",
    "NetworkSurrogate",
    "Noise",
    "NoiseAtLevel",
    "NoiseOfMean",
    "Normal",
    "OdeSimulator",
    "Offset",
    "Outliers",
    "Overdispersion",
    "ParameterByExperiment",
    "ParameterDrift",
    "ParametricSurrogate",
    "Periodic",
    "Poisson",
    "PolynomialChaos",
    "PowerScaledSurrogate",
    "PredictiveWeightedSurrogate",
    "PriorWarning",
    "Ramp",
    "RandomParameter",
    "Remainder",
    "RowByRowWarning",
    "SamplingWarning",
    "Saturation",
    "SecondStore",
    "SensorResponse",
    "SimulationData",
    "Simulator",
    "SolverWarning",
    "Source",
    "Step",
    "StudentT",
    "TermByExperiment",
    "Trend",
    "TrendSinceStart",
    "WrongConstant",
    "beta_path",
    "choose_beta",
    "load",
    "read_simulation",
    "refine",
    "save",
    "sobol_indices",
    "truncated_normal",
]

# whatever a file registers is public; the lists above are for type checkers and editors
_REGISTERED = {
    **_causes(),
    **{type(one).__name__: type(one) for one in (*LIKELIHOODS.values(), *SURROGATES.values())},
}
globals().update(_REGISTERED)
__all__ += sorted(_REGISTERED.keys() - {*__all__})

# imported when they are first used
_OF_DIAGNOSIS = ("CauseFinding", "DiscrepancyDiagnosis", "refine")
_ROOMS = ("datasets", "diagnosis", "plotting", "scoring")


def __getattr__(name: str) -> Any:
    if name in _OF_DIAGNOSIS:
        return getattr(import_module(f"{__name__}.diagnosis"), name)
    if name in _ROOMS:
        return import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}", name=name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, *_ROOMS})
