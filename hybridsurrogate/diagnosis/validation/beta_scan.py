"""How much weight a simulation deserves, before and after its fault is named."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from joblib import delayed
from numpy.typing import ArrayLike
from sklearn.base import clone

from hybridsurrogate.diagnosis.validation.cross_validation import (
    Folds,
    folds_beyond,
    in_parallel,
    random_folds,
)
from hybridsurrogate.diagnosis.validation.gain import mean_and_error
from hybridsurrogate.estimators.beta_path import beta_path
from hybridsurrogate.estimators.power_scaled import PowerScaledSurrogate
from hybridsurrogate.exceptions import HybridSurrogateWarning
from hybridsurrogate.inference.sampling.settings import SETTINGS
from hybridsurrogate.model.posterior import FEW_DRAWS
from hybridsurrogate.model.rows.measured_data import GivenRows, without_gaps
from hybridsurrogate.scoring.scores import last_of_the_best
from hybridsurrogate.simulation.arrays import as_numbers, complete_table
from hybridsurrogate.types import FloatArray

# enough to see whether the best weight moved
_FEW_BETAS, _SCAN_FOLDS = (0.05, 0.25, 0.5, 0.75, 0.95), 3
# with more of these a scan takes minutes
_MANY_COEFFICIENTS = 100


@dataclass(frozen=True)
class BetaScans:
    """What `scan_beta` finds at a few weights for a fitted diagnosis, when it is first asked for.

    Attributes
    ----------
    models : pair of PowerScaledSurrogate
        Before and after, fitted.
    rows : GivenRows
        Measured.
    n_jobs : int or None
    known : dict
        The scans that were tried: out of range or not.
    """

    models: tuple[PowerScaledSurrogate, PowerScaledSurrogate]
    rows: GivenRows
    n_jobs: int | None
    known: dict[bool, pd.DataFrame | None] = field(default_factory=dict, repr=False, compare=False)

    def __repr__(self) -> str:
        tried = sum(scan is not None for scan in self.known.values())
        return f"BetaScans({len(np.asarray(self.rows.y))} rows, {tried} of 2 scans tried)"

    def few(self, out_of_range: bool, progress: bool = False) -> pd.DataFrame | None:
        """Return the scan within the measured range or beyond it.

        None where it makes no sense or takes minutes, and without folds beyond it.
        """
        if out_of_range not in self.known:
            self.known[out_of_range] = self._few(out_of_range, progress)
        return self.known[out_of_range]

    def best_beta_before(self, out_of_range: bool = False) -> float | None:
        """Return the weight of the simulation with the best held-out score, before.

        The largest of those as good; None where there is no scan. The weights are tried when they
        are first asked for, which may take longer than the diagnosis.

        Parameters
        ----------
        out_of_range : bool, default=False
            Beyond the measured range, instead of within it.
        """
        scan = self.few(out_of_range)
        return None if scan is None else best_beta(scan, "before")

    def best_beta_after(self, out_of_range: bool = False) -> float | None:
        """Return the same after: larger where the simulation is worth more, its fault named.

        Parameters
        ----------
        out_of_range : bool, default=False
        """
        scan = self.few(out_of_range)
        return None if scan is None else best_beta(scan, "after")

    def own(
        self, X: ArrayLike | None, y: ArrayLike | None, betas: ArrayLike | None, progress: bool
    ) -> pd.DataFrame:
        """Return the scan of a user's rows or weights, within the measured range.

        Parameters
        ----------
        X, y : array-like of shape (n, n_columns), (n,), or None
            None: the measured data.
        betas : array-like or None
            None: 0, 0.1, ..., 1.
        progress : bool
        """
        before, rows = self.models[0], self.rows if X is None else GivenRows(X, y)
        grid = np.linspace(0, 1, 11) if betas is None else np.unique(as_numbers(betas, "betas"))
        X, y, *_ = without_gaps(rows.X, rows.y)
        X = complete_table(X, labels=before.experiment)
        rows = rows._replace(X=X, y=before.measured_outputs(y, "y"))
        return scan_beta(self.models, grid, scan_folds(rows.y), rows, self.n_jobs, progress)

    def _few(self, out_of_range: bool, progress: bool) -> pd.DataFrame | None:
        before = self.models[0]
        if not has_weight(before) or any(is_slow(model) for model in self.models):
            return None
        if out_of_range:
            assert before.simulation is not None
            folds = folds_beyond(before.simulation, before.measured_[0])
        else:
            folds = scan_folds(self.rows.y)
        if not folds:
            return None
        return scan_beta(self.models, np.array(_FEW_BETAS), folds, self.rows, self.n_jobs, progress)


def best_beta(scan: pd.DataFrame, word: str) -> float:
    """Return the largest weight with the best score in one column of a scan over beta."""
    return float(scan["beta"].iloc[last_of_the_best(scan[word])])


def scan_folds(y: ArrayLike) -> Folds:
    """Return the folds of a scan within the measured range."""
    return random_folds(len(np.asarray(y)), _SCAN_FOLDS, 0)


def has_weight(estimator: PowerScaledSurrogate) -> bool:
    """Return whether runs and measurements compete for the coefficients of a surrogate."""
    posterior = estimator.posterior_
    return bool(posterior.coefficients.shape[1]) and not posterior.model.basis.holds_runs


def is_slow(estimator: PowerScaledSurrogate) -> bool:
    """Return whether a fit takes long, by hyperparameters, many coefficients or many unknowns."""
    model = estimator.posterior_.model
    many = model.n_unknowns > SETTINGS.many_dimensions
    return many or bool(model.n_hyper) or len(model.basis.coefficient_mean) > _MANY_COEFFICIENTS


def scan_beta(
    models: Sequence[PowerScaledSurrogate],
    betas: FloatArray,
    folds: Folds,
    rows: GivenRows,
    n_jobs: int | None,
    progress: bool = False,
) -> pd.DataFrame:
    """Return the held-out ELPD per row of the models before and after at each weight.

    Draws come from importance sampling alone, carried from one weight to the next: an ensemble for
    every fold and weight would take minutes.

    Parameters
    ----------
    models : sequence of two PowerScaledSurrogate
        Before and after, the cause held fixed.
    betas : ndarray
    folds : list of (train, test)
    rows : GivenRows
        Measured; weights count in the fits and in the means of their scores.
    n_jobs : int or None
        Folds at the same time, as in `joblib.Parallel`.
    progress : bool, default=False
        Print how many folds are done.

    Returns
    -------
    pandas.DataFrame
        Columns beta, before, after, and before_error and after_error: the standard error of each
        score's difference from that at the best weight, paired by rows.
    """
    (before, after), values = models, np.asarray(rows.y, dtype=float)
    rows = rows._replace(y=values)
    tasks = [
        delayed(_scores_of_fold)(model, betas, rows.take(train), rows.take(test))
        for model in ([before] if after is before else models)
        for train, test in folds
    ]
    scans = in_parallel(tasks, n_jobs, progress)
    n, tests = len(folds), np.concatenate([test for _, test in folds])
    # the same tasks where nothing was detected
    scores = {"before": scans[:n], "after": scans[-n:]}
    joined = {word: np.concatenate(parts, axis=1) for word, parts in scores.items()}
    each = np.ones(len(values)) if rows.weights is None else rows.weights
    there = np.isfinite(values[tests])
    share = np.broadcast_to(each[tests].reshape(-1, *[1] * (values.ndim - 1)), there.shape)[there]
    means = {word: np.average(s, axis=1, weights=share) for word, s in joined.items()}
    errors = {f"{word}_error": _errors(s, share) for word, s in joined.items()}
    return pd.DataFrame({"beta": betas, **means, **errors})


def _scores_of_fold(
    model: PowerScaledSurrogate, betas: FloatArray, train: GivenRows, test: GivenRows
) -> FloatArray:
    """Return the log predictive density of held-out rows at each weight: (n_betas, n_held)."""
    draws = min(int(model.n_draws), FEW_DRAWS)
    quick = clone(model).set_params(sampler="importance", n_draws=draws)
    with warnings.catch_warnings():
        # fits at extreme weights are often doubtful; the curve shows it
        warnings.simplefilter("ignore", HybridSurrogateWarning)
        path = beta_path(quick, train.X, train.y, list(betas), train.weights, y_err=train.y_err)
        held = np.array(
            [m.log_predictive_density(test.X, test.y, test.y_err) for m in path.estimators]
        )
    return held[:, np.isfinite(test.y)]


def _errors(scores: FloatArray, weights: FloatArray) -> FloatArray:
    best = scores[last_of_the_best(np.average(scores, axis=1, weights=weights))]
    return np.array([mean_and_error(one - best, weights)[1] for one in scores])
