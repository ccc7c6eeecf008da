"""Nodes of the measured world that all draws of the surrogate's coefficients share.

The likelihood at node j and draw s is quadratic in c_s, so one matrix product serves all pairs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.inference.measured import MeasuredModel
from hybridsurrogate.priors import FloatArray, Prior

# numbers in one block of matrices
_BLOCK = 500_000


@dataclass(frozen=True)
class MeasuredGiven:
    """Measured rows, and the coefficient draws c (S, p) given which their world is inferred.

    The rows are X (n, n_columns) and y (n,), on the scale of eta, with weights (n,); ``scale`` is
    the spread of the output.
    """

    model: MeasuredModel
    X: FloatArray
    y: FloatArray
    weights: FloatArray
    c: FloatArray
    noise_prior: Prior
    scale: float


def squares_of_pairs(features: FloatArray, residual: FloatArray, c: FloatArray) -> FloatArray:
    """Return |residual_j - features_j c_s|^2 for all j and s, from p-dimensional products.

    Centred at the mean draw, so that nothing large cancels.
    """
    centre = c.mean(axis=0)
    delta = c - centre
    p = features.shape[2]
    upper = np.triu_indices(p)
    twice = np.where(upper[0] == upper[1], 1.0, 2.0)
    products = (delta[:, upper[0]] * delta[:, upper[1]] * twice).T
    total = np.empty((len(features), len(c)))
    # in blocks that stay in the processor's cache
    step = max(1, _BLOCK // p**2) if p else len(features)
    for first in range(0, len(features), step):
        block = slice(first, first + step)
        rest = residual[block] - features[block] @ centre[:, None]
        transposed = np.swapaxes(features[block], 1, 2)
        squares = (transposed @ features[block])[:, upper[0], upper[1]]
        cross = (transposed @ rest)[..., 0]
        total[block] = np.einsum("jnk,jnk->j", rest, rest)[:, None] + squares @ products
        total[block] -= 2 * cross @ delta.T
    return np.maximum(total, 0.0)


def node_shares(log_weight: FloatArray) -> FloatArray:
    """Return weights (J, S) of nodes that sum to one for each draw."""
    weight = np.exp(log_weight - log_weight.max(axis=0))
    return weight / weight.sum(axis=0)


def one_node_each(weight: FloatArray, random_state: np.random.RandomState) -> NDArray[np.intp]:
    """Return the index of one node for each draw, by inversion of weights (J, S)."""
    cumulative = np.cumsum(weight, axis=0)
    target = random_state.uniform(size=weight.shape[1]) * cumulative[-1]
    return np.minimum((cumulative < target).sum(axis=0), len(weight) - 1)
