"""Scores of predictions: expected log predictive density, error, coverage, paired gains."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hybridsurrogate.priors import FloatArray


def elpd(log_predictive_density: ArrayLike) -> tuple[float, float]:
    """Return the mean log predictive density per row and its standard error.

    Parameters
    ----------
    log_predictive_density : array-like of shape (n,)

    Examples
    --------
    >>> elpd([-1.0, -2.0, -3.0])[0]
    -2.0
    """
    values = np.asarray(log_predictive_density, dtype=float)
    return float(values.mean()), _standard_error(values)


def rmse(draws: ArrayLike, truth: ArrayLike) -> float:
    """Return the mean over rows of the root mean square error over draws.

    As in arXiv 2412.11875, section 3: RMSE = mean_i sqrt(mean_s (mu_si - mu_i)^2).

    Parameters
    ----------
    draws : array-like of shape (n_draws, n)
        Noise-free predictions, as from ``sample_predictive_mean``.
    truth : array-like of shape (n,)

    Examples
    --------
    >>> rmse([[0.0, 1.0], [0.0, 3.0]], [0.0, 2.0])
    0.5
    """
    error = np.asarray(draws, dtype=float) - np.asarray(truth, dtype=float)
    return float(np.sqrt(np.mean(error**2, axis=0)).mean())


def coverage(y: ArrayLike, lower: ArrayLike, upper: ArrayLike) -> float:
    """Return the share of rows inside their interval.

    Examples
    --------
    >>> coverage([0.0, 5.0], [-1.0, -1.0], [1.0, 1.0])
    0.5
    """
    y = np.asarray(y, dtype=float)
    return float(np.mean((y >= np.asarray(lower)) & (y <= np.asarray(upper))))


@dataclass(frozen=True)
class PairedDifference:
    """A difference of two scores on the same rows, and its standard error."""

    difference: float
    standard_error: float


def paired_difference(after: ArrayLike, before: ArrayLike) -> PairedDifference:
    """Return the mean difference of two pointwise scores with its paired standard error.

    Examples
    --------
    >>> paired_difference([1.0, 3.0], [0.0, 1.0]).difference
    1.5
    """
    values = np.asarray(after, dtype=float) - np.asarray(before, dtype=float)
    return PairedDifference(float(values.mean()), _standard_error(values))


def _standard_error(values: FloatArray) -> float:
    if len(values) < 2:
        return float("nan")
    return float(values.std(ddof=1) / np.sqrt(len(values)))
