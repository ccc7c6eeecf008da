"""One place for the numbers of a report."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ReportSettings:
    """Numbers of the report.

    Attributes
    ----------
    smooth_curve_said : float
        Probability of a smooth curve in addition to the causes from which on it is reported.
    most_notes : int
        Causes whose failing runs are reported one by one; the table of causes has all of them.
    little_information : float
        Expected information in bits below which one more measurement is hardly worth it.
    decided : float
        Probability from which on a question needs no further measurement.
    most_alternatives, most_causes : int
        Alternatives in the text, and causes in the picture, at most.
    worth_drawing : float
        Probability from which a cause is drawn.
    as_probable : float
        A form of the same kind with more than this share of the cause's probability may be it as
        well.
    bins, few_levels : int
        Bins of residuals; a column of at most so many values is drawn value by value.
    log_axis_decades : float
        A range so wide that small outputs would be a flat line.
    most_periods : int
        Periods of a cycle in the first picture, at most; more would be a block of colour.
    """

    smooth_curve_said: float = 0.5
    most_notes: int = 3
    little_information: float = 0.07
    decided: float = 0.95
    most_alternatives: int = 4
    most_causes: int = 8
    worth_drawing: float = 0.005
    as_probable: float = 0.25
    bins: int = 5
    few_levels: int = 12
    log_axis_decades: float = 1.5
    most_periods: int = 15


SETTINGS = ReportSettings()
