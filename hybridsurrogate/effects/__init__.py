"""The catalogue of causes: one small file a kind."""

from hybridsurrogate.effects.base import Cause, Context
from hybridsurrogate.effects.bump import Bump
from hybridsurrogate.effects.discrepancy_process import GaussianProcessDiscrepancy
from hybridsurrogate.effects.gain import Gain
from hybridsurrogate.effects.missing_input import MissingInput
from hybridsurrogate.effects.offset import Offset
from hybridsurrogate.effects.parameter_drift import ParameterDrift
from hybridsurrogate.effects.periodic import Periodic
from hybridsurrogate.effects.step import Step
from hybridsurrogate.effects.trend import Trend
from hybridsurrogate.effects.wrong_constant import WrongConstant

__all__ = [
    "Bump",
    "Cause",
    "Context",
    "Gain",
    "GaussianProcessDiscrepancy",
    "MissingInput",
    "Offset",
    "ParameterDrift",
    "Periodic",
    "Step",
    "Trend",
    "WrongConstant",
]
