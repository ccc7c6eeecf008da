"""The catalogue of causes: one small file a group."""

from hybridsurrogate.effects.base import Cause, Context
from hybridsurrogate.effects.discrepancy_process import GaussianProcessDiscrepancy
from hybridsurrogate.effects.dynamics import DynamicDrift, DynamicTerm
from hybridsurrogate.effects.shapes import Bump, MissingInput, Offset, Periodic, Step, Trend
from hybridsurrogate.effects.simulation_faults import Gain, ParameterDrift, WrongConstant

__all__ = [
    "Bump",
    "Cause",
    "Context",
    "DynamicDrift",
    "DynamicTerm",
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
