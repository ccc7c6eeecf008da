"""The one door for tables, arrays and numbers that a user gives: what holds none stops here.

Of dates come weekday, weekend and month. The days themselves are no column: the simulation's input
says when, and a second axis of time would share the probability of whatever changes in time.

A frame of any library goes on as a pandas DataFrame, so that columns go by name from there on.
"""

from __future__ import annotations

import datetime
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy import sparse
from sklearn.utils import column_or_1d

from hybridsurrogate.arguments import check_number as check_number
from hybridsurrogate.types import FloatArray

# Monday is 1 and Sunday 7 (ISO 8601); January is 1
WEEKDAY, WEEKEND, MONTH = "weekday of ", "weekend of ", "month of "


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
            WEEKEND + name: (days.day_of_week >= 5).astype(float),
            MONTH + name: days.month.astype(float),
        }
        table = table.drop(columns=name).assign(**labels)
    return table


def is_of_calendar(name: str) -> bool:
    """Return whether a column, by its name, holds weekdays or months: labels, not an axis."""
    return name.startswith((WEEKDAY, MONTH))


# dates as text, ISO 8601: a day, and perhaps a time of it
DATE = r"\d{4}-\d\d-\d\d(?:[T ].+)?"

# doubles end at 1e308, and sums of squares are formed of everything
LARGEST = 1e150

_COUNT_DATES = (
    "Count dates from a fixed day, (dates - numpy.datetime64('2020-01-01')) / "
    "numpy.timedelta64(1, 'D'), and durations in a unit, durations / numpy.timedelta64(1, 's')."
)


def as_table(values: Any, word: str = "X") -> Any:
    """Return columns with names as a pandas DataFrame, and all else as an array of floats.

    Parameters
    ----------
    values : DataFrame of any library, or array-like
        A frame has ``columns`` or ``column_names``, and gives a column for a name; a structured
        array has fields.
    word : str
        What to call it in an error.

    Examples
    --------
    >>> as_table(np.array([(1.0, 2.0)], dtype=[("t", float), ("dose", float)])).columns.tolist()
    ['t', 'dose']
    >>> as_table([[1, 2]])
    array([[1., 2.]])
    """
    frame = _frame_of(values, word)
    if frame is None:
        return as_numbers(values, word)
    names = [name for name in frame.columns if isinstance(name, str)]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(
            f"{word} has more than one column {', '.join(map(repr, twice))}: columns go by name, "
            "so rename or drop the copies."
        )
    if any(isinstance(dtype, pd.SparseDtype) for dtype in frame.dtypes):
        raise TypeError(f"{word} has sparse columns: pass frame.sparse.to_dense().")
    return frame


def complete_table(values: Any, word: str = "X", labels: str | None = None) -> Any:
    """As `as_table`; in place of dates, other than in ``labels``, there are weekday and month.

    Raises ValueError, with its name, for a column of numbers or dates in which some are missing.
    """
    table = as_table(values, word)
    if not isinstance(table, pd.DataFrame):
        return table
    dates = {}
    for name in table.columns[~table.dtypes.map(pd.api.types.is_numeric_dtype)]:
        found = None if name == labels else dates_in(table[name])
        if found is not None:
            dates[name] = found
    table = table.assign(**dates)
    _check_complete(table, labels)
    return with_calendar(table, list(dates)) if dates else table


def dates_in(column: pd.Series) -> pd.Series | None:
    """Return a column of dates, or of text such as 2026-11-27, as dates; None for anything else."""
    if pd.api.types.is_datetime64_any_dtype(column):
        return column
    text = column.astype(str).str.strip()
    if not text.str.fullmatch(DATE).all():
        return None
    dates = pd.to_datetime(text, format="ISO8601", errors="coerce", utc=True)
    return None if dates.isna().any() else dates


def _frame_of(values: Any, word: str) -> pd.DataFrame | None:
    """Return a frame with the columns that go by name; None where there are none."""
    if isinstance(values, pd.DataFrame):
        return values
    if type(values) is np.ndarray and not values.dtype.names:
        return None
    if getattr(getattr(values, "dtype", None), "names", None):
        _check_masks(values, word)
        return pd.DataFrame({name: np.asarray(values[name]) for name in values.dtype.names})
    kind = type(values)
    # a lazy frame warns of being asked for its columns
    lazy = next((way for way in ("collect", "compute") if hasattr(kind, way)), None)
    if lazy and hasattr(kind, "columns"):
        raise TypeError(f"{word} is a {kind.__name__}, not computed yet: pass frame.{lazy}().")
    names = getattr(values, "column_names", None)
    names = getattr(values, "columns", None) if names is None else names
    if names is None:
        return None
    # not at once from a dict, which would hide columns of the same name
    columns = [pd.Series(np.asarray(values[name])) for name in names]
    return pd.DataFrame(dict(enumerate(columns))).set_axis(list(names), axis=1)


