"""Cholesky factors of many matrices at once."""

from __future__ import annotations

import numpy as np

from hybridsurrogate.priors import FloatArray


def nudged_cholesky(matrices: FloatArray) -> FloatArray:
    """Return Cholesky factors (J, p, p), all nudged where rounding made one indefinite."""
    try:
        return np.linalg.cholesky(matrices)
    except np.linalg.LinAlgError:
        # rounding can make a nearly singular matrix indefinite: nudge by its own size
        size = matrices.shape[-1]
        nudge = 1e-10 * np.einsum("jkk->jk", matrices)
        matrices = matrices.copy()
        matrices[:, np.arange(size), np.arange(size)] += nudge
        return np.linalg.cholesky(matrices)


def log_det_of(factors: FloatArray) -> FloatArray:
    """Return the log determinants (J,) of triangular factors (J, p, p)."""
    return np.log(np.diagonal(factors, axis1=1, axis2=2)).sum(axis=1)
