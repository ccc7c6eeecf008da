"""How far the predictions of several simulations differ, as they are and once extended."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from hybridsurrogate.types import FloatArray

# draws of each, of which mean and spread are taken
_DRAWS = 400


def agreement(
    before: Mapping[str, Any], after: Mapping[str, Any] | None, X: ArrayLike
) -> pd.DataFrame:
    """Return how far each pair of simulations differs at measured rows.

    Parameters
    ----------
    before, after : dict of name to fitted estimator
        As they are, and extended; None: not diagnosed.
    X : array-like of shape (n, n_columns)

    Returns
    -------
    DataFrame
        One row a pair: "first", "second", and "before" and "after": the root mean square over the
        rows of the difference of their noise-free predictions, each in units of its posterior
        standard deviation. At most one where they agree to within their uncertainty.
    """
    columns = {"before": before} if after is None else {"before": before, "after": after}
    moments = {
        word: {name: _moments(one, X) for name, one in models.items()}
        for word, models in columns.items()
    }
    rows = [
        {
            "first": one,
            "second": other,
            **{word: _apart(known[one], known[other]) for word, known in moments.items()},
        }
        for one, other in combinations(before, 2)
    ]
    return pd.DataFrame(rows)


def _moments(estimator: Any, X: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return mean and variance of the noise-free predictions."""
    draws = estimator.sample_predictive_mean(X, n_draws=_DRAWS)
    return np.mean(draws, axis=0), np.var(draws, axis=0)


def _apart(one: tuple[FloatArray, FloatArray], other: tuple[FloatArray, FloatArray]) -> float:
    gap, variance = one[0] - other[0], one[1] + other[1]
    squares = np.divide(gap**2, variance, out=np.zeros_like(gap), where=variance > 0)
    return float(np.sqrt(np.mean(squares)))
