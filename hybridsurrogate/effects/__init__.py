"""The catalogue of causes: one small file a kind."""

from hybridsurrogate.effects.autocorrelation import Autocorrelation
from hybridsurrogate.effects.base import SIMULATED, Cause, Context
from hybridsurrogate.effects.bump import Bump
from hybridsurrogate.effects.decay import Decay
from hybridsurrogate.effects.delay import Delay
from hybridsurrogate.effects.discrepancy_process import GaussianProcessDiscrepancy
from hybridsurrogate.effects.dynamic_delay import DynamicDelay
from hybridsurrogate.effects.dynamic_drift import DynamicDrift
from hybridsurrogate.effects.dynamic_term import DynamicTerm
from hybridsurrogate.effects.gain import Gain
from hybridsurrogate.effects.interaction import Interaction
from hybridsurrogate.effects.missing_input import MissingInput
from hybridsurrogate.effects.noise import Noise
from hybridsurrogate.effects.noise_of_mean import NoiseOfMean
from hybridsurrogate.effects.offset import Offset
from hybridsurrogate.effects.outliers import Outliers
from hybridsurrogate.effects.parameter_drift import ParameterDrift
from hybridsurrogate.effects.periodic import Periodic
from hybridsurrogate.effects.ramp import Ramp
from hybridsurrogate.effects.saturation import Saturation
from hybridsurrogate.effects.step import Step
from hybridsurrogate.effects.trend import Trend
from hybridsurrogate.effects.wrong_constant import WrongConstant

__all__ = [
    "SIMULATED",
    "Autocorrelation",
    "Bump",
    "Cause",
    "Context",
    "Decay",
    "Delay",
    "DynamicDelay",
    "DynamicDrift",
    "DynamicTerm",
    "Gain",
    "GaussianProcessDiscrepancy",
    "Interaction",
    "MissingInput",
    "Noise",
    "NoiseOfMean",
    "Offset",
    "Outliers",
    "ParameterDrift",
    "Periodic",
    "Ramp",
    "Saturation",
    "Step",
    "Trend",
    "WrongConstant",
]
