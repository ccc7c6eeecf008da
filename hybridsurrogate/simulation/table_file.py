"""Tables of runs and measurements in files: csv, and by the libraries that read them, others."""

from __future__ import annotations

import os
import re
import shutil
import tempfile
import warnings
from collections.abc import Callable, Iterable
from importlib import import_module
from io import StringIO
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit
from urllib.request import urlopen

import numpy as np
import pandas as pd

from hybridsurrogate.arguments import check_flag, check_readable, is_address, local_path
from hybridsurrogate.numerics.atomic_file import written_whole
from hybridsurrogate.simulation.arrays import dates_in

# the column of a long table that says which run a row is of
RUN = "run"
_NETCDF = (".nc", ".nc4", ".cdf")
# schemes that Python fetches itself
_FETCHED = ("http", "https", "ftp")
# characters of what a library or a program says when it fails
MAX_MESSAGE = 300
_SPREADSHEETS = (".xlsx", ".xls", ".xlsm", ".ods")
_OTHER_SEPARATORS = {";": "semicolons", "\t": "tabs"}


def read_table(path: str | os.PathLike[str], allow_urls: bool = False) -> pd.DataFrame:
    """Read a table from a csv, Parquet or NetCDF file, by its ending.

    A NetCDF dataset is laid out long; the dimension that has no coordinate is that of the runs.

    Parameters
    ----------
    path : str or path
    allow_urls : bool, default=False
        Whether an address is fetched, or refused.

    Raises
    ------
    ImportError
        Where the library for the ending is not installed; it says which.
    OSError
        For a file that is not there or a folder.
    ValueError
        For a spreadsheet, which may hold several tables; for a damaged file, and an address that is
        not to be fetched; and as `read_csv`.
    """
    if check_flag(allow_urls, "allow_urls") and is_address(path):
        with tempfile.TemporaryDirectory(prefix="hybridsurrogate-") as folder:
            return read_table(_fetched(str(path), Path(folder)))
    if str(path).lower().endswith(_SPREADSHEETS):
        raise ValueError(
            f"{path} is a spreadsheet: save the sheet as CSV, or read it with pandas.read_excel "
            "and give the table to SimulationData.from_frame, of measurements to fit."
        )
    file = check_readable(path)
    ending = file.suffix.lower()
    if ending == ".parquet":
        return _read_as("Parquet", file, pd.read_parquet)
    if ending in _NETCDF:
        return _read_as("NetCDF", file, _read_netcdf)
    return read_csv(file)


def _read_as(format_name: str, file: Path, read: Callable[[Path], pd.DataFrame]) -> pd.DataFrame:
    """Return what a library reads; ValueError for what it takes for no such file."""
    try:
        return read(file)
    except ImportError:
        raise
    except Exception as error:  # each library, and each version of it, has different classes
        reason = " ".join(str(error).split())[:MAX_MESSAGE]
        raise ValueError(
            f"{file} cannot be read as a {format_name} file: it is damaged, or none "
            f"({type(error).__name__}: {reason})."
        ) from error


def _read_netcdf(file: Path) -> pd.DataFrame:
    import xarray

    with xarray.open_dataset(file) as data:
        runs = [dim for dim in data.dims if dim not in data.coords]
        frame = data.to_dataframe().reset_index()
        if RUN not in frame and len(runs) == 1:
            frame = frame.rename(columns={runs[0]: RUN})
        return frame


def _fetched(address: str, folder: Path) -> Path:
    """Return the file, in a folder, to which an address was fetched."""
    parts = urlsplit(address)
    file = folder / (Path(parts.path).name or "table.csv")
    try:
        with _opened(address, parts.scheme) as source, file.open("wb") as copy:
            shutil.copyfileobj(source, copy)
    except (OSError, ValueError) as error:
        raise OSError(f"{address} cannot be fetched: {error}.") from error
    return file


def _opened(address: str, scheme: str) -> Any:
    if scheme in _FETCHED:
        return urlopen(address, timeout=60.0)
    try:
        fsspec = import_module("fsspec")
    except ImportError:
        raise ImportError(
            f"{address}: addresses of {scheme} need fsspec (pip install fsspec); or fetch the file "
            "first."
        ) from None
    return fsspec.open(address, "rb").open()


def write_table(frame: pd.DataFrame, path: str | os.PathLike[str]) -> None:
    """Write a table to a csv or Parquet file, by its ending; ValueError for another one."""
    file = local_path(path)
    ending = file.suffix.lower()
    if ending not in (".csv", ".parquet"):
        raise ValueError(f"{path}: runs are written to .csv or .parquet files, not to {ending!r}.")
    with written_whole(file) as part:
        if ending == ".csv":
            frame.to_csv(part, index=False, lineterminator="\n")
        else:
            frame.to_parquet(part, index=False)


def read_csv(path: str | os.PathLike[str]) -> pd.DataFrame:
    """Read a file of comma-separated columns; the rest of a line after ``#`` is ignored.

    Where the sign is part of a column's name, only lines that begin with it are ignored.

    Raises
    ------
    ValueError
        Where the columns are separated by something else, as some spreadsheets do; where lines
        have more cells than the header or are broken; where the file is empty or not in UTF-8.
    """
    path = check_readable(path)
    try:
        # the head first: rows with decimal commas break the reader before it reports them
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
        of_runs, of_rows = dates_in(runs[name]), dates_in(measured[name])
        if of_runs is not None and of_rows is not None:
            first, day = of_runs.min(), pd.Timedelta("1D")
            runs = runs.assign(**{name: (of_runs - first) / day})
            measured = measured.assign(**{name: (of_rows - first) / day})
            start = first.date() if first == first.normalize() else first.isoformat()
            print(f"{name} counts days from {start}, the first of the runs.", flush=True)
        elif of_runs is not None or of_rows is not None:
            with_dates, without = files if of_rows is None else files[::-1]
            raise ValueError(
                f"The input {name!r} holds dates in {with_dates}, not in {without}. Write dates in "
                "both files, or numbers in both."
            )
    return runs, measured
