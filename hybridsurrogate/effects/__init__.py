"""The catalogue of causes: one small file a group."""

from .base import Cause, Context
from .discrepancy_process import GaussianProcessDiscrepancy
from .shapes import Bump, MissingInput, Offset, Periodic, Step, Trend
from .simulation_faults import Gain, ParameterDrift, WrongConstant

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
