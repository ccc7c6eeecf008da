"""Tables of runs and measurements in files: csv, and by the libraries that read them, others."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable
from io import StringIO
from pathlib import Path
from typing import Any

import pandas as pd

# the column of a long table that says which run a row is of
RUN = "run"
# dates as text, ISO 8601: a day, and perhaps a time of it
DATE = r"\d{4}-\d\d-\d\d(?:[T ].+)?"
_NETCDF = (".nc", ".nc4", ".cdf")
_SPREADSHEETS = (".xlsx", ".xls", ".xlsm", ".ods")
_OTHER_SEPARATORS = {";": "semicolons", "\t": "tabs"}


def read_table(path: str | os.PathLike[str]) -> pd.DataFrame:
    """Read a table from a csv, Parquet or NetCDF file, by its ending.

    A NetCDF dataset is laid out long; the dimension that has no coordinate is that of the runs.

    Raises
    ------
    ImportError
        Where the library for the ending is not installed; it says which.
    ValueError
        For a spreadsheet, which may hold several tables; and as `read_csv`.
    """
    ending = Path(path).suffix.lower()
    if ending in _SPREADSHEETS:
        raise ValueError(
            f"{path} is a spreadsheet: save the sheet as CSV, or read it with pandas.read_excel "
            "and give the table to SimulationData.from_frame, of measurements to fit."
        )
    if ending == ".parquet":
        return pd.read_parquet(path)
    if ending not in _NETCDF:
        return read_csv(path)
    import xarray

    with xarray.open_dataset(path) as data:
        runs = [dim for dim in data.dims if dim not in data.coords]
        frame = data.to_dataframe().reset_index()
        if RUN not in frame and len(runs) == 1:
            frame = frame.rename(columns={runs[0]: RUN})
        return frame


def write_table(frame: pd.DataFrame, path: str | os.PathLike[str]) -> None:
    """Write a table to a csv or Parquet file, by its ending; ValueError for another one."""
    ending = Path(path).suffix.lower()
    if ending == ".csv":
        frame.to_csv(path, index=False, lineterminator="\n")
    elif ending == ".parquet":
        frame.to_parquet(path, index=False)
    else:
        raise ValueError(f"{path}: runs are written to .csv or .parquet files, not to {ending!r}.")


def read_csv(path: str | os.PathLike[str]) -> pd.DataFrame:
    """Read a file of comma-separated columns; the rest of a line after ``#`` is ignored.

    Where the sign is part of a column's name, only lines that begin with it are ignored.

    Raises
    ------
    ValueError
        Where the columns are separated by something else, as some spreadsheets do; where lines
        have more cells than the header or are broken; where the file is empty or not in UTF-8.
    """
    try:
        # the head first: rows with decimal commas break the reader before it can tell
        head = pd.read_csv(path, comment="#", nrows=0).columns
        for separator, word in _OTHER_SEPARATORS.items():
            if len(head) == 1 and separator in head[0]:
                raise ValueError(
                    f"{path}: the columns are separated by {word}. Write commas, and points in "
                    f"decimals: pandas.read_csv(path, sep={separator!r}, decimal=',')"
                    ".to_csv(path, index=False) does so."
                )
        table = _table(lambda: path, comment="#")
        if table is None:
            text = Path(path).read_text(encoding="utf-8")
            lines = [k for k in text.splitlines() if not k.lstrip().startswith("#")]
            table = _table(lambda: StringIO("\n".join(lines)))
    except pd.errors.EmptyDataError:
        raise ValueError(f"{path}: the file is empty, there are no columns.") from None
    except pd.errors.ParserError as error:
        raise ValueError(f"{path}: {str(error).strip()}.") from None
    except UnicodeError as error:
        raise ValueError(f"{path}: the file is not in UTF-8 ({error}). Save it as UTF-8.") from None
    if table is None:
        raise ValueError(
            f"{path}: lines have more cells than the header. Name every column, or leave out the "
            "cells without a name."
        )
    return table.rename(columns=str.strip)


def _table(source: Callable[[], Any], **settings: Any) -> pd.DataFrame | None:
    """Return a table, None where lines are longer than the header by more than empty cells."""
    settings["skipinitialspace"] = True
    with warnings.catch_warnings():
        warnings.simplefilter("error", pd.errors.ParserWarning)
        try:
            return pd.read_csv(source(), index_col=False, **settings)
        except pd.errors.ParserWarning:
            pass
    # pandas takes what comes first for an index, and the last columns for those with a name
    shifted = pd.read_csv(source(), **settings)
    extra = shifted.index.nlevels
    if not shifted.iloc[:, -extra:].isna().all(axis=None):
        return None
    whole = shifted.reset_index().iloc[:, : shifted.shape[1]]
    return whole.set_axis(shifted.columns, axis=1)
