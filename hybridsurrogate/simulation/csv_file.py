"""Tables of numbers from csv files."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable
from io import StringIO
from pathlib import Path
from typing import Any

import pandas as pd

_OTHER_SEPARATORS = {";": "semicolons", "\t": "tabs"}


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
