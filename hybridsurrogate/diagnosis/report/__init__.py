"""The report of a diagnosis: prose, pictures, one HTML page, a dict for machines."""

from hybridsurrogate.diagnosis.report.report import Report, make_report
from hybridsurrogate.diagnosis.report.section import Picture, Section

__all__ = ["Picture", "Report", "Section", "make_report"]
