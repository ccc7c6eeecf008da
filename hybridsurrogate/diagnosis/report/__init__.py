"""The report of a diagnosis: prose, pictures, one HTML page, a dict for machines.

view      the diagnosis as a report sees it
findings  verdict, cause and doubts in sentences
rivals    what else could explain it, and the next step
scores    gains
trust     the weight of the simulation
tables    tables
pictures  pictures
section   what a report is made of
html      as one page
summary   as a dict
report    all of it
"""

from hybridsurrogate.diagnosis.report.report import Report, make_report
from hybridsurrogate.diagnosis.report.section import Picture, Section

__all__ = ["Picture", "Report", "Section", "make_report"]
