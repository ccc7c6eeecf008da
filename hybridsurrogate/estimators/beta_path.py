"""One fit carried along the weights beta."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import clone

from hybridsurrogate.arguments.description import described
from hybridsurrogate.arguments.scalars import check_flag
from hybridsurrogate.estimators.base import SurrogateEstimator
from hybridsurrogate.estimators.power_scaled import FitTask, PowerScaledSurrogate, prepared
from hybridsurrogate.estimators.predictive_weighted import PredictiveWeightedSurrogate
from hybridsurrogate.inference.warm_start import carried
from hybridsurrogate.model.powers import powers_of
from hybridsurrogate.notebook.bars import counted
from hybridsurrogate.simulation.arrays import as_numbers
from hybridsurrogate.types import FloatArray

# a fit has three: a path costs less
_PROPOSALS_A_DRAW = 1.5


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
    for k in counted(_outwards(grid), "Weights beta", progress):
        one = task.with_settings(beta=float(grid[k]))
        n, random = int(one.estimator.n_draws), one.random_state()
        source = _nearest(out, grid, k)
        fit = None
        if source is not None:
            known = out[source].inference_.proposals
            most = int(_PROPOSALS_A_DRAW * n)
            fit = carried(one.problem, one.powers, known, n, most, random)
        refitted[k] = fit is None
        if fit is None:
            fit = one.draw(random)
        else:
            khat[k] = fit.diagnostics.khat
        out[k] = one.fitted_by(fit)
        fit.diagnostics.warn()
    return BetaPath(grid, [out[k] for k in range(len(grid))], refitted, khat)


def _outwards(grid: FloatArray) -> list[int]:
    order = np.argsort(np.abs(grid - 0.5), kind="stable")
    return [int(k) for k in order]


def _nearest(out: dict[int, Any], grid: FloatArray, k: int) -> int | None:
    """Return the fitted beta whose powers are nearest, None at the start."""
    if not out:
        return None
    powers = np.stack(powers_of(grid))
    return min(out, key=lambda j: float(np.abs(powers[:, j] - powers[:, k]).sum()))
