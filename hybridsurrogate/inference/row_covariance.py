"""Rows that are fewer than the coefficients: by their covariance, not that of the coefficients.

The coefficients are scaled to a standard normal prior; of each draw j there are ``rows`` (n, p)
times these, ``residual`` (n,) from their prior mean, and one noise variance.
"""

from __future__ import annotations

import numpy as np

from hybridsurrogate.cholesky import log_det_of, nudged_cholesky
from hybridsurrogate.priors import FloatArray


def marginal_of_rows(
    rows: FloatArray, residual: FloatArray, variance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return log |covariance| / variance^n and the quadratic form of the residuals, both (J,)."""
    factor = nudged_cholesky(_covariance(rows, variance))
    half = np.linalg.solve(factor, residual[..., None])[..., 0]
    log_det = 2 * log_det_of(factor)
    log_det -= rows.shape[1] * np.log(variance)
    return log_det, (half**2).sum(axis=1)


def draws_given_rows(
    rows: FloatArray,
    residual: FloatArray,
    variance: FloatArray,
    random_state: np.random.RandomState,
) -> FloatArray:
    """Draw the scaled coefficients (J, p) by conditioning draws of their prior on the rows."""
    noise = random_state.standard_normal(rows.shape[::2])
    error = np.sqrt(variance)[:, None] * random_state.standard_normal(residual.shape)
    missing = residual - (rows @ noise[..., None])[..., 0] - error
    told = np.linalg.solve(_covariance(rows, variance), missing[..., None])
    return noise + (np.swapaxes(rows, 1, 2) @ told)[..., 0]


def _covariance(rows: FloatArray, variance: FloatArray) -> FloatArray:
    out = rows @ np.swapaxes(rows, 1, 2)
    n = rows.shape[1]
    out[:, np.arange(n), np.arange(n)] += variance[:, None]
    return out
