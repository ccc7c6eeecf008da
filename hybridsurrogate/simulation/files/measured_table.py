"""Measurements from a file: numbers where there must be some, levels for names."""

from __future__ import annotations

import warnings

import numpy as np
import pandas as pd

from hybridsurrogate.exceptions import DiagnosisWarning

# names in a column of text that are taken as levels
_MOST_LEVELS = 6
# ISO 8601: a day, and perhaps a time of it
_DATE = r"\d{4}-\d\d-\d\d([T ].+)?"


def numbers_of(column: pd.Series, file: str, finite: bool = True) -> pd.Series:
    """Return a column as numbers; raise ValueError that says where one is missing.

    ``finite=False``: infinite ones are numbers, too.
    """
    numbers = pd.to_numeric(column, errors="coerce")
    values = numbers.to_numpy(dtype=float)
    wrong = np.flatnonzero(~np.isfinite(values) if finite else np.isnan(values))
    if len(wrong):
        row = int(wrong[0])
        told = "empty or n/a" if pd.isna(column.iloc[row]) else repr(column.iloc[row])
        raise ValueError(
            f"{file}: {len(wrong)} of {len(column)} values of {column.name!r} are no numbers, the "
            f"first, {told}, in row {column.index[row] + 1} of the data. Correct it, or leave "
            "out the row or the column."
        )
    return numbers


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
        told = ", ".join(f"{level} is {code}" for level, code in codes.items())
        print(f"Levels of {name}: {told}.", flush=True)
    return out


def _dates(column: pd.Series) -> pd.Series | None:
    """Return a column of dates such as 2026-11-27 as dates; None for anything else."""
    text = column.astype(str).str.strip()
    if not text.str.fullmatch(_DATE).all():
        return None
    dates = pd.to_datetime(text, format="ISO8601", errors="coerce", utc=True)
    return None if dates.isna().any() else dates
