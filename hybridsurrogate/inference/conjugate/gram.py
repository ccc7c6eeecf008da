"""Gram matrices of [features, y], [[G, g], [g', yy]], one for each draw: (J, p + 1, p + 1)."""

from __future__ import annotations

import numpy as np

from hybridsurrogate.numerics.cholesky import nudged_cholesky
from hybridsurrogate.types import FloatArray


def whitened(gram: FloatArray, whitening: FloatArray) -> FloatArray:
    """Return Gram matrices of ``features @ whitening``, for whitening (J, p, r)."""
    size = whitening.shape[2] + 1
    out = np.empty((len(gram), size, size))
    transposed = np.swapaxes(whitening, 1, 2)
    out[:, :-1, :-1] = transposed @ gram[:, :-1, :-1] @ whitening
    out[:, :-1, -1:] = transposed @ gram[:, :-1, -1:]
    out[:, -1:, :-1] = np.swapaxes(out[:, :-1, -1:], 1, 2)
    out[:, -1, -1] = gram[:, -1, -1]
    return out


def posterior_factor(
    gram: FloatArray, noise_precision: FloatArray, mean: FloatArray, precision: FloatArray
) -> FloatArray:
    """Return the Cholesky factor of [[Lambda, b], [b', c]] for each draw; gram is overwritten.

    Its last row is (L^-1 b)' and the root of c - b' Lambda^-1 b, so one factorisation gives the
    determinant, the quadratic form and the conditional mean of the coefficients. NaN where the
    Gram matrix is not finite.

    Parameters
    ----------
    gram : ndarray of shape (J, p + 1, p + 1)
    noise_precision : ndarray of shape (J,)
    mean, precision : ndarray of shape (p,)
        Of the coefficients' prior.
    """
    gram *= noise_precision[:, None, None]
    prior = np.diag(np.append(precision, precision @ mean**2))
    prior[-1, :-1] = prior[:-1, -1] = precision * mean
    gram += prior
    # a simulation may fail for some parameters: those are impossible, not an error
    broken = ~np.isfinite(gram.sum(axis=(1, 2)))
    gram[broken] = np.eye(gram.shape[1])
    factor = nudged_cholesky(gram)
    factor[broken] = np.nan
    return factor
