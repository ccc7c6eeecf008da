"""Tables of runs and measurements in files: csv, and by the libraries that read them, others."""

from __future__ import annotations

import os
from pathlib import Path

import pandas as pd

from hybridsurrogate.simulation.csv_file import read_csv
from hybridsurrogate.simulation.curve_tables import RUN

_NETCDF = (".nc", ".nc4", ".cdf")


def read_table(path: str | os.PathLike[str]) -> pd.DataFrame:
    """Read a table from a csv, Parquet or NetCDF file, by its ending.

    A NetCDF dataset is laid out long; the dimension that has no coordinate is that of the runs.

    Raises
    ------
    ImportError
        Where the library for the ending is not installed; it says which.
    ValueError
        As `read_csv`.
    """
    ending = Path(path).suffix.lower()
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
