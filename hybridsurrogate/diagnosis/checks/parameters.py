"""What a diagnosis can work with."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from numbers import Integral, Real
from typing import Any

import numpy as np
from sklearn.utils import check_scalar

from hybridsurrogate.arguments.scalars import check_flag, check_n_jobs, check_number
from hybridsurrogate.diagnosis.checks.settings import SETTINGS
from hybridsurrogate.effects.registry import kinds
from hybridsurrogate.estimators.power_scaled import PowerScaledSurrogate, as_causes
from hybridsurrogate.exceptions import did_you_mean
from hybridsurrogate.types import FloatArray


def check_settings(
    *,
    estimator: Any,
    causes: Any,
    exclude: Any,
    false_alarm_rate: Any,
    n_replicates: Any,
    cv: Any,
    max_causes: Any,
    n_jobs: Any,
    progress: Any,
) -> None:
    """Raise TypeError or ValueError, with a way out, for parameters that cannot work."""
    check_diagnosable(estimator)
    check_scalar(max_causes, "max_causes", Integral, min_val=1)
    if cv is not None:
        check_scalar(cv, "cv", Integral, min_val=2)
    check_n_jobs(n_jobs)
    check_flag(progress, "progress")
    as_causes(causes, "causes")
    listed = isinstance(exclude, Collection) and not isinstance(exclude, str)
    unknown = [kind for kind in exclude if kind not in kinds()] if listed else exclude
    if not listed or unknown:
        raise ValueError(
            f"exclude must be a sequence of kinds of the catalogue, got {exclude!r}; the kinds are "
            f"{', '.join(kinds())}.{did_you_mean(unknown, kinds())}"
        )
    check_number(false_alarm_rate, "false_alarm_rate", Real)
    check_scalar(n_replicates, "n_replicates", Integral)
    rate, n = false_alarm_rate, n_replicates
    if not 0 < rate < 1:
        raise ValueError(f"false_alarm_rate must be in (0, 1), got {rate}.")
    # the smallest p-value is 1 / (n + 1); 1 / rate of a rate such as 1 / 49 is not quite whole
    fewest = math.ceil(round(1 / rate - 1, 9))
    if n < fewest:
        raise ValueError(
            f"n_replicates = {n} cannot give a p-value of {rate}: use at least {fewest}."
        )


def check_rows(n: int, columns: Collection[str], numbers: Collection[str]) -> None:
    """Raise ValueError for measured rows that a diagnosis cannot work with.

    Parameters
    ----------
    n : int
    columns : collection of str
        Measured columns.
    numbers : collection of str
        Parameters and assumed constants of the simulation.
    """
    if n < SETTINGS.least_rows:
        raise ValueError(
            f"A diagnosis needs at least {SETTINGS.least_rows} measured rows, got {n}."
        )
    twice = [name for name in columns if name in numbers]
    if twice:
        raise ValueError(
            f"The measured columns {twice} are called like parameters or constants of the "
            "simulation: rename them, as an extended simulation may need both."
        )


def check_each_output(Y: FloatArray, names: Sequence[str]) -> None:
    """Raise ValueError for one of several outputs Y (n, k) of which too little was measured."""
    if Y.ndim == 1:
        return
    for name, n in zip(names, np.isfinite(Y).sum(axis=0).tolist(), strict=True):
        if n < SETTINGS.least_rows:
            raise ValueError(
                f"A diagnosis needs at least {SETTINGS.least_rows} measured rows of each output, "
                f"got {n} of {name!r}: leave it out of the simulation's outputs."
            )


def check_diagnosable(estimator: Any) -> None:
    """Raise TypeError or ValueError for an estimator with which causes cannot be compared.

    Parameters
    ----------
    estimator : Any
    """
    if not isinstance(estimator, PowerScaledSurrogate):
        raise TypeError(
            "estimator must be a PowerScaledSurrogate, whose effects a diagnosis can extend; "
            f"got {type(estimator).__name__}."
        )
    set_by_diagnosis = {"simulation", "beta", "effects"}
    if not set_by_diagnosis <= estimator.get_params(deep=False).keys():
        raise TypeError(
            f"A diagnosis cannot extend a {type(estimator).__name__}. Diagnose a "
            "PowerScaledSurrogate of one simulation and one measured data set."
        )
    if estimator.simulation is None:
        raise ValueError("There is no simulation to diagnose: give the estimator simulation=...")
    for effect in as_causes(estimator.effects):
        if not effect.is_learned or effect.is_process or "outliers" in effect.acts_on:
            raise ValueError(
                f"A known effect has a shape that the data inform; {effect.name} has none: nothing "
                "is compared in addition to it. Diagnose the estimator without it."
            )
