"""Columns of measured rows, held against the inputs of the simulation."""

from __future__ import annotations

import warnings

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from hybridsurrogate.exceptions import ExtrapolationWarning, did_you_mean
from hybridsurrogate.simulation.calendar import MONTH
from hybridsurrogate.simulation.simulator import SimulationData, Simulator
from hybridsurrogate.types import FloatArray


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
    n = len(simulation.outputs)
    pairs = zip(y.reshape(-1, n).T, simulation.y.reshape(-1, n).T, strict=True)
    for measured, simulated in pairs:
        _warn_elsewhere(measured[~np.isnan(measured)], simulated)


def _warn_elsewhere(y: FloatArray, simulated: FloatArray) -> None:
    low, high = float(np.fmin.reduce(simulated)), float(np.fmax.reduce(simulated))
    if len(y) and (y.min() > high or y.max() < low):
        warnings.warn(
            f"The measured outputs, {y.min():g} to {y.max():g}, lie outside all that was "
            f"simulated, {low:g} to {high:g}. Check that both have the same units and the same "
            "transformation.",
            ExtrapolationWarning,
            stacklevel=5,
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
