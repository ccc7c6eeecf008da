"""The catalogue of causes: one small file a kind, which registers itself.

registry (what a file registers), base (the methods of a cause), context (what it may know of
the data), in_output (a cause in one of several outputs), over_column, sized, picture, notation,
code (a cause as Python); then rooms by what a cause changes: output (added to it), response (made
of it), parameters, inputs, dynamics, noise. The imports below serve type checkers and
editors, which do not run ``load``.
"""

from typing import TYPE_CHECKING

from hybridsurrogate.effects.base import SIMULATED, SLOPE, Cause, Context
from hybridsurrogate.effects.in_output import InOutput
from hybridsurrogate.effects.output.remainder import Remainder
from hybridsurrogate.effects.registry import classes, load

if TYPE_CHECKING:  # the files are loaded below, room by room
    from hybridsurrogate.effects.dynamics.dynamic_delay import DynamicDelay
    from hybridsurrogate.effects.dynamics.dynamic_drift import DynamicDrift
    from hybridsurrogate.effects.dynamics.dynamic_term import DynamicTerm
    from hybridsurrogate.effects.dynamics.term_by_experiment import TermByExperiment
    from hybridsurrogate.effects.ignored.friction import Friction
    from hybridsurrogate.effects.ignored.missing_input import MissingInput
    from hybridsurrogate.effects.inputs.delay import Delay
    from hybridsurrogate.effects.noise.autocorrelation import Autocorrelation
    from hybridsurrogate.effects.noise.gross_error import GrossError
    from hybridsurrogate.effects.noise.input_error import InputError
    from hybridsurrogate.effects.noise.noise import Noise
    from hybridsurrogate.effects.noise.noise_at_level import NoiseAtLevel
    from hybridsurrogate.effects.noise.noise_of_mean import NoiseOfMean
    from hybridsurrogate.effects.noise.outliers import Outliers
    from hybridsurrogate.effects.noise.overdispersion import Overdispersion
    from hybridsurrogate.effects.noise.random_parameter import RandomParameter
    from hybridsurrogate.effects.output.bump import Bump
    from hybridsurrogate.effects.output.curve_by_experiment import CurveByExperiment
    from hybridsurrogate.effects.output.decay import Decay
    from hybridsurrogate.effects.output.discrepancy_process import GaussianProcessDiscrepancy
    from hybridsurrogate.effects.output.episode import Episode
    from hybridsurrogate.effects.output.interaction import Interaction
    from hybridsurrogate.effects.output.offset import Offset
    from hybridsurrogate.effects.output.periodic import Periodic
    from hybridsurrogate.effects.output.ramp import Ramp
    from hybridsurrogate.effects.output.saturation import Saturation
    from hybridsurrogate.effects.output.step import Step
    from hybridsurrogate.effects.output.trend import Trend, TrendSinceStart
    from hybridsurrogate.effects.parameters.narrow_prior import NarrowPrior
    from hybridsurrogate.effects.parameters.parameter_by_experiment import ParameterByExperiment
    from hybridsurrogate.effects.parameters.parameter_drift import ParameterDrift
    from hybridsurrogate.effects.parameters.wrong_constant import WrongConstant
    from hybridsurrogate.effects.response.build_up import BuildUp
    from hybridsurrogate.effects.response.gain import Gain
    from hybridsurrogate.effects.response.limit import Limit
    from hybridsurrogate.effects.response.loss import Loss
    from hybridsurrogate.effects.response.second_store import SecondStore
    from hybridsurrogate.effects.response.sensor_response import SensorResponse

__all__ = [
    "SIMULATED",
    "SLOPE",
    "Autocorrelation",
    "BuildUp",
    "Bump",
    "Cause",
    "Context",
    "CurveByExperiment",
    "Decay",
    "Delay",
    "DynamicDelay",
    "DynamicDrift",
    "DynamicTerm",
    "Episode",
    "Friction",
    "Gain",
    "GaussianProcessDiscrepancy",
    "GrossError",
    "InOutput",
    "InputError",
    "Interaction",
    "Limit",
    "Loss",
    "MissingInput",
    "NarrowPrior",
    "Noise",
    "NoiseAtLevel",
    "NoiseOfMean",
    "Offset",
    "Outliers",
    "Overdispersion",
    "ParameterByExperiment",
    "ParameterDrift",
    "Periodic",
    "Ramp",
    "RandomParameter",
    "Remainder",
    "Saturation",
    "SecondStore",
    "SensorResponse",
    "Step",
    "TermByExperiment",
    "Trend",
    "TrendSinceStart",
    "WrongConstant",
]

load()
globals().update(classes())
__all__ += sorted(classes().keys() - set(__all__))
