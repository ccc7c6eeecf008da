"""Columns of measured rows: inputs of the simulation, and which experiment a row is of."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from hybridsurrogate.effects.base import Cause
from hybridsurrogate.effects.context import MIN_ROWS_EACH
from hybridsurrogate.effects.noise.known_errors import SharedErrors
from hybridsurrogate.effects.parameters.parameter_by_experiment import ParameterByExperiment
from hybridsurrogate.exceptions import ExtrapolationWarning, did_you_mean
from hybridsurrogate.simulation.arrays import MONTH, check_columns, is_numeric
from hybridsurrogate.simulation.simulator import SimulationData, Simulator
from hybridsurrogate.types import FloatArray

# shared: the same in all experiments, as every parameter that is not mentioned
_WAYS = ("shared", "own", "spread")


@dataclass(frozen=True)
class Experiments:
    """What a fit knows of the experiments that its rows are of, and of columns with names.

    Attributes
    ----------
    column : str or None
        With the experiment of each row, where one was declared.
    by : mapping of parameter or output to {"own", "spread"}
        What differs between experiments, and how.
    outputs : tuple of str
        Of the simulation.
    labels : mapping of str to tuple of str
        Names that stand in columns of text which the simulation ignores, in order.
    left_out : tuple of str
        Such columns whose names stand in fewer than three rows each: of no use.
    """

    column: str | None = None
    by: Mapping[str, str] = field(default_factory=dict)
    outputs: tuple[str, ...] = ()
    labels: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()

    def numbered(self, table: Any) -> Any:
        """Return a table with names numbered from zero; one that is not known is -1.

        Raises ValueError for other columns that hold no numbers.
        """
        if not isinstance(table, pd.DataFrame):
            return table
        table = table.drop(columns=list(self.left_out), errors="ignore")
        numbers = {
            column: pd.Index(labels).get_indexer(_text(table[column])).astype(float)
            for column, labels in self.labels.items()
            if _has_names(table, column)
        }
        table = table.assign(**numbers)
        check_columns(table)
        return table

    def effects(self) -> tuple[Cause, ...]:
        """Return what gives each experiment its own value of the parameters that differ.

        An output that differs has errors that the rows of an experiment share.
        """
        if self.column is None:
            return ()
        labels = self.labels.get(self.column)
        of_outputs = [name for name in self.by if name in self.outputs]
        of_parameters = tuple(
            ParameterByExperiment(name, self.column, how, labels=labels)
            for name, how in self.by.items()
            if name not in of_outputs
        )
        if not of_outputs:
            return of_parameters
        spread = dict.fromkeys(of_outputs) if len(self.outputs) > 1 else None
        return (*of_parameters, SharedErrors(self.column, spread, labels=labels))


def experiments_of(
    tables: Sequence[Any],
    column: str | None,
    by: Mapping[str, str] | None,
    simulation: SimulationData | Simulator | None,
) -> Experiments:
    """Return the experiments, and the names in columns, of the measured tables of a fit."""
    differing = {name: how for name, how in (by or {}).items() if how != "shared"}
    labels: dict[str, tuple[str, ...]] = {}
    left_out = []
    for name in dict.fromkeys(name for table in tables for name in column_names(table)):
        # without a simulation all columns are inputs
        if name != column and (simulation is None or name in simulation.input_names):
            continue
        texts = [_text(table[name]) for table in tables if _has_names(table, name)]
        if name != column and any(_mostly_numbers(text) for text in texts):
            continue
        found = sorted(set().union(*map(set, texts)))
        if name != column and sum(map(len, texts)) < MIN_ROWS_EACH * len(found):
            left_out.append(name)
        elif found:
            labels[name] = tuple(found)
    outputs = tuple(getattr(simulation, "outputs", ()))
    return Experiments(column, differing, outputs, labels, tuple(left_out))


def check_experiments(
    column: object, by: object, simulation: SimulationData | Simulator | None
) -> None:
    """Raise ValueError or TypeError for settings of experiments that mean nothing."""
    if column is not None and not isinstance(column, str):
        raise TypeError(f"experiment must be the name of a measured column, got {column!r}.")
    if by is None:
        return
    if not isinstance(by, Mapping):
        raise TypeError(
            "by_experiment must map parameters to how they differ, such as {'rate': 'spread'}, "
            f"got {by!r}."
        )
    parameters = () if simulation is None else simulation.parameter_names
    outputs = () if simulation is None else tuple(simulation.outputs)
    for name, how in by.items():
        if name not in (*parameters, *outputs):
            raise ValueError(
                f"by_experiment: {name!r} is not a parameter of the simulation; these are: "
                f"{list(parameters)}.{did_you_mean(name, parameters)}"
            )
        if name in outputs and how == "own":
            raise ValueError(
                f"by_experiment[{name!r}] is of an output: rows of one experiment share an error. "
                'It must be "spread".'
            )
        if how not in _WAYS:
            raise ValueError(
                f"by_experiment[{name!r}] must be one of {_WAYS}, got {how!r}."
                f"{did_you_mean(how, _WAYS)}"
            )
        if column is None:
            raise ValueError(
                "by_experiment needs experiment, the name of the measured column that holds each "
                "row's experiment."
            )


def check_column(
    experiments: Experiments, columns: Sequence[str], values: NDArray[Any], inputs: Sequence[str]
) -> None:
    """Raise ValueError where the column of experiments is missing, an input or always the same."""
    name = experiments.column
    if name is None:
        return
    if name in inputs:
        raise ValueError(
            f"experiment={name!r} is an input of the simulation: it must be a column of labels "
            "that the simulation ignores."
        )
    if name not in columns:
        raise ValueError(
            f"experiment={name!r} is none of the measured columns {list(columns)}. An array has "
            f"columns x0, x1 and so on; a DataFrame has names.{did_you_mean(name, columns)}"
        )
    if experiments.by and len(np.unique(values[:, list(columns).index(name)])) < 2:
        raise ValueError(
            f"All rows are of one experiment, {name!r} is always the same: differences between "
            "experiments cannot be estimated. Leave out by_experiment."
        )


def _has_names(table: Any, column: str) -> bool:
    return (
        isinstance(table, pd.DataFrame)
        and column in table.columns
        and not is_numeric(table[column])
    )


def _mostly_numbers(column: pd.Series) -> bool:
    return bool(pd.to_numeric(column, errors="coerce").notna().mean() > 0.5)


def _text(column: pd.Series) -> pd.Series:
    return column.astype(object).where(column.notna(), "missing").astype(str)


def column_names(X: ArrayLike) -> list[str]:
    """Return the names of a DataFrame's columns; none where some are not text, or for an array."""
    names = list(X.columns) if isinstance(X, pd.DataFrame) else []
    return names if all(isinstance(name, str) for name in names) else []


