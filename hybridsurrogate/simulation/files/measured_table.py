"""Measurements from a file: numbers where there must be some, levels for names."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable

import numpy as np
import pandas as pd

from hybridsurrogate.exceptions import DiagnosisWarning
from hybridsurrogate.simulation.files.table_file import DATE

# names in a column of text that are taken as levels
_MOST_LEVELS = 6
# a day in another form than that of ISO 8601
_ANOTHER_DATE = re.compile(r"\d{1,4}[./-]\d{1,2}[./-]\d{1,4}\b.*")


def numbers_of(column: pd.Series, file: str, finite: bool = True) -> pd.Series:
    """Return a column as numbers; raise ValueError that says where one is missing.

    ``finite=False``: infinite ones are numbers, too.
    """
    numbers = pd.to_numeric(column, errors="coerce")
    values = numbers.to_numpy(dtype=float)
    wrong = np.flatnonzero(~np.isfinite(values) if finite else np.isnan(values))
    if len(wrong):
        row = int(wrong[0])
        value = "empty or n/a" if pd.isna(column.iloc[row]) else repr(column.iloc[row])
        another_form = _ANOTHER_DATE.fullmatch(str(column.iloc[row]).strip())
        cure = " Write dates as 2026-11-27." if another_form else ""
        raise ValueError(
            f"{file}: {len(wrong)} of {len(column)} values of {column.name!r} are no numbers, the "
            f"first, {value}, in row {column.index[row] + 1} of the data. Correct it, or leave "
            f"out the row or the column.{cure}"
        )
    return numbers


def with_days(
    runs: pd.DataFrame, measured: pd.DataFrame, inputs: Iterable[str], files: tuple[str, str]
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return runs and measurements with inputs that hold dates in days from that of the first run.

    Parameters
    ----------
    runs, measured : DataFrame
    inputs : iterable of str
    files : tuple of str
        What to call the two in an error.

    Raises
    ------
    ValueError
        Where one of the tables alone has dates.

    Examples
    --------
    >>> runs = pd.DataFrame({"date": ["2026-11-27", "2026-11-29"]})
    >>> measured = pd.DataFrame({"date": ["2026-11-28T12:00"]})
    >>> with_days(runs, measured, ["date"], ("runs.csv", "measured.csv"))[1]
    date counts days from 2026-11-27, the first of the runs.
       date
    0   1.5
    """
    for name in inputs:
        if not (name in runs and name in measured):
            continue
        of_runs, of_rows = _dates(runs[name]), _dates(measured[name])
        if of_runs is not None and of_rows is not None:
            first, day = of_runs.min(), pd.Timedelta("1D")
            runs = runs.assign(**{name: (of_runs - first) / day})
            measured = measured.assign(**{name: (of_rows - first) / day})
            print(f"{name} counts days from {_day(first)}, the first of the runs.", flush=True)
        elif of_runs is not None or of_rows is not None:
            with_dates, without = files if of_rows is None else files[::-1]
            raise ValueError(
                f"The input {name!r} holds dates in {with_dates}, not in {without}. Write dates in "
                "both files, or numbers in both."
            )
    return runs, measured


def _day(date: pd.Timestamp) -> str:
    return str(date.date()) if date == date.normalize() else str(date.isoformat())


def with_levels(measured: pd.DataFrame) -> pd.DataFrame:
    """Return the columns of numbers, dates, and those of a few names as levels 0, 1, 2, ..."""
    out = measured.copy()
    for name in measured.columns.difference(measured.select_dtypes("number").columns, sort=False):
        dates = _dates(measured[name])
        if dates is not None:
            out[name] = dates
            continue
        known = sorted(measured[name].dropna().astype(str).unique())
        if measured[name].isna().any() or not 2 <= len(known) <= _MOST_LEVELS:
            warnings.warn(
                f"The column {name!r} is left out: it holds neither numbers nor 2 to "
                f"{_MOST_LEVELS} names, one in each row.",
                DiagnosisWarning,
                stacklevel=2,
            )
            out = out.drop(columns=name)
            continue
        codes = {level: code for code, level in enumerate(known)}
        out[name] = measured[name].astype(str).map(codes).astype(float)
        levels = ", ".join(f"{level} is {code}" for level, code in codes.items())
        print(f"Levels of {name}: {levels}.", flush=True)
    return out


def _dates(column: pd.Series) -> pd.Series | None:
    """Return a column of dates such as 2026-11-27 as dates; None for anything else."""
    text = column.astype(str).str.strip()
    if not text.str.fullmatch(DATE).all():
        return None
    dates = pd.to_datetime(text, format="ISO8601", errors="coerce", utc=True)
    return None if dates.isna().any() else dates
