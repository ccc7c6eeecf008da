"""What a column of dates stands for: weekday, weekend and month, in numbers.

The days themselves are no column: the simulation's input says when, and a second axis of time would
share the probability of whatever changes in time.
"""

from __future__ import annotations

import pandas as pd

# Monday is 1 and Sunday 7 (ISO 8601); January is 1
WEEKDAY, WEEKEND, MONTH = "weekday of ", "weekend of ", "month of "
_SATURDAY = 6


def dates_of(table: pd.DataFrame) -> list[str]:
    """Return the columns that hold dates."""
    kinds = table.dtypes.items()
    return [str(name) for name, kind in kinds if pd.api.types.is_datetime64_any_dtype(kind)]


def with_calendar(table: pd.DataFrame, dates: list[str]) -> pd.DataFrame:
    """Return a table with weekday, weekend and month in place of columns of dates, at its end.

    Examples
    --------
    >>> days = pd.date_range("2026-11-27", periods=3)
    >>> with_calendar(pd.DataFrame({"t": [0.0, 1.0, 2.0], "day": days}), ["day"]).iloc[:, 1:]
       weekday of day  weekend of day  month of day
    0             5.0             0.0          11.0
    1             6.0             1.0          11.0
    2             7.0             1.0          11.0
    """
    for name in dates:
        days = table[name].dt
        weekday = (days.day_of_week + 1).astype(float)
        labels = {
            WEEKDAY + name: weekday,
            WEEKEND + name: (weekday >= _SATURDAY).astype(float),
            MONTH + name: days.month.astype(float),
        }
        table = table.drop(columns=name).assign(**labels)
    return table


def is_of_calendar(name: str) -> bool:
    """Return whether a column, by its name, holds weekdays or months: labels, not an axis."""
    return name.startswith((WEEKDAY, MONTH))
