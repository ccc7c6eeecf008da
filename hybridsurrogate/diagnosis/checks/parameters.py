"""What a diagnosis can work with, and which causes and parameters the data cannot separate.

A cause whose curve a parameter can draw as well is known only together with it: the data fix the
sum, and the priors how it is split.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from numbers import Integral, Real
from typing import Any

import numpy as np
import pandas as pd
from sklearn.utils import check_scalar

from hybridsurrogate.arguments import check_flag, check_n_jobs, check_number
from hybridsurrogate.diagnosis.checks.caution import SETTINGS
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.effects.registry import kinds
from hybridsurrogate.estimators.power_scaled import PowerScaledSurrogate, as_causes
from hybridsurrogate.exceptions import did_you_mean
from hybridsurrogate.model.posterior import FEW_DRAWS, Posterior
from hybridsurrogate.priors import prior_sd
from hybridsurrogate.types import FloatArray


@dataclass(frozen=True, eq=False)
class Settings:
    """The parameters of a `DiscrepancyDiagnosis` at its fit; a later `set_params` changes none.

    Attributes
    ----------
    causes : tuple of Cause
        Of the user.
    exclude : tuple of str
        Kinds that are not compared.
    false_alarm_rate : float
    n_replicates : int
    cv : int or None
    max_causes : int or None
    n_jobs : int or None
    random_state : int, RandomState or None
    progress : bool
    text : str
        The diagnosis as it prints, its estimator included.
    """

    causes: tuple[Cause, ...]
    exclude: tuple[str, ...]
    false_alarm_rate: float
    n_replicates: int
    cv: int | None
    max_causes: int | None
    n_jobs: int | None
    random_state: int | np.random.RandomState | None
    progress: bool
    text: str = field(default="", repr=False)


def checked_settings(
    *,
    estimator: Any,
    causes: Any = (),
    exclude: Any = (),
    false_alarm_rate: Any,
    n_replicates: Any,
    cv: Any = None,
    max_causes: Any = None,
    n_jobs: Any = None,
    random_state: Any = None,
    progress: Any = False,
    text: str = "",
) -> Settings:
    """Return the settings of a fit; TypeError or ValueError, with a way out, where they fail."""
    check_diagnosable(estimator)
    if max_causes is not None:
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
            f"{', '.join(sorted(kinds()))}.{did_you_mean(unknown, kinds())}"
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
    return Settings(
        tuple(causes),
        tuple(exclude),
        rate,
        int(n),
        None if cv is None else int(cv),
        None if max_causes is None else int(max_causes),
        n_jobs,
        random_state,
        bool(progress),
        text,
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


def confounding(
    before: PowerScaledSurrogate, after: PowerScaledSurrogate, X: FloatArray
) -> pd.DataFrame:
    """Return how each cause of an extended model and each parameter depend on each other.

    A parameter is not compared with a drift of itself: a drift needs a level to start from.

    Parameters
    ----------
    before, after : PowerScaledSurrogate
        Fitted; after has effects.
    X : ndarray of shape (n, n_columns)
        Measured rows, the simulation's inputs first.

    Returns
    -------
    pandas.DataFrame
        A row for each cause and parameter: cause, parameter, estimate (the cause's estimate that is
        most correlated with the parameter), correlation (over the draws of the extended model),
        shift (of the parameter's mean from before to after, in posterior standard deviations
        after), width (of the parameter's posterior, in standard deviations of its prior) and
        absorbed (share of the square of the cause's curve over the measured rows that a change of
        the parameter alone can draw as well).
    """
    rows = []
    last, first = after.posterior_, before.posterior_
    derivatives = _derivatives(first, last, X)
    names = list(last.model.parameters)
    # the noise of several outputs and a remainder, which follow, are no causes
    n = sum(effect.is_learned for effect in after.effects)
    for k, cause in enumerate(last.model.effects[:n]):
        if cause.replaces in names:  # it is the parameter itself, with a wider prior
            continue
        curve, estimates = _curve(first, last, k, X), last.estimates(k)
        for j, name in enumerate(names):
            if cause.target == name:
                continue
            omega, direction = last.values[:, j], derivatives[j]
            known = [(one, _correlation(draws, omega)) for one, draws in estimates.items()]
            estimate, correlation = max(known, key=lambda pair: abs(pair[1]), default=("", 0.0))
            shift = (omega.mean() - first.values[:, j].mean()) / max(omega.std(), 1e-300)
            # the share of the curve's square that lies along what the parameter draws
            square = float(curve @ curve) * float(direction @ direction)
            rows.append(
                {
                    "cause": cause.name,
                    "parameter": name,
                    "estimate": estimate,
                    "correlation": correlation,
                    "shift": float(shift),
                    "width": omega.std() / prior_sd(last.model.parameters[name]),
                    "absorbed": float(curve @ direction) ** 2 / square if square > 0 else 0.0,
                }
            )
    return pd.DataFrame(rows, columns=_COLUMNS)


_COLUMNS = ["cause", "parameter", "estimate", "correlation", "shift", "width", "absorbed"]


def confounded(table: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of `confounding` in which the data cannot separate cause and parameter.

    Their estimates are correlated, the parameter could draw most of the cause's curve, and it is
    hardly better known than before the data: where both are known well in spite of the
    correlation, the data did separate them.
    """
    correlated = table["correlation"].abs() >= SETTINGS.nearly_all
    least = table[["width", "absorbed"]].min(axis=1, skipna=False)
    return table[correlated & (least >= SETTINGS.majority)]


def sentences_on_parameters(table: pd.DataFrame) -> Iterator[str]:
    """Yield a sentence for each row."""
    for row in table.to_dict("records"):
        name = row["parameter"]
        yield (
            f"The data cannot separate the cause {row['cause']} from the parameter {name}: the "
            f"correlation of {row['estimate']} with {name} is {row['correlation']:.2f}. Given the "
            f"cause, {name} is uncertain by {100 * row['width']:.0f} % of its prior standard "
            f"deviation. Adding the cause moved {name} by {row['shift']:+.1f} posterior standard "
            f"deviations. Without it, {name} could absorb {100 * row['absorbed']:.0f} % of the "
            "cause's curve (a sum of squares). How the two share it depends on their priors."
        )


def _correlation(a: FloatArray, b: FloatArray) -> float:
    if min(np.ptp(a), np.ptp(b)) <= 0:
        return 0.0
    return float(np.corrcoef(a, b)[0, 1])


def _curve(before: Posterior, after: Posterior, position: int, X: FloatArray) -> FloatArray:
    """Return what one cause adds to eta at rows X, averaged over draws, (n,)."""
    draws, model = after.thinned(FEW_DRAWS), after.model
    others = [effect for k, effect in enumerate(model.effects) if k != position]
    theta = np.array([owner != position for owner, _ in model.theta_names], dtype=bool)
    columns = np.array([owner != position for owner, _ in model.column_names], dtype=bool)
    d = model.n_parameters
    # what follows the theta are the surrogate's hyperparameters
    kept = [draws.values[:, :d], draws.values[:, d : d + len(theta)][:, theta]]
    without = Posterior(
        # a model whose dynamics a cause has changed cannot be had without it: start from before
        before.model.with_effects(others),
        after.likelihood,
        np.hstack([*kept, draws.values[:, d + len(theta) :]]),
        draws.sigma,
        draws.coefficients,
        draws.effect_coefficients[:, columns],
    )
    return np.mean(draws.eta(X)[0] - without.eta(X)[0], axis=0)


def _derivatives(before: Posterior, after: Posterior, X: FloatArray) -> FloatArray:
    """Return what a posterior sd of each parameter changes of the simulation at rows X, (d, n)."""
    d = after.model.n_parameters
    hyper = before.values[:, d:].mean(axis=0)
    centre = np.concatenate([after.values[:, :d].mean(axis=0), hyper])
    step = after.values[:, :d].std(axis=0)
    points = np.repeat(centre[None], 2 * d, axis=0)
    points[np.arange(d), np.arange(d)] += step
    points[d + np.arange(d), np.arange(d)] -= step
    n = len(points)
    coefficients = np.repeat(after.coefficients.mean(axis=0)[None], n, axis=0)
    at = Posterior(
        before.model, after.likelihood, points, np.ones(n), coefficients, np.empty((n, 0))
    )
    eta = at.eta(X)[0] if d else np.empty((0, len(X)))
    return eta[:d] - eta[d:]
