"""A fitted diagnosis as it is stored: its tables as plain arrays, which skops takes as well.

skops stores numpy arrays and objects of plain values, but no table of pandas.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray


@dataclass(frozen=True)
class StoredColumn:
    """One column: its values, or the codes of a categorical one, and the type to restore.

    Attributes
    ----------
    values : ndarray of shape (n,)
    dtype : str
        Its name in pandas.
    categories : ndarray or None
        What codes stand for.
    ordered : bool
        Whether categories have an order.
    """

    values: NDArray[Any]
    dtype: str
    categories: NDArray[Any] | None = None
    ordered: bool = False


@dataclass(frozen=True)
class StoredTable:
    """A table of pandas as arrays.

    Attributes
    ----------
    names : list
        Of the columns.
    columns : list of StoredColumn
    index : ndarray of shape (n,)
    """

    names: list[Any]
    columns: list[StoredColumn]
    index: NDArray[Any]


def stored(value: Any) -> Any:
    """Return a value whose tables, however deep in records and lists, are plain arrays.

    Parameters
    ----------
    value : Any

    Examples
    --------
    >>> import pandas as pd
    >>> table = pd.DataFrame({"kind": ["offset", "none"], "probability": [0.9, 0.1]})
    >>> bool((restored(stored({"causes_": table}))["causes_"] == table).all().all())
    True
    """
    return _changed(value, _to_arrays, {})


def restored(value: Any) -> Any:
    """Return a value that was `stored` with its tables.

    Parameters
    ----------
    value : Any
    """
    return _changed(value, _to_table, {})


def _changed(value: Any, change: Callable[[Any], Any], done: dict[int, Any]) -> Any:
    """Return a value with all in it changed that ``change`` makes something else of.

    What is shared stays shared, and what contains nothing to change stays the same object.
    """
    if id(value) in done:
        return done[id(value)]
    out = change(value)
    if out is not value:
        pass
    elif type(value) is dict:
        new = {key: _changed(item, change, done) for key, item in value.items()}
        out = new if any(new[key] is not value[key] for key in value) else value
    elif type(value) in (list, tuple):
        items = [_changed(item, change, done) for item in value]
        same = all(a is b for a, b in zip(items, value, strict=True))
        out = value if same else type(value)(items)
    elif is_dataclass(value) and not isinstance(value, type | StoredTable | StoredColumn):
        held = {f.name: getattr(value, f.name) for f in fields(value) if f.init}
        fresh = {name: _changed(item, change, done) for name, item in held.items()}
        fresh = {name: item for name, item in fresh.items() if item is not held[name]}
        out = replace(value, **fresh) if fresh else value
    done[id(value)] = out
    return out


def _to_arrays(value: Any) -> Any:
    if isinstance(value, pd.DataFrame):
        columns = [_column(value.iloc[:, k]) for k in range(value.shape[1])]
        return StoredTable(list(value.columns), columns, value.index.to_numpy())
    if isinstance(value, pd.Series):
        return StoredTable([], [_column(value)], value.index.to_numpy())
    return value


def _to_table(value: Any) -> Any:
    if not isinstance(value, StoredTable):
        return value
    series = [_series(column, value.index) for column in value.columns]
    if not value.names:
        return series[0]
    table = pd.concat(series, axis=1)
    table.columns = pd.Index(value.names)
    return table


def _column(series: pd.Series) -> StoredColumn:
    if isinstance(series.dtype, pd.CategoricalDtype):
        codes, categories = series.cat.codes.to_numpy(), series.cat.categories.to_numpy()
        return StoredColumn(codes, "category", np.asarray(categories), bool(series.cat.ordered))
    return StoredColumn(series.to_numpy(), str(series.dtype))


def _series(column: StoredColumn, index: NDArray[Any]) -> pd.Series:
    if column.categories is not None:
        codes = pd.Categorical.from_codes(
            column.values, categories=pd.Index(column.categories), ordered=column.ordered
        )
        return pd.Series(codes, index=index)
    return pd.Series(column.values, index=index).astype(column.dtype)
