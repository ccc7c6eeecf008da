"""Tables of numbers from csv files."""

from __future__ import annotations

import os

import pandas as pd

_OTHER_SEPARATORS = {";": "semicolons", "\t": "tabs"}


def read_csv(path: str | os.PathLike[str]) -> pd.DataFrame:
    """Read a file of comma-separated columns; the rest of a line after ``#`` is ignored.

    Raises
    ------
    ValueError
        Where the columns are separated by something else, as some spreadsheets do.
    """
    # the head first: rows with decimal commas break the reader before it can tell
    head = pd.read_csv(path, comment="#", nrows=0).columns
    for separator, word in _OTHER_SEPARATORS.items():
        if len(head) == 1 and separator in head[0]:
            raise ValueError(
                f"{path}: the columns are separated by {word}. Write commas, and points in "
                f"decimals: pandas.read_csv(path, sep={separator!r}, decimal=',')"
                ".to_csv(path, index=False) does so."
            )
    return pd.read_csv(path, comment="#", skipinitialspace=True)
