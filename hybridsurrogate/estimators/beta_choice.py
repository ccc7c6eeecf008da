"""The weight beta chosen by held-out predictions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from sklearn.model_selection import TimeSeriesSplit, check_cv
from sklearn.utils import _safe_indexing

from hybridsurrogate.arguments.description import described
from hybridsurrogate.arguments.scalars import check_flag
from hybridsurrogate.estimators.base import SurrogateEstimator
from hybridsurrogate.estimators.beta_path import beta_path, check_model
from hybridsurrogate.model.rows.measured_rows import without_gaps
from hybridsurrogate.model.rows.row_errors import taken_out
from hybridsurrogate.model.rows.stacking import as_several
from hybridsurrogate.notebook.bars import counted
from hybridsurrogate.simulation.arrays import as_numbers, as_outputs, complete_table

LEAVE_FUTURE_OUT = "leave-future-out"
_FUTURE_SPLITS = 5


@dataclass(frozen=True)
class BetaChoice:
    """The chosen weight.

    Attributes
    ----------
    beta : float
    estimator : fitted estimator
        On all data, at the chosen beta.
    table : DataFrame
        For each beta the mean held-out ELPD per row, its standard error, its difference from the
        best and the paired standard error of that.
    n_refits : int
        Fits that the folds needed in all.

    Examples
    --------
    From `choose_beta`:

    >>> table = pd.DataFrame({"beta": [0.0, 0.5], "elpd": [-2.0, -1.0]})
    >>> choice = BetaChoice(0.5, None, table, n_refits=5)
    >>> choice.table[choice.table["beta"] == choice.beta]["elpd"].tolist()
    [-1.0]
    """

    beta: float
    estimator: Any
    table: pd.DataFrame
    n_refits: int


def choose_beta(
    model: SurrogateEstimator,
    X: ArrayLike,
    y: ArrayLike,
    betas: Sequence[float] | None = None,
    cv: Any = 5,
    progress: bool = False,
    y_err: Any = None,
) -> BetaChoice:
    """Choose beta by the held-out ELPD, every beta of a fold from one path.

    Parameters
    ----------
    model : PowerScaledSurrogate or PredictiveWeightedSurrogate
    X, y : array-like of shape (n, n_columns), (n,)
    betas : sequence of float or None, default=None
        None: 21 from 0 to 1.
    cv : int, splitter, iterable of splits or "leave-future-out", default=5
        Folds as in scikit-learn, rows in the order given. "leave-future-out": rows in the order of
        the first column, five times trained on the earlier ones and tested on the next, as
        extrapolation needs it (Burkner, Gabry and Vehtari 2020, Journal of Statistical Computation
        and Simulation 90:2499).
    progress : bool, default=False
        Show a progress bar of the folds.
    y_err : float, str, array-like or None, default=None
        Known errors of the rows, as in ``fit``.

    Returns
    -------
    BetaChoice

    Examples
    --------
    >>> import hybridsurrogate as hs
    >>> from hybridsurrogate.datasets import make_log_sin
    >>> case = make_log_sin(random_state=0)
    >>> model = hs.PredictiveWeightedSurrogate(case.simulation, random_state=0)
    >>> choice = hs.choose_beta(model, case.X, case.y, betas=[0, 0.5, 1], cv=3)
    >>> choice.estimator.beta == choice.beta
    True
    """
    check_model(model)
    shown = check_flag(progress, "progress")
    grid = np.linspace(0, 1, 21) if betas is None else np.atleast_1d(as_numbers(betas, "betas"))
    X, y_err = taken_out(X, y_err)
    X, table, _, y_err = without_gaps(X, y, None, y_err)
    X = complete_table(X, labels=model.experiment)
    names = model.output_names(table)
    outputs = as_outputs(table) if len(names) == 1 else as_several(table, names)
    if isinstance(cv, str):
        if cv != LEAVE_FUTURE_OUT:
            raise ValueError(f"cv must be as in scikit-learn or {LEAVE_FUTURE_OUT!r}, got {cv!r}.")
        first = X.iloc[:, 0] if isinstance(X, pd.DataFrame) else np.asarray(X)[:, 0]
        order = np.argsort(as_numbers(first, "X"), kind="stable")
        folds = TimeSeriesSplit(_FUTURE_SPLITS).split(order)
        splits = [(order[train], order[test]) for train, test in folds]
    else:
        try:
            splits = list(check_cv(cv).split(np.zeros((len(outputs), 1)), outputs))
        except (TypeError, ValueError) as error:
            raise ValueError(
                f"cv must be as in scikit-learn or {LEAVE_FUTURE_OUT!r}, a number of folds, a "
                f"splitter or pairs (train, test) of row numbers, got {described(cv)}: {error}."
            ) from error
    held_out, n_refits = [], 0
    errors = None if y_err is None else np.broadcast_to(as_numbers(y_err, "y_err"), outputs.shape)
    for train, test in counted(splits, "Folds", shown):
        known, held = (None, None) if errors is None else (errors[train], errors[test])
        path = beta_path(model, _safe_indexing(X, train), outputs[train], list(grid), y_err=known)
        n_refits += path.n_refits
        rows = _safe_indexing(X, test)
        density = np.array(
            [m.log_predictive_density(rows, outputs[test], held) for m in path.estimators]
        )
        held_out.append(density[:, np.isfinite(outputs[test])])
    pointwise = np.concatenate(held_out, axis=1)
    mean = pointwise.mean(axis=1)
    best = int(np.argmax(mean))
    lost = pointwise - pointwise[best]
    root = np.sqrt(pointwise.shape[1])
    table = pd.DataFrame(
        {
            "beta": grid,
            "elpd": mean,
            "standard_error": pointwise.std(axis=1, ddof=1) / root,
            "difference": lost.mean(axis=1),
            "difference_error": lost.std(axis=1, ddof=1) / root,
        }
    )
    chosen = float(grid[best])
    final = beta_path(model, X, outputs, [chosen], y_err=errors)
    return BetaChoice(chosen, final.estimators[0], table, n_refits)
