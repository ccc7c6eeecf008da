"""What the simulation gets wrong: search, verdict, extension, gain, report."""

from hybridsurrogate.diagnosis.diagnosis import CauseFinding, DiscrepancyDiagnosis

__all__ = ["CauseFinding", "DiscrepancyDiagnosis"]
