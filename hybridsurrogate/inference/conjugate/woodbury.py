"""Rows that are fewer than the coefficients: by their covariance, not that of the coefficients.

Of each draw j there are ``rows`` (n, p) of the coefficients, ``residual`` (n,) from their prior
mean, and one noise variance. What is known of the coefficients before these rows comes as
`FixedRows`, in whose coordinates they are independent.
"""

from __future__ import annotations

import numpy as np

from hybridsurrogate.inference.conjugate.spectral import FixedRows
from hybridsurrogate.numerics.cholesky import log_det_of, nudged_cholesky
from hybridsurrogate.types import FloatArray


def marginal_of_rows(
    rows: FloatArray, residual: FloatArray, variance: FloatArray, before: FixedRows
) -> tuple[FloatArray, FloatArray]:
    """Return log |covariance| / variance^n and the quadratic form, of all rows, both (J,)."""
    centre, sd = before.given(variance)
    rows, residual = _standardised(rows, residual, before, centre, sd)
    factor = nudged_cholesky(_covariance(rows, variance))
    half = np.linalg.solve(factor, residual[..., None])[..., 0]
    log_det, rest, _ = before.marginal(variance)
    log_det = log_det + 2 * log_det_of(factor) - rows.shape[1] * np.log(variance)
    return log_det, rest + (half**2).sum(axis=1)


def draws_given_rows(
    rows: FloatArray,
    residual: FloatArray,
    variance: FloatArray,
    before: FixedRows,
    random_state: np.random.RandomState,
) -> FloatArray:
    """Draw the coefficients (J, p) by conditioning draws from before the rows on them."""
    centre, sd = before.given(variance)
    rows, residual = _standardised(rows, residual, before, centre, sd)
    noise = random_state.standard_normal(rows.shape[::2])
    error = np.sqrt(variance)[:, None] * random_state.standard_normal(residual.shape)
    missing = residual - (rows @ noise[..., None])[..., 0] - error
    solved = np.linalg.solve(_covariance(rows, variance), missing[..., None])
    v = noise + (np.swapaxes(rows, 1, 2) @ solved)[..., 0]
    return before.mean + (centre + sd * v) @ before.axes.T


def _standardised(
    rows: FloatArray, residual: FloatArray, before: FixedRows, centre: FloatArray, sd: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return rows of coefficients that are standard normal before them, and their residuals."""
    rows = rows @ before.axes
    residual = residual - (rows @ centre[..., None])[..., 0]
    rows *= sd[:, None]
    return rows, residual


def _covariance(rows: FloatArray, variance: FloatArray) -> FloatArray:
    out = rows @ np.swapaxes(rows, 1, 2)
    n = rows.shape[1]
    out[:, np.arange(n), np.arange(n)] += variance[:, None]
    return out
