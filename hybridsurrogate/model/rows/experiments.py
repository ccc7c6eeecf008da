"""Which experiment a measured row is of, and which parameters differ between them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from hybridsurrogate.effects.base import Cause
from hybridsurrogate.effects.noise.shared_errors import SharedErrors
from hybridsurrogate.effects.parameters.parameter_by_experiment import ParameterByExperiment
from hybridsurrogate.exceptions import did_you_mean
from hybridsurrogate.simulation.arrays import is_numeric
from hybridsurrogate.simulation.simulator import SimulationData, Simulator

# shared: the same in all experiments, as every parameter that is not mentioned
_WAYS = ("shared", "own", "spread")
# the number of an experiment that is none of those with labels
_NONE = -1.0


@dataclass(frozen=True)
class Experiments:
    """What a fit knows of the experiments that its rows are of.

    Attributes
    ----------
    column : str
    labels : tuple of str or None
        Names that stand in the column, in order; None where it holds numbers.
    by : mapping of parameter or output to {"own", "spread"}
        What differs between experiments, and how.
    outputs : tuple of str
        Of the simulation.
    """

    column: str
    labels: tuple[str, ...] | None
    by: Mapping[str, str]
    outputs: tuple[str, ...] = ()

    def numbered(self, table: Any) -> Any:
        """Return a table with names of experiments numbered; one that is not known is -1.

        A column of numbers is numbered already.
        """
        if self.labels is None or not _has_names(table, self.column):
            return table
        position = {label: float(k) for k, label in enumerate(self.labels)}
        numbers = [position.get(str(value), _NONE) for value in table[self.column]]
        return table.assign(**{self.column: np.array(numbers)})

    def effects(self) -> tuple[Cause, ...]:
        """Return what gives each experiment its own value of the parameters that differ.

        An output that differs has errors that the rows of an experiment share.
        """
        return tuple(
            SharedErrors(self.column, labels=self.labels)
            if name in self.outputs
            else ParameterByExperiment(name, self.column, how, labels=self.labels)
            for name, how in self.by.items()
        )


def experiments_of(
    tables: Sequence[Any],
    column: str | None,
    by: Mapping[str, str] | None,
    outputs: tuple[str, ...] = (),
) -> Experiments | None:
    """Return the experiments in the measured tables of a fit; None without a column."""
    if column is None:
        return None
    differing = {name: how for name, how in (by or {}).items() if how != "shared"}
    names = [table[column].astype(str) for table in tables if _has_names(table, column)]
    labels = tuple(sorted(set().union(*map(set, names)))) if names else None
    return Experiments(column, labels, differing, outputs)


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
        if name in outputs and (how == "own" or len(outputs) > 1):
            raise ValueError(
                f"by_experiment[{name!r}] is of an output: rows of one experiment share an error. "
                'It must be "spread", and the only output.'
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
