"""Tables of runs and measurements in files: csv, and by the libraries that read them, others."""

from __future__ import annotations

import os
import shutil
import tempfile
import warnings
from collections.abc import Callable
from importlib import import_module
from io import StringIO
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit
from urllib.request import urlopen

import pandas as pd

from hybridsurrogate.arguments.paths import check_readable, is_address, local_path
from hybridsurrogate.arguments.scalars import check_flag
from hybridsurrogate.numerics.atomic_file import written_whole

# the column of a long table that says which run a row is of
RUN = "run"
# dates as text, ISO 8601: a day, and perhaps a time of it
DATE = r"\d{4}-\d\d-\d\d(?:[T ].+)?"
_NETCDF = (".nc", ".nc4", ".cdf")
# schemes that Python fetches itself
_FETCHED = ("http", "https", "ftp")
# seconds without an answer
_PATIENCE = 60.0
# of what a library says
_LONGEST = 200
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
        reason = " ".join(str(error).split())[:_LONGEST]
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
        return urlopen(address, timeout=_PATIENCE)
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
