"""Runs that are curves, in the forms in which they lie on disks: one row for each run and place."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from hybridsurrogate.arguments import described
from hybridsurrogate.exceptions import DiagnosisWarning, FailedRunsWarning, did_you_mean
from hybridsurrogate.simulation.arrays import DATE, as_numbers, as_table
from hybridsurrogate.simulation.outputs import by_output
from hybridsurrogate.simulation.table_file import RUN
from hybridsurrogate.simulation.variables import as_matrix, select_columns

# of the places of a wide table
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"


def curve_rows(
    omega: Any,
    Y: Any,
    along: str | Mapping[str, ArrayLike],
    names: Sequence[str],
    outputs: Sequence[str],
) -> pd.DataFrame:
    """Return runs as a long table: columns of the run, the places, ``names`` and the outputs.

    Parameters
    ----------
    omega : array-like of shape (n_runs, len(names)), DataFrame or xarray.Dataset
    Y : array-like of shape (n_runs, n_places), with a last axis of several outputs; dict of these;
        wide or long DataFrame; None with a Dataset
    along : dict of name to places (n_places,) or (n_runs, n_places), or a name
    names : sequence of str
        What each run has one value of.
    outputs : sequence of str

    Raises
    ------
    ValueError, TypeError
        Where the parts do not fit together; the message says what to do.
    """
    name = name_of_curves(along)
    if Y is None:
        return _of_dataset(omega, name, names, outputs)
    table = by_output(Y, outputs, "Y") if isinstance(Y, Mapping) else as_table(Y, "Y")
    if isinstance(table, pd.DataFrame) and (omega is None or RUN in table.columns):
        _warn_of_unnamed(table, name, names, outputs)
        table = long_table(table, [name], outputs)
    if isinstance(table, pd.DataFrame) and RUN in table.columns:
        return _of_long(omega, table, name, names, outputs)
    points = as_matrix(omega, "omega", tuple(names))
    if isinstance(table, pd.DataFrame) and isinstance(along, str):
        labels = [*_places(table, name, outputs[0]).values()]
        along = {name: labels}
        if len(labels) < table.shape[1]:
            raise ValueError(
                f"The columns of Y must be the places along a run, numbers, got "
                f"{', '.join(map(str, table.columns[:5]))}. A long table has a column {RUN!r}."
            )
    curves = as_numbers(table, "Y")
    several = len(outputs) > 1
    if curves.ndim != 2 + several or len(curves) != len(points):
        wanted = "(n_runs, n_places, n_outputs)" if several else "(n_runs, n_places)"
        raise ValueError(
            f"Y must have shape {wanted} with one row for each of the {len(points)} runs in omega, "
            f"got {curves.shape}; output names {', '.join(outputs)}."
        )
    if several and curves.shape[2] != len(outputs):
        raise ValueError(
            f"Y has {curves.shape[2]} outputs, but output names {len(outputs)}: "
            f"{', '.join(outputs)}."
        )
    if isinstance(along, str):
        raise ValueError(
            f"along={along!r} names the input along which runs are curves; give its values, too: "
            f"along={{{along!r}: places}} of shape (n_places,) or (n_runs, n_places)."
        )
    places = as_numbers(along[name], f"along[{name!r}]")
    shape = curves.shape[:2]
    if places.shape not in (shape, shape[1:]):
        raise ValueError(
            f"along[{name!r}] must have shape {shape[1:]} or {shape}, as Y has, got {places.shape}."
        )
    run = np.repeat(np.arange(len(points)), curves.shape[1])
    table = pd.DataFrame(points[run], columns=list(names))
    table.insert(0, name, np.broadcast_to(places, shape).ravel())
    table.insert(0, RUN, run)
    table[list(outputs)] = curves.reshape(len(table), -1)
    return without_missing(table, name, outputs)


def wide_along(table: pd.DataFrame, inputs: Iterable[str], outputs: Sequence[str]) -> str | None:
    """Return the input whose values are column labels of a wide table; None for any other table.

    Such a table lacks columns of that input and of its one output.
    """
    missing = [name for name in inputs if name not in table.columns]
    if len(missing) != 1 or len(outputs) != 1 or outputs[0] in table.columns:
        return None
    return missing[0] if len(_places(table, missing[0], outputs[0])) > 1 else None


def long_table(table: pd.DataFrame, inputs: Iterable[str], outputs: Sequence[str]) -> pd.DataFrame:
    """Return a wide table of runs with a row for each run and place, any other table as it is.

    Examples
    --------
    >>> wide = pd.DataFrame({"rate": [0.1, 0.2], "0": [1.0, 1.0], "5": [0.6, 0.4]})
    >>> long_table(wide, ["t"], ["y"])
       rate  run    t    y
    0   0.1    0  0.0  1.0
    1   0.1    0  5.0  0.6
    2   0.2    1  0.0  1.0
    3   0.2    1  5.0  0.4
    """
    along = wide_along(table, inputs, outputs)
    if along is None:
        return table
    places = _places(table, along, outputs[0])
    table = table.reset_index(drop=True)
    if RUN not in table.columns:
        table = table.assign(**{RUN: table.index})
    rest = [label for label in table.columns if label not in places]
    long = table.melt(rest, list(places), along, outputs[0], ignore_index=False)
    long[along] = long[along].map(places)
    return long.sort_index(kind="stable", ignore_index=True)


def _places(table: pd.DataFrame, along: str, output: str) -> dict[Any, Any]:
    """Return the column labels that are values of an input: 0.5, t=0.5, y_0.5 or dates."""
    prefix = rf"(?:(?:{re.escape(along)}|{re.escape(output)})[ _=:]*)?"
    form = re.compile(rf"{prefix}({_NUMBER}|{DATE})")
    found = {label: form.fullmatch(str(label).strip()) for label in table.columns}
    texts = {label: match[1] for label, match in found.items() if match}
    dates = {label: text for label, text in texts.items() if re.fullmatch(DATE, text)}
    return dates or {label: float(text) for label, text in texts.items()}


def _warn_of_unnamed(
    table: pd.DataFrame, along: str, names: Sequence[str], outputs: Sequence[str]
) -> None:
    """Warn of columns that differ between the runs of a wide table, and are not named."""
    if wide_along(table, [along], outputs) is None:
        return
    known = {RUN, *names, *_places(table, along, outputs[0])}
    rest = [name for name in table.select_dtypes("number") if name not in known]
    varied = [name for name in rest if table[name].min() < table[name].max()]
    if varied:
        warnings.warn(
            f"The columns {varied} differ between runs and are not among inputs, parameters and "
            "assumed: their effect on the output counts as an error of the surrogate. Name "
            "them, unless they do nothing.",
            DiagnosisWarning,
            stacklevel=5,
        )


def without_missing(table: pd.DataFrame, name: str, outputs: Sequence[str]) -> pd.DataFrame:
    """Leave out rows without a place or any output; warn of runs that have none at all.

    The attribute "failed" has a row of each of these.
    """
    there = np.isfinite(table[list(outputs)].to_numpy(dtype=float)).any(axis=1)
    there &= np.isfinite(table[name].to_numpy(dtype=float))
    lost = sorted(set(table[RUN]) - set(table[RUN][there]))
    if not there.any():
        raise ValueError(f"All {len(lost)} runs failed: {outputs[-1]!r} holds no number.")
    if lost:
        shown = ", ".join(map(str, lost[:5])) + (", ..." if len(lost) > 5 else "")
        warnings.warn(
            f"{len(lost)} of {table[RUN].nunique()} runs failed and were dropped (runs {shown}): "
            "they hold no number.",
            FailedRunsWarning,
            stacklevel=5,
        )
    out = table[there].reset_index(drop=True)
    out.attrs["failed"] = table[table[RUN].isin(lost)].drop_duplicates(RUN)
    return out


def check_curves(
    table: pd.DataFrame, along: Sequence[str], names: Sequence[str], outputs: Sequence[str]
) -> None:
    """Raise ValueError for a run with two values of a parameter, or with two results."""
    of_runs = table.groupby(RUN)
    for constant in names:
        several = of_runs[constant].max() > of_runs[constant].min()
        if several.any():
            raise ValueError(
                f"Run {several.idxmax()} has several values of {constant!r}: what changes along "
                "a run is an input, and there may be one, along which the run is a curve."
            )
    for output in outputs:
        _check_repeats(table, [*names, *along], output)


def _check_repeats(table: pd.DataFrame, keys: list[str], output: str) -> None:
    twice = table[table.duplicated(keys, keep=False)]
    if twice.empty:
        return
    spread = twice.groupby(keys)[output].agg(["min", "max"])
    size = float(np.std(table[output]))
    apart = (spread["max"] - spread["min"]) > 1e-9 * size
    if apart.any():
        at = dict(zip(keys, spread.index[apart.to_numpy()][0], strict=True))
        runs = twice[(twice[keys] == pd.Series(at)).all(axis=1)][RUN].tolist()
        where = ", ".join(f"{key} = {value:g}" for key, value in at.items())
        raise ValueError(
            f"There are different results of {output!r} for the same run: runs {runs} at {where}. "
            "Of a simulation that scatters give the rows to SimulationData(X, omega, y, ...)."
        )


def name_of_curves(along: str | Mapping[str, ArrayLike]) -> str:
    """Return the name of the input along which runs are curves; TypeError where it has none."""
    if isinstance(along, str):
        return along
    names = [*along] if isinstance(along, Mapping) else []
    if len(names) != 1 or not isinstance(names[0], str):
        raise TypeError(
            'along must be a name or one name with its places, {"t": times}, got '
            f"{described(along)}."
        )
    return names[0]


def _of_long(
    omega: Any, table: pd.DataFrame, name: str, names: Sequence[str], outputs: Sequence[str]
) -> pd.DataFrame:
    points = None if omega is None else as_table(omega, "omega")
    if points is not None:
        if not isinstance(points, pd.DataFrame):
            points = pd.DataFrame(as_matrix(points, "omega", tuple(names)), columns=list(names))
        if RUN not in points.columns:
            points = points.rename_axis(RUN).reset_index()
        strange = sorted(set(table[RUN]) - set(points[RUN]))
        if strange:
            raise ValueError(f"Y has runs that omega has not: {strange[:5]}.")
        if points[RUN].duplicated().any():
            raise ValueError("omega must have one row for each run.")
        table = table[[RUN, name, *outputs]].merge(points[[RUN, *names]], on=RUN)
    columns = select_columns(table, [name, *names, *outputs], "The runs")
    return without_missing(pd.concat([table[RUN], columns], axis=1), name, outputs)


def _of_dataset(data: Any, name: str, names: Sequence[str], outputs: Sequence[str]) -> pd.DataFrame:
    if not all(hasattr(data, known) for known in ("to_dataframe", "dims", "data_vars")):
        raise TypeError("Y is missing: only an xarray.Dataset holds parameters and curves at once.")
    missing = [key for key in (name, *names, *outputs) if key not in data.variables]
    if missing:
        raise ValueError(
            f"The dataset has no {missing}; it has {list(data.variables)}."
            f"{did_you_mean(missing, data.variables)}"
        )
    dims = data[outputs[0]].dims
    others = [dim for dim in dims if dim != name]
    if name not in dims or len(others) != 1:
        raise ValueError(
            f"{outputs[0]!r} must have the dimensions of the runs and {name!r}, got {dims}."
        )
    frame = data[[*names, *outputs]].to_dataframe().reset_index()
    frame = frame.rename(columns={others[0]: RUN})
    return without_missing(frame[[RUN, name, *names, *outputs]], name, outputs)
