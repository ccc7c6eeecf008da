"""The report of a diagnosis.

report (text, HTML, JSON), html, mathml, text and summary (how it is written); rooms: first_screen
(what a reader sees first), details (the folded sections), elements (what both are made of).
"""

from hybridsurrogate.diagnosis.report.report import Report, make_report

__all__ = ["Report", "make_report"]