def matched_columns(
    names: list[str], n_columns: int, simulation: SimulationData | Simulator | None
) -> tuple[tuple[str, ...], list[int]]:
    """Return column names, the simulation's inputs first, and their positions in X.

    ``names`` is empty where X has none: then the inputs come first in X.
    """
    if simulation is None:
        return tuple(names or (f"x{k}" for k in range(n_columns))), list(range(n_columns))
    wanted = simulation.input_names
    if names:
        missing = [name for name in wanted if name not in names]
        if missing:
            dates = [name for name in missing if MONTH + name in names]
            if dates:
                raise ValueError(
                    f"The simulation's inputs {dates} hold dates, not numbers: count them from a "
                    "fixed day, (X[name] - pandas.Timestamp('2020-01-01')) / "
                    "pandas.Timedelta('1D'), as the simulation does."
                )
            raise ValueError(
                f"The measured data lack the simulation's inputs {missing}; their columns are "
                f"{names}. Rename the columns or pass an array with the inputs first."
                f"{did_you_mean(missing, names)}"
            )
        extras = [name for name in names if name not in wanted]
        return (*wanted, *extras), [names.index(name) for name in (*wanted, *extras)]
    if n_columns < len(wanted):
        raise ValueError(
            f"X has {n_columns} columns, but the simulation has {len(wanted)} inputs: "
            f"{list(wanted)}."
        )
    # an input may be called like that
    extras = [_free(f"x{k}", wanted) for k in range(len(wanted), n_columns)]
    return (*wanted, *extras), list(range(n_columns))


def _free(name: str, taken: tuple[str, ...]) -> str:
    return _free(f"{name}_", taken) if name in taken else name


def warn_elsewhere(y: FloatArray, simulation: SimulationData | Simulator | None) -> None:
    """Warn the caller of ``fit`` of outputs (n,) or (n, k) nowhere near those simulated."""
    if not isinstance(simulation, SimulationData):
        return
    k = len(simulation.outputs)
    for own, simulated in zip(y.reshape(-1, k).T, simulation.y.reshape(-1, k).T, strict=True):
        own = own[~np.isnan(own)]
        low, high = float(np.fmin.reduce(simulated)), float(np.fmax.reduce(simulated))
        if len(own) and (own.min() > high or own.max() < low):
            warnings.warn(
                f"The measured outputs, {own.min():g} to {own.max():g}, lie outside all that was "
                f"simulated, {low:g} to {high:g}. Check that both have the same units and the same "
                "transformation.",
                ExtrapolationWarning,
                stacklevel=4,
            )


def check_reach(
    columns: tuple[str, ...], X: FloatArray, simulation: SimulationData | Simulator | None
) -> None:
    """Raise ValueError for inputs so far outside that doubles do not distinguish the runs.

    Powers of such inputs, scaled to the runs, overflow. A simulation that can be called needs no
    powers.
    """
    if not isinstance(simulation, SimulationData):
        return
    for name, values in zip(columns, X.T, strict=False):
        if name not in simulation.input_ranges:
            continue
        low, high = simulation.input_ranges[name]
        far = np.flatnonzero(np.abs(values - low) > (high - low) / np.finfo(float).eps)
        if len(far):
            raise ValueError(
                f"{len(far)} of {len(values)} rows have {name!r} so far outside the simulated "
                f"range [{low:g}, {high:g}] that a surrogate overflows there, the first "
                f"{values[far[0]]:g} in row {far[0] + 1}. Check the units, or leave out such rows."
            )


def warn_outside(
    columns: tuple[str, ...],
    X: FloatArray,
    simulation: SimulationData | Simulator | None,
    measured: FloatArray | None = None,
) -> None:
    """Warn the caller of ``fit`` or ``predict`` of inputs beyond those simulated.

    In ``predict`` the ``measured`` rows are given: ``fit`` warned of how far they reach.
    """
    if simulation is None:
        return
    which = "measured" if measured is None else "predicted"
    for k, (name, values) in enumerate(zip(columns, X.T, strict=False)):
        if name not in simulation.input_ranges:
            continue
        low, high = simulation.input_ranges[name]
        known = np.array([low, high] if measured is None else [low, high, *measured[:, k]])
        slack = 1e-9 * (high - low)
        outside = (values < known.min() - slack) | (values > known.max() + slack)
        if outside.any():
            warnings.warn(
                f"{outside.sum()} of {len(values)} {which} rows ({outside.mean():.0%}) have "
                f"{name!r} outside the simulated range [{low:g}, {high:g}]: there the "
                "surrogate extrapolates. Simulate a wider range.",
                ExtrapolationWarning,
                stacklevel=4,
            )
