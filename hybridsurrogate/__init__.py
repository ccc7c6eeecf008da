"""Surrogates trained on simulations and measurements, and what the simulation gets wrong."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from hybridsurrogate.effects import SIMULATED, SLOPE, Cause, InOutput, Remainder
from hybridsurrogate.effects.dynamics.dynamic import DynamicDelay, DynamicStore
from hybridsurrogate.effects.dynamics.dynamic_drift import DynamicDrift
from hybridsurrogate.effects.dynamics.dynamic_term import DynamicTerm, TermByExperiment
from hybridsurrogate.effects.inputs import Delay, Friction, MissingInput
from hybridsurrogate.effects.noise.autocorrelation import Autocorrelation
from hybridsurrogate.effects.noise.known_errors import SharedErrors
from hybridsurrogate.effects.noise.noise import Noise, NoiseAtLevel, NoiseOfMean
from hybridsurrogate.effects.noise.noise_of_slope import InputError, RandomParameter
from hybridsurrogate.effects.noise.outliers import GrossError, Outliers
from hybridsurrogate.effects.noise.overdispersion import Overdispersion
from hybridsurrogate.effects.output.periodic import Periodic
from hybridsurrogate.effects.output.processes import CurveByExperiment, GaussianProcessDiscrepancy
from hybridsurrogate.effects.output.shapes import Bump, Decay, Episode, Ramp, Saturation, Step
from hybridsurrogate.effects.output.trends import Interaction, Offset, Trend, TrendSinceStart
from hybridsurrogate.effects.parameters.parameter_by_experiment import ParameterByExperiment
from hybridsurrogate.effects.parameters.parameter_drift import ParameterDrift
from hybridsurrogate.effects.parameters.parameter_process import ParameterProcess
from hybridsurrogate.effects.parameters.wrong_constant import NarrowPrior, WrongConstant
from hybridsurrogate.effects.registry import classes as _causes
from hybridsurrogate.effects.response.recurring_jumps import RecurringJumps
from hybridsurrogate.effects.response.response import Gain, Limit, Loss, SensorResponse
from hybridsurrogate.effects.response.stores import BuildUp, SecondStore
from hybridsurrogate.emulators.emulator import Emulator
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
from hybridsurrogate.inference.sampling.ensembles import EnsembleSampler
from hybridsurrogate.likelihoods import (
    LIKELIHOODS,
    BetaBinomial,
    Binomial,
    Censored,
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
    from hybridsurrogate.comparison import SimulationComparison, compare_simulations
    from hybridsurrogate.diagnosis import (
        CauseFinding,
        Detectability,
        DiscrepancyDiagnosis,
        detectability,
        refine,
    )

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
    "Censored",
    "CommandSimulator",
    "ConfoundingWarning",
    "CurveByExperiment",
    "CustomLikelihood",
    "Decay",
    "Delay",
    "Detectability",
    "DiagnosisWarning",
    "DiscrepancyDiagnosis",
    "DynamicDelay",
    "DynamicDrift",
    "DynamicStore",
    "DynamicTerm",
    "EmulationWarning",
    "Emulator",
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
    "ParameterProcess",
    "ParametricSurrogate",
    "Periodic",
    "Poisson",
    "PolynomialChaos",
    "PowerScaledSurrogate",
    "PredictiveWeightedSurrogate",
    "PriorWarning",
    "Ramp",
    "RandomParameter",
    "RecurringJumps",
    "Remainder",
    "RowByRowWarning",
    "SamplingWarning",
    "Saturation",
    "SecondStore",
    "SensorResponse",
    "SharedErrors",
    "SimulationComparison",
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
    "compare_simulations",
    "detectability",
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
_OF_DIAGNOSIS = (
    "CauseFinding",
    "Detectability",
    "DiscrepancyDiagnosis",
    "detectability",
    "refine",
)
_OF_COMPARISON = ("SimulationComparison", "compare_simulations")
_ROOMS = ("datasets", "diagnosis", "plotting", "scoring")


if not TYPE_CHECKING:  # a type checker would take every name for one that is there

    def __getattr__(name: str) -> Any:
        if name in _OF_DIAGNOSIS:
            return getattr(import_module(f"{__name__}.diagnosis"), name)
        if name in _OF_COMPARISON:
            return getattr(import_module(f"{__name__}.comparison"), name)
        if name in _ROOMS:
            return import_module(f"{__name__}.{name}")
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}", name=name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, *_ROOMS})
