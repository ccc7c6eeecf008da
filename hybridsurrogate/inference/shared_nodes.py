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
    first, second, products = _products(delta)
    total = np.empty((len(features), len(c)))
    for block in _blocks(len(features), features.shape[2]):
        rest = residual[block] - features[block] @ centre[:, None]
        transposed = np.swapaxes(features[block], 1, 2)
        squares = (transposed @ features[block])[:, first, second]
        cross = (transposed @ rest)[..., 0]
        total[block] = np.einsum("jnk,jnk->j", rest, rest)[:, None] + squares @ products
        total[block] -= 2 * cross @ delta.T
    return np.maximum(total, 0.0)


def squares_of_factors(
    of_inputs: FloatArray, of_parameters: FloatArray, residual: FloatArray, c: FloatArray
) -> FloatArray:
    """Return the same for features_j = of_inputs * of_parameters_j and one residual (n,).

    Their Gram matrices are that of ``of_inputs`` times an outer product, whatever the number of
    rows.
    """
    centre = c.mean(axis=0)
    delta = c - centre
    first, second, products = _products(delta)
    products *= (of_inputs.T @ of_inputs)[first, second][:, None]
    total = np.empty((len(of_parameters), len(c)))
    for block in _blocks(len(of_parameters), of_parameters.shape[1]):
        part = of_parameters[block]
        rest = residual - (part * centre) @ of_inputs.T
        cross = part * (rest @ of_inputs)
        total[block] = np.einsum("jn,jn->j", rest, rest)[:, None]
        total[block] += (part[:, first] * part[:, second]) @ products
        total[block] -= 2 * cross @ delta.T
    return np.maximum(total, 0.0)


def _products(delta: FloatArray) -> tuple[NDArray[np.intp], NDArray[np.intp], FloatArray]:
    """Return pairs of coefficients, and their products in each draw, both orders counted."""
    first, second = np.triu_indices(delta.shape[1])
    twice = np.where(first == second, 1.0, 2.0)
    return first, second, (delta[:, first] * delta[:, second] * twice).T


def _blocks(n: int, p: int) -> list[slice]:
    """Cut n matrices (p, p) into blocks that stay in the processor's cache."""
    step = max(1, _BLOCK // p**2) if p else n
    return [slice(k, k + step) for k in range(0, n, step)]


def node_shares(log_weight: FloatArray) -> FloatArray:
    """Return weights (J, S) of nodes that sum to one for each draw."""
    weight = np.exp(log_weight - log_weight.max(axis=0))
    return weight / weight.sum(axis=0)


def one_node_each(weight: FloatArray, random_state: np.random.RandomState) -> NDArray[np.intp]:
    """Return the index of one node for each draw, by inversion of weights (J, S)."""
    cumulative = np.cumsum(weight, axis=0)
    target = random_state.uniform(size=weight.shape[1]) * cumulative[-1]
    return np.minimum((cumulative < target).sum(axis=0), len(weight) - 1)
