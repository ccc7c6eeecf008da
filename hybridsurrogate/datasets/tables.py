"""The tables that come with the package."""

from __future__ import annotations

from importlib import resources

import pandas as pd


def packaged_table(file: str) -> pd.DataFrame:
    """Return a csv file of the package's folder ``data``, whose head names source and licence.

    Parameters
    ----------
    file : str

    Examples
    --------
    >>> from hybridsurrogate.datasets.tables import packaged_table
    >>> packaged_table("nile_flow.csv").shape
    (100, 2)
    """
    path = resources.files("hybridsurrogate.datasets") / "data" / file
    with path.open(encoding="utf-8") as opened:
        return pd.read_csv(opened, comment="#")
