"""The report of a diagnosis.

report (text, HTML, JSON), html, text and summary (how it is written); headline and cards
(what a reader sees first); rooms: details (the folded sections), elements (what both are made of).
"""

from hybridsurrogate.diagnosis.report.report import Report, make_report

__all__ = ["Report", "make_report"]
