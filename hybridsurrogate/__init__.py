"""Surrogates trained on simulations and measurements, and what the simulation gets wrong.

A name is imported when it is first used (PEP 562, and Scientific Python's SPEC 1): the package
itself imports nothing.
"""

import sys
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # for type checkers and editors, which do not run what follows
    from hybridsurrogate import datasets as datasets
    from hybridsurrogate import diagnosis as diagnosis
    from hybridsurrogate import plotting as plotting
    from hybridsurrogate import scoring as scoring
    from hybridsurrogate.comparison import SimulationComparison as SimulationComparison
    from hybridsurrogate.comparison import compare_simulations as compare_simulations
    from hybridsurrogate.diagnosis import CauseFinding as CauseFinding
    from hybridsurrogate.diagnosis import DiscrepancyDiagnosis as DiscrepancyDiagnosis
    from hybridsurrogate.diagnosis import refine as refine
    from hybridsurrogate.diagnosis.planning.detectability import detectability as detectability
    from hybridsurrogate.diagnosis.planning.result import Detectability as Detectability
    from hybridsurrogate.effects import SIMULATED as SIMULATED
    from hybridsurrogate.effects import SLOPE as SLOPE
    from hybridsurrogate.effects import Cause as Cause
    from hybridsurrogate.effects import InOutput as InOutput
    from hybridsurrogate.effects import Remainder as Remainder
    from hybridsurrogate.effects.dynamics.dynamic import DynamicDelay as DynamicDelay
    from hybridsurrogate.effects.dynamics.dynamic import DynamicStore as DynamicStore
    from hybridsurrogate.effects.dynamics.dynamic_drift import DynamicDrift as DynamicDrift
    from hybridsurrogate.effects.dynamics.dynamic_term import DynamicTerm as DynamicTerm
    from hybridsurrogate.effects.dynamics.dynamic_term import TermByExperiment as TermByExperiment
    from hybridsurrogate.effects.inputs import Delay as Delay
    from hybridsurrogate.effects.inputs import Friction as Friction
    from hybridsurrogate.effects.inputs import MissingInput as MissingInput
    from hybridsurrogate.effects.noise.autocorrelation import Autocorrelation as Autocorrelation
    from hybridsurrogate.effects.noise.known_errors import SharedErrors as SharedErrors
    from hybridsurrogate.effects.noise.noise import Noise as Noise
    from hybridsurrogate.effects.noise.noise import NoiseAtLevel as NoiseAtLevel
    from hybridsurrogate.effects.noise.noise import NoiseOfMean as NoiseOfMean
    from hybridsurrogate.effects.noise.noise import OutputCorrelation as OutputCorrelation
    from hybridsurrogate.effects.noise.noise_of_slope import InputError as InputError
    from hybridsurrogate.effects.noise.noise_of_slope import RandomParameter as RandomParameter
    from hybridsurrogate.effects.noise.outliers import GrossError as GrossError
    from hybridsurrogate.effects.noise.outliers import Outliers as Outliers
    from hybridsurrogate.effects.noise.overdispersion import Overdispersion as Overdispersion
    from hybridsurrogate.effects.output.periodic import Periodic as Periodic
    from hybridsurrogate.effects.output.processes import CurveByExperiment as CurveByExperiment
    from hybridsurrogate.effects.output.processes import (
        GaussianProcessDiscrepancy as GaussianProcessDiscrepancy,
    )
    from hybridsurrogate.effects.output.shapes import Bump as Bump
    from hybridsurrogate.effects.output.shapes import Decay as Decay
    from hybridsurrogate.effects.output.shapes import Episode as Episode
    from hybridsurrogate.effects.output.shapes import Ramp as Ramp
    from hybridsurrogate.effects.output.shapes import Saturation as Saturation
    from hybridsurrogate.effects.output.shapes import Step as Step
    from hybridsurrogate.effects.output.trends import Interaction as Interaction
    from hybridsurrogate.effects.output.trends import Offset as Offset
    from hybridsurrogate.effects.output.trends import Trend as Trend
    from hybridsurrogate.effects.output.trends import TrendSinceStart as TrendSinceStart
    from hybridsurrogate.effects.parameters.parameter_by_experiment import (
        ParameterByExperiment as ParameterByExperiment,
    )
    from hybridsurrogate.effects.parameters.parameter_drift import ParameterDrift as ParameterDrift
    from hybridsurrogate.effects.parameters.parameter_process import (
        ParameterProcess as ParameterProcess,
    )
    from hybridsurrogate.effects.parameters.wrong_constant import NarrowPrior as NarrowPrior
    from hybridsurrogate.effects.parameters.wrong_constant import WrongConstant as WrongConstant
    from hybridsurrogate.effects.response.recurring_jumps import RecurringJumps as RecurringJumps
    from hybridsurrogate.effects.response.response import Gain as Gain
    from hybridsurrogate.effects.response.response import Limit as Limit
    from hybridsurrogate.effects.response.response import Loss as Loss
    from hybridsurrogate.effects.response.response import SensorResponse as SensorResponse
    from hybridsurrogate.effects.response.stores import BuildUp as BuildUp
    from hybridsurrogate.effects.response.stores import SecondStore as SecondStore
    from hybridsurrogate.emulators.emulator import Emulator as Emulator
    from hybridsurrogate.estimators import AveragedSurrogate as AveragedSurrogate
    from hybridsurrogate.estimators import KennedyOHaganSurrogate as KennedyOHaganSurrogate
    from hybridsurrogate.estimators import MultiSourceSurrogate as MultiSourceSurrogate
    from hybridsurrogate.estimators import PowerScaledSurrogate as PowerScaledSurrogate
    from hybridsurrogate.estimators import (
        PredictiveWeightedSurrogate as PredictiveWeightedSurrogate,
    )
    from hybridsurrogate.estimators import Source as Source
    from hybridsurrogate.estimators import beta_path as beta_path
    from hybridsurrogate.estimators import choose_beta as choose_beta
    from hybridsurrogate.estimators.sensitivity import sobol_indices as sobol_indices
    from hybridsurrogate.exceptions import ConfoundingWarning as ConfoundingWarning
    from hybridsurrogate.exceptions import DiagnosisWarning as DiagnosisWarning
    from hybridsurrogate.exceptions import EmulationWarning as EmulationWarning
    from hybridsurrogate.exceptions import ExtrapolationWarning as ExtrapolationWarning
    from hybridsurrogate.exceptions import FailedRunsWarning as FailedRunsWarning
    from hybridsurrogate.exceptions import HybridSurrogateWarning as HybridSurrogateWarning
    from hybridsurrogate.exceptions import MissingMeasurementWarning as MissingMeasurementWarning
    from hybridsurrogate.exceptions import PriorWarning as PriorWarning
    from hybridsurrogate.exceptions import RowByRowWarning as RowByRowWarning
    from hybridsurrogate.exceptions import SamplingWarning as SamplingWarning
    from hybridsurrogate.exceptions import SolverWarning as SolverWarning
    from hybridsurrogate.inference.sampling.ensembles import EnsembleSampler as EnsembleSampler
    from hybridsurrogate.likelihoods import BetaBinomial as BetaBinomial
    from hybridsurrogate.likelihoods import Binomial as Binomial
    from hybridsurrogate.likelihoods import Censored as Censored
    from hybridsurrogate.likelihoods import CustomLikelihood as CustomLikelihood
    from hybridsurrogate.likelihoods import LogNormal as LogNormal
    from hybridsurrogate.likelihoods import NegativeBinomial as NegativeBinomial
    from hybridsurrogate.likelihoods import Normal as Normal
    from hybridsurrogate.likelihoods import Poisson as Poisson
    from hybridsurrogate.likelihoods import StudentT as StudentT
    from hybridsurrogate.ode.simulator import OdeSimulator as OdeSimulator
    from hybridsurrogate.priors import truncated_normal as truncated_normal
    from hybridsurrogate.saved_file import load as load
    from hybridsurrogate.saved_file import save as save
    from hybridsurrogate.simulation.command_simulator import CommandSimulator as CommandSimulator
    from hybridsurrogate.simulation.simulator import Assumed as Assumed
    from hybridsurrogate.simulation.simulator import SimulationData as SimulationData
    from hybridsurrogate.simulation.simulator import Simulator as Simulator
    from hybridsurrogate.simulation.simulator import read_simulation as read_simulation
    from hybridsurrogate.surrogates import ExactSurrogate as ExactSurrogate
    from hybridsurrogate.surrogates import FeatureSurrogate as FeatureSurrogate
    from hybridsurrogate.surrogates import GaussianProcess as GaussianProcess
    from hybridsurrogate.surrogates import Kriging as Kriging
    from hybridsurrogate.surrogates import NetworkSurrogate as NetworkSurrogate
    from hybridsurrogate.surrogates import ParametricSurrogate as ParametricSurrogate
    from hybridsurrogate.surrogates import PolynomialChaos as PolynomialChaos

