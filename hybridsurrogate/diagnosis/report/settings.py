"""What a report tells and draws: one place for its numbers."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ReportSettings:
    """Numbers of the report.

    Attributes
    ----------
    told_remainder : float
        Probability of a remainder from which on it is told.
    most_notes : int
        Causes whose failing runs are told one by one; the table of causes has all of them.
    little_information : float
        Expected information in bits below which one more measurement is hardly worth it.
    settled : float
        Probability from which on a question needs no further measurement.
    most_rivals, most_causes : int
        Rivals in the text, and causes in the picture, at most.
    worth_drawing : float
        Probability from which a cause is drawn.
    as_probable : float
        A form of the same kind with more than this share of the cause's probability may be it as
        well.
    bins, few_levels : int
        Bins of residuals; a column of at most so many values is told value by value.
    log_axis_decades : float
        A range so wide that small outputs would be a flat line.
    """

    told_remainder: float = 0.5
    most_notes: int = 3
    little_information: float = 0.07
    settled: float = 0.95
    most_rivals: int = 4
    most_causes: int = 8
    worth_drawing: float = 0.005
    as_probable: float = 0.25
    bins: int = 5
    few_levels: int = 12
    log_axis_decades: float = 1.5


SETTINGS = ReportSettings()
