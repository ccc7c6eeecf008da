"""One fit carried along the weights beta, and beta chosen by held-out predictions."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from sklearn.base import clone
from sklearn.utils import _safe_indexing

from hybridsurrogate.arguments import check_flag, described
from hybridsurrogate.estimators.base import SurrogateEstimator
from hybridsurrogate.estimators.power_scaled import FitTask, PowerScaledSurrogate, prepared
from hybridsurrogate.estimators.predictive_weighted import PredictiveWeightedSurrogate
from hybridsurrogate.inference.procedure import carried, thinned
from hybridsurrogate.inference.sampling.importance import Proposals
from hybridsurrogate.inference.sampling.settings import SETTINGS
from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.model.rows.measured_data import errors_of_rows, taken_out, without_gaps
from hybridsurrogate.model.rows.stacking import as_several
from hybridsurrogate.model.statistics import powers_of
from hybridsurrogate.notebook import counted
from hybridsurrogate.priors import to_normal
from hybridsurrogate.simulation.arrays import as_numbers, as_outputs, complete_table
from hybridsurrogate.types import FloatArray


def fitted_near(task: FitTask, known: PowerScaledSurrogate) -> PowerScaledSurrogate | None:
    """Return an estimator fitted to rows by the proposals of its fit to most of them and more.

    None where these do not serve. A mode that all rows together exclude gets no proposals, so this
    is for scores of rows left out, not for a model that is kept.

    Parameters
    ----------
    task : FitTask
        The rows.
    known : PowerScaledSurrogate
        Fitted, with the same unknowns.
    """
    problem, n, whole = task.problem, int(task.estimator.n_draws), known.inference_
    proposals = whole.proposals
    if proposals is not None:
        before = whole.first.model
        # these rows may lack an experiment
        if before.theta_names != problem.model.theta_names:
            return None
        proposals = thinned(proposals, SETTINGS.oversampling * n)
        proposals = _under_other_priors(proposals, before, problem.model)
    most = SETTINGS.oversampling * n
    fit = carried(problem, task.powers, proposals, n, most, task.random_state())
    if fit is None:
        return None
    fit.diagnostics.warn()
    return task.fitted_by(fit)


def _under_other_priors(
    proposals: Proposals, before: MeasuredModel, model: MeasuredModel
) -> Proposals:
    """Return proposals of the same values, as standard normal coordinates under other priors.

    Priors of causes follow the rows, and a period that is known to a ten thousandth of its prior
    would be missed by far. With z' = Phi^-1(F'(v)) at v = F^-1(Phi(z)) the density q'(z') is
    q(z) dz/dz', where dz'/dz = f'(v) phi(z) / (f(v) phi(z')). What the other priors exclude is left
    out.
    """
    z = proposals.points[:, : model.n_unknowns]
    values, log_slope = before.values(z), np.zeros(len(z))
    points = proposals.points.copy()
    for k in np.flatnonzero(np.any(values != model.values(z), axis=0)):
        old, new, v = before.priors[k], model.priors[k], values[:, [k]]
        points[:, [k]] = to_normal([new], v)
        log_slope += new.logpdf(v)[:, 0] - old.logpdf(v)[:, 0]
        log_slope += 0.5 * (points[:, k] ** 2 - z[:, k] ** 2)
    if model.errors is not None and before.errors is not None:
        # known errors are in units of their median, which follows the rows, too
        at = model.n_unknowns + model.n_hyper
        points[:, at] += np.log(model.errors.unit / before.errors.unit)
    kept = np.isfinite(log_slope)
    return Proposals(points[kept], (proposals.log_density - log_slope)[kept])


@dataclass(frozen=True)
class BetaPath:
    """Fitted estimators along beta.

    Attributes
    ----------
    betas : ndarray of shape (n_betas,)
    estimators : list of n_betas fitted estimators
    refitted : ndarray of bool, shape (n_betas,)
        Where a new fit was needed; the first is always one.
    khat : ndarray of shape (n_betas,)
        Pareto k-hat of the draws that were carried over; NaN where refitted.

    Examples
    --------
    From `beta_path`, which carries the first of three fits to the second beta:

    >>> refitted, khat = np.array([True, False, True]), np.array([np.nan, 0.3, np.nan])
    >>> print(BetaPath(np.array([0.0, 0.5, 1.0]), [None] * 3, refitted, khat))
    3 betas from 2 fits
    """

    betas: FloatArray
    estimators: list[Any]
    refitted: NDArray[np.bool_]
    khat: FloatArray

    @property
    def n_refits(self) -> int:
        """Fits that were needed, the first one included."""
        return int(self.refitted.sum())

    def score(self, X: ArrayLike, y: ArrayLike) -> FloatArray:
        """Return the ELPD per row at each beta, (n_betas,)."""
        return np.array([model.score(X, y) for model in self.estimators])

    def __str__(self) -> str:
        return f"{len(self.betas)} betas from {self.n_refits} fits"


def check_model(model: SurrogateEstimator) -> None:
    """Raise TypeError for what is no estimator."""
    if not isinstance(model, SurrogateEstimator):
        raise TypeError(
            "model must be an estimator such as PowerScaledSurrogate(simulation), got "
            f"{described(model)}."
        )


def beta_path(
    model: SurrogateEstimator,
    X: ArrayLike,
    y: ArrayLike,
    betas: Sequence[float],
    sample_weight: ArrayLike | None = None,
    progress: bool = False,
    y_err: Any = None,
) -> BetaPath:
    """Fit an estimator at many beta by as few fits as possible.

    The proposals of one fit are reweighted, and moved by moment matching, to the posterior of the
    next beta (Paananen et al. 2021, Statistics and Computing 31:16); where their k-hat exceeds 0.7
    or fewer than 200 effective draws are left, the model is fitted there. Step 2 is always drawn
    anew. For predictive weighting beta only mixes, and one fit serves all.

    Parameters
    ----------
    model : PowerScaledSurrogate or PredictiveWeightedSurrogate
        Not fitted; its beta is not used.
    X, y : array-like of shape (n, n_columns), (n,)
        Measured data.
    betas : sequence of float
    sample_weight : array-like of shape (n,) or None, default=None
        Of the rows, as in ``fit``.
    progress : bool, default=False
        Show a progress bar.
    y_err : float, str, array-like or None, default=None
        Known errors of the rows, as in ``fit``.

    Returns
    -------
    BetaPath
        In the order of ``betas``.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> from hybridsurrogate.datasets import make_log_sin
    >>> case = make_log_sin(random_state=0)
    >>> model = hs.PowerScaledSurrogate(
    ...     case.simulation, surrogate=hs.PolynomialChaos(degree=5), random_state=0)
    >>> path = hs.beta_path(model, case.X, case.y, np.linspace(0, 1, 5))
    >>> path.score(case.X_in, case.y_in).shape
    (5,)
    """
    check_model(model)
    progress = check_flag(progress, "progress")
    grid = as_numbers(betas, "betas")
    if grid.ndim != 1 or not len(grid) or not ((grid >= 0) & (grid <= 1)).all():
        raise ValueError(f"betas must be numbers between 0 and 1, got {betas!r}.")
    if isinstance(model, PredictiveWeightedSurrogate):
        fitted = clone(model).set_params(beta=float(grid[0])).fit(X, y, sample_weight, y_err)
        models = [copy.copy(fitted).set_params(beta=float(beta)) for beta in grid]
        for other, beta in zip(models, grid, strict=True):
            other.beta_ = float(beta)
        first = np.arange(len(grid)) == 0
        return BetaPath(grid, models, first, np.where(first, np.nan, -np.inf))
    if type(model) is not PowerScaledSurrogate:
        raise TypeError(
            "beta_path needs a PowerScaledSurrogate or a PredictiveWeightedSurrogate, got "
            f"{type(model).__name__}."
        )
    task = prepared(clone(model).set_params(beta=0.5), X, y, sample_weight, y_err)
    return _power_scaled_path(task, grid, progress)


def _power_scaled_path(task: FitTask, grid: FloatArray, progress: bool) -> BetaPath:
    out: dict[int, Any] = {}
    refitted, khat = np.zeros(len(grid), dtype=bool), np.full(len(grid), np.nan)
    # from the middle outwards: there both sources speak, and the ends are its neighbours
    outwards = np.argsort(np.abs(grid - 0.5), kind="stable").tolist()
    for k in counted(outwards, "Weights beta", progress):
        one = task.with_settings(beta=float(grid[k]))
        n, random = int(one.estimator.n_draws), one.random_state()
        source = _nearest(out, grid, k)
        fit = None
        if source is not None:
            known = out[source].inference_.proposals
            # half of what a fit from scratch has: a path costs less
            most = SETTINGS.oversampling * n // 2
            fit = carried(one.problem, one.powers, known, n, most, random)
        refitted[k] = fit is None
        if fit is None:
            fit = one.draw(random)
        else:
            khat[k] = fit.diagnostics.khat
        out[k] = one.fitted_by(fit)
        fit.diagnostics.warn()
    return BetaPath(grid, [out[k] for k in range(len(grid))], refitted, khat)


def _nearest(out: dict[int, Any], grid: FloatArray, k: int) -> int | None:
    """Return the fitted beta whose powers are nearest, None at the start."""
    if not out:
        return None
    powers = np.stack(powers_of(grid))
    return min(out, key=lambda j: float(np.abs(powers[:, j] - powers[:, k]).sum()))


LEAVE_FUTURE_OUT = "leave-future-out"


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
    from sklearn.model_selection import TimeSeriesSplit, check_cv

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
        folds = TimeSeriesSplit(n_splits=5).split(order)
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
    errors = None if y_err is None else errors_of_rows(y_err, outputs)
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
