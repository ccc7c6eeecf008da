"""What the simulation gets wrong: search, verdict, extension, gain, report."""

from hybridsurrogate.diagnosis.diagnosis import DiscrepancyDiagnosis
from hybridsurrogate.diagnosis.finding import CauseFinding

__all__ = ["CauseFinding", "DiscrepancyDiagnosis"]