__version__ = "0.2.0"

# where a name stands; whatever a file of the others registers is public, too
_NAMES = {
    "comparison": ("SimulationComparison", "compare_simulations"),
    "diagnosis": ("CauseFinding", "DiscrepancyDiagnosis", "refine"),
    "diagnosis.planning.detectability": ("Detectability", "detectability"),
    "effects": ("SIMULATED", "SLOPE", "Cause", "InOutput", "Remainder"),
    "effects.noise.known_errors": ("SharedErrors",),
    "effects.noise.noise": ("OutputCorrelation",),
    "emulators.emulator": ("Emulator",),
    "estimators": (
        *("AveragedSurrogate", "KennedyOHaganSurrogate", "MultiSourceSurrogate"),
        *("PowerScaledSurrogate", "PredictiveWeightedSurrogate", "Source"),
        *("beta_path", "choose_beta"),
    ),
    "estimators.sensitivity": ("sobol_indices",),
    "exceptions": (
        *("ConfoundingWarning", "DiagnosisWarning", "EmulationWarning", "ExtrapolationWarning"),
        *("FailedRunsWarning", "HybridSurrogateWarning", "MissingMeasurementWarning"),
        *("PriorWarning", "RowByRowWarning", "SamplingWarning", "SolverWarning"),
    ),
    "inference.sampling.ensembles": ("EnsembleSampler",),
    "likelihoods": ("Censored", "CustomLikelihood"),
    "ode.simulator": ("OdeSimulator",),
    "priors": ("truncated_normal",),
    "saved_file": ("load", "save"),
    "simulation": ("Assumed", "CommandSimulator", "SimulationData", "Simulator", "read_simulation"),
}
_HOME = {name: module for module, names in _NAMES.items() for name in names}
_ROOMS = ("datasets", "diagnosis", "plotting", "scoring")


def _registered() -> dict[str, type]:
    """Return the classes of what files register, by name."""
    from hybridsurrogate.effects.registry import classes
    from hybridsurrogate.likelihoods import LIKELIHOODS
    from hybridsurrogate.surrogates import SURROGATES

    things = (*LIKELIHOODS.values(), *SURROGATES.values())
    return classes() | {type(one).__name__: type(one) for one in things}


if not TYPE_CHECKING:  # a type checker would take every name for one that is there

    def __getattr__(name: str) -> Any:
        value: Any
        if name in _HOME:
            value = getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
        elif name == "__all__":
            value = sorted({*_HOME, *_registered()})
        elif not name.startswith("_") and find_spec(f"{__name__}.{name}"):
            value = import_module(f"{__name__}.{name}")
        elif not name.startswith("_") and name in (registered := _registered()):
            value = registered[name]
        else:
            # Python suggests a name of `__dir__` that is near
            module = sys.modules[__name__]
            message = f"module {__name__!r} has no attribute {name!r}"
            raise AttributeError(message, name=name, obj=module)
        globals()[name] = value
        return value

    def __dir__() -> list[str]:
        return sorted({*globals(), *__getattr__("__all__"), *_ROOMS})
