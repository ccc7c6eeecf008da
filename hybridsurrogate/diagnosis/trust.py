"""How much weight a simulation deserves, before and after its fault is named."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from sklearn.base import clone

from hybridsurrogate.diagnosis.folds import Folds
from hybridsurrogate.estimators.beta_path import beta_path
from hybridsurrogate.estimators.power_scaled import PowerScaledSurrogate
from hybridsurrogate.exceptions import HybridSurrogateWarning
from hybridsurrogate.priors import FloatArray
from hybridsurrogate.scoring.scores import last_of_the_best, paired_difference

# scores of single weights differ by more than the error of so many draws
_DRAWS = 200


def scan_beta(
    models: Sequence[PowerScaledSurrogate],
    betas: FloatArray,
    folds: Folds,
    take: Callable[[NDArray[np.intp]], ArrayLike],
    y: FloatArray,
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
    take : callable
        Returns X at given rows.
    y : ndarray of shape (n,)

    Returns
    -------
    pandas.DataFrame
        Columns beta, before, after, and before_error and after_error: the standard error of each
        score's difference from that at the best weight, paired by rows.
    """
    rows: dict[str, FloatArray] = {}
    for word, model in zip(("before", "after"), models, strict=True):
        if word == "after" and model is models[0]:
            rows[word] = rows["before"]
            continue
        draws = min(int(model.n_draws), _DRAWS)
        quick = clone(model).set_params(sampler="importance", n_draws=draws)
        scores = []
        with warnings.catch_warnings():
            # fits at extreme weights are often doubtful; the curve shows it
            warnings.simplefilter("ignore", HybridSurrogateWarning)
            for train, test in folds:
                path = beta_path(quick, take(train), y[train], list(betas))
                scores.append(
                    [m.log_predictive_density(take(test), y[test]) for m in path.estimators]
                )
        rows[word] = np.concatenate(scores, axis=1)
    means = {word: scores.mean(axis=1) for word, scores in rows.items()}
    errors = {f"{word}_error": _errors(scores) for word, scores in rows.items()}
    return pd.DataFrame({"beta": betas, **means, **errors})


def _errors(scores: FloatArray) -> FloatArray:
    best = scores[last_of_the_best(scores.mean(axis=1))]
    return np.array([paired_difference(one, best).standard_error for one in scores])


def best_betas(scan: pd.DataFrame) -> tuple[float, float]:
    """Return the largest weights with the best score before and after the extension."""
    before, after = (float(scan["beta"][last_of_the_best(scan[w])]) for w in ("before", "after"))
    return before, after