def as_numbers(values: Any, word: str) -> FloatArray:
    """Return a copy as floats; what is missing is NaN.

    Raises
    ------
    ValueError, TypeError
        For values that are masked, dates, complex, sparse or no numbers.

    Examples
    --------
    >>> as_numbers([1, None, "2.5"], "y")
    array([1. , nan, 2.5])
    """
    # most calls of a simulation: thousands in a search
    if type(values) is np.ndarray and values.dtype == np.float64:
        return values.copy()
    if isinstance(values, np.memmap) and values.dtype == np.float64:
        # what does not fit into memory is not copied into it
        return values.view(np.ndarray)
    _check_masks(values, word)
    if sparse.issparse(values):
        raise TypeError(f"{word} is sparse, but dense data is required: pass {word}.toarray().")
    if isinstance(values, pd.DataFrame):
        check_columns(values)
    try:
        array = np.asarray(values)
    except ValueError as error:  # lists of unequal length
        raise ValueError(f"{word} must hold numbers: {error}.") from error
    kinds = {array.dtype.kind}
    if kinds == {"O"}:
        array = np.where(pd.isna(array), np.nan, array)
        dates = (datetime.date, datetime.timedelta, np.datetime64, np.timedelta64)
        kinds |= {"M" for value in array.flat if isinstance(value, dates)}
        kinds |= {"c" for value in array.flat if isinstance(value, complex)}
    if kinds & {"M", "m"}:
        raise ValueError(f"{word} holds dates or durations, not numbers. {_COUNT_DATES}")
    if "c" in kinds:
        raise ValueError(f"Complex data not supported: {word} must be real.")
    try:
        return np.array(array, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        # scikit-learn distinguishes an object that is no number from a text by the class
        raise (TypeError if isinstance(error, TypeError) else ValueError)(
            f"{word} must hold numbers: {error}."
        ) from error


def _check_masks(values: Any, word: str) -> None:
    parts = values if isinstance(values, list | tuple) else [values]
    if any(isinstance(part, np.ma.MaskedArray) and np.ma.is_masked(part) for part in parts):
        raise ValueError(
            f"Some values of {word} are masked. Leave out their rows, in X and y alike, or, of "
            "runs that failed, fill them, values.filled(numpy.nan)."
        )


def check_columns(frame: pd.DataFrame) -> None:
    """Raise ValueError that names columns of a DataFrame which hold names or dates."""
    wrong = [name for name, column in frame.items() if not is_numeric(column)]
    if wrong:
        values = frame[wrong[0]]
        row = int(np.argmax(pd.to_numeric(values, errors="coerce").isna()))
        raise ValueError(
            f"The columns {wrong} hold no numbers: row {row + 1} of {wrong[0]!r} is "
            f"{values.iloc[row]!r}. Correct it; number levels such as a batch, "
            "X[name].map({'A': 0, 'B': 1}); of dates written as text make an axis, "
            "(pandas.to_datetime(X[name]) - pandas.Timestamp('2020-01-01')) / "
            "pandas.Timedelta('1D'); or leave them out."
        )


def _check_complete(frame: pd.DataFrame, labels: str | None) -> None:
    """Raise ValueError that names the first column with missing numbers, dates or ``labels``."""
    for name, column in frame.items():
        missing = np.flatnonzero(column.isna())
        date = pd.api.types.is_datetime64_any_dtype(column)
        if len(missing) and (name == labels or date or is_numeric(column)):
            raise ValueError(
                f"{len(missing)} of {len(column)} values of the column {name!r} are missing (NaN), "
                f"the first in row {missing[0] + 1}. Leave out the rows, "
                f"rows = X[{name!r}].notna(), X[rows] and y[rows], or the column."
            )


def is_numeric(column: pd.Series) -> bool:
    """Whether a column holds numbers, however they are stored."""
    if pd.api.types.is_complex_dtype(column):
        return False
    if pd.api.types.is_numeric_dtype(column):
        return True
    try:  # numbers may be stored as objects, text or categories
        as_numbers(column, "")
    except (TypeError, ValueError):
        return False
    return True


def as_outputs(y: ArrayLike, word: str = "y", gaps: bool = False) -> FloatArray:
    """Return measured outputs (n,), all of them finite and within what can be squared.

    ``gaps=True``: or NaN, for what was not measured.
    """
    values = column_or_1d(as_numbers(y, word))
    if gaps and len(values) and np.isnan(values).all():
        raise ValueError(f"Input {word} contains NaN alone: no row has a measurement.")
    if not (np.isfinite(values) | (gaps & np.isnan(values))).all():
        what = "NaN" if not gaps and np.isnan(values).any() else "infinity"
        rows = np.flatnonzero(~np.isfinite(values))
        raise ValueError(
            f"Input {word} contains {what}: {len(rows)} of {len(values)} values, the first in row "
            f"{rows[0] + 1}. Leave out these rows, in X and {word} alike."
        )
    check_size(values, word)
    return values


def check_size(values: FloatArray, word: str) -> None:
    """Raise ValueError for finite numbers whose squares doubles cannot hold."""
    size = np.max(np.abs(values), initial=0.0, where=np.isfinite(values))
    if size > LARGEST:
        raise ValueError(
            f"{word} has values as large as {size:g}: above {LARGEST:g} their squares "
            "overflow. Leave out what has diverged, or choose another unit."
        )


def check_spread(values: FloatArray, word: str) -> None:
    """Raise ValueError for training values, or columns of them, that are too large or too small."""
    check_size(values, word)
    for column in np.atleast_2d(values.T):
        spread = (np.ptp(column) or np.max(np.abs(column))) if len(column) else 0.0
        if 0 < spread < 1 / LARGEST:
            raise ValueError(
                f"{word} has values that differ by no more than {spread:g}, or are as small: below "
                f"{1 / LARGEST:g} their squares are zero. Choose another unit."
            )


def is_whole(values: FloatArray) -> bool:
    """Return whether all values are whole numbers.

    Examples
    --------
    >>> is_whole(np.array([0.0, 3.0])), is_whole(np.array([0.0, 2.5]))
    (True, False)
    """
    return bool(np.all(values == np.round(values)))
