"""Nodes of the measured world that all draws of the surrogate's coefficients share.

The likelihood at node j and draw s is quadratic in c_s, so one matrix product serves all pairs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.inference.conjugate.factored_rows import FactoredRows
from hybridsurrogate.inference.sampling.settings import SETTINGS
from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.numerics.linear_algebra import BLOCK, LARGE_BLOCK, SINGULAR, blocks
from hybridsurrogate.numerics.psis import level_smooth
from hybridsurrogate.types import FloatArray, Prior


@dataclass(frozen=True)
class SharedDraws:
    """Draws c (S, p) of coefficients, with what sums of squares need of them."""

    c: FloatArray

    @cached_property
    def centre(self) -> FloatArray:
        """Mean draw, around which products are formed, so that nothing large cancels."""
        return self.c.mean(axis=0)

    @cached_property
    def delta(self) -> FloatArray:
        """Deviations from the mean draw, (S, p)."""
        return self.c - self.centre

    @cached_property
    def principal(self) -> tuple[FloatArray, FloatArray]:
        """The draws as v @ axes' with v (S, k) of mean square one: v, and axes (p, k)."""
        left, size, right = np.linalg.svd(self.c, full_matrices=False)
        informed = size > SINGULAR * size[0]
        root = np.sqrt(len(self.c))
        return root * left[:, informed], right[informed].T * size[informed] / root

    @cached_property
    def pairs(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Both coefficients of every pair."""
        first, second = np.triu_indices(self.c.shape[1])
        return first, second

    @cached_property
    def products(self) -> FloatArray:
        """Products of every pair of deviations in each draw, both orders counted, (pairs, S)."""
        first, second = self.pairs
        twice = np.where(first == second, 1.0, 2.0)
        return (self.delta[:, first] * self.delta[:, second] * twice).T


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

    @cached_property
    def _factored(self) -> FactoredRows:
        return FactoredRows(self.model, self.X, self.y, np.sqrt(self.weights))

    @cached_property
    def features_and_rest(self) -> tuple[FloatArray, FloatArray] | None:
        """The inputs' part of the features (m, p) and y minus the fixed mean (m,), or None.

        Times the roots of the weights; None where features do not factorise. Where columns of
        causes do too, the m rows are few, and have the squares of all n measured ones.
        """
        if not self.model.factorises:
            return None
        factored = self._factored
        rows = factored.compressed if factored.products.all() else factored.of_rows
        return rows[:, : self.c.shape[1]], rows[:, -1]

    def parameters_part(self, values: FloatArray) -> FloatArray:
        """Return the parameters' part (J, p) of the features, for draws of the unknowns."""
        return self._factored.of_draws(values)[:, : self.c.shape[1]]

    def columns(self, values: FloatArray) -> FloatArray:
        """Return the causes' columns in units of their prior sd, which `features_and_rest` lacks.

        For draws of the unknowns, (J, m, q).
        """
        model, factored, p = self.model, self._factored, self.c.shape[1]
        if factored.products.all():
            added = factored.compressed[:, p:-1] * factored.of_draws(values)[:, None, p:-1]
        else:
            added = model.added(self.X, values) * factored.root[:, None]
        return added * model.column_sd

    @cached_property
    def draws(self) -> SharedDraws:
        """The coefficient draws, with what all nodes share of them."""
        return SharedDraws(self.c)

    @property
    def n_rows(self) -> int:
        """How many rows are formed."""
        return len(self.y if self.features_and_rest is None else self.features_and_rest[1])

    def of_pairs(self, u: FloatArray, c: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return what each point u (K, d) leaves with its own coefficients c (K, p).

        Residuals (K, m) and columns of the causes in units of their prior sd (K, m, q), both in
        standard deviations of the noise, and the log of these, summed over the rows, (K,).
        """
        model, sigma, rows = self.model, np.exp(u[:, -1:]), self.features_and_rest
        values = model.values(u[:, :-1])
        if rows is not None:
            of_inputs, rest = rows
            fitted = (self.parameters_part(values) * c) @ of_inputs.T
            columns = self.columns(values) / sigma[..., None]
            return (rest - fitted) / sigma, columns, u[:, -1] * self.weights.sum()
        output, noise = model.outputs(self.X, values, c)
        scale = np.broadcast_to(noise * sigma, output.shape)
        weighted = np.sqrt(self.weights) / scale
        columns = model.added(self.X, values) * model.column_sd * weighted[..., None]
        return (self.y - output) * weighted, columns, np.log(scale) @ self.weights


def squares_of_pairs(features: FloatArray, residual: FloatArray, draws: SharedDraws) -> FloatArray:
    """Return |residual_j - features_j c_s|^2 for all j and s.

    Few rows row by row, many from p-dimensional products.
    """
    J, n, p = features.shape
    c = draws.c
    if 2 * n < p:
        return _row_by_row(features, residual, c)
    centre, delta, products = draws.centre, draws.delta, draws.products
    first, second = draws.pairs
    total = np.empty((J, len(c)))
    # the products are read once for each block: not for a handful of nodes
    for block in blocks(J, p**2, LARGE_BLOCK):
        rest = residual[block] - features[block] @ centre[:, None]
        transposed = np.swapaxes(features[block], 1, 2)
        squares = (transposed @ features[block])[:, first, second]
        cross = (transposed @ rest)[..., 0]
        total[block] = np.einsum("jnk,jnk->j", rest, rest)[:, None] + squares @ products
        total[block] -= 2 * cross @ delta.T
    return np.maximum(total, 0.0)


def _row_by_row(features: FloatArray, residual: FloatArray, c: FloatArray) -> FloatArray:
    J, n, p = features.shape
    total = np.empty((J, len(c)))
    for block in blocks(J, n * len(c), BLOCK):
        # one product of matrices, not one for each j: a third of the time
        rest = (features[block].reshape(-1, p) @ c.T).reshape(-1, n, len(c)) - residual[block]
        total[block] = np.einsum("jns,jns->js", rest, rest)
    return total


def squares_of_factors(
    of_inputs: FloatArray, of_parameters: FloatArray, residual: FloatArray, draws: SharedDraws
) -> FloatArray:
    """Return the same for features_j = of_inputs * of_parameters_j and one residual (n,).

    Features that share their factor of the inputs, as polynomials do, are added up first. Where too
    few do, Gram matrices are that of ``of_inputs`` times an outer product, whatever the number of
    rows.
    """
    p = of_inputs.shape[1]
    # `numpy.unique` of columns takes longer than all else for a few draws
    known: dict[bytes, int] = {}
    group = np.array([known.setdefault(one.tobytes(), len(known)) for one in of_inputs.T])
    distinct = of_inputs[:, np.unique(group, return_index=True)[1]]
    g = distinct.shape[1]
    if p + min(len(distinct), g) * g < p**2 / 2:
        return _squares_of_groups(distinct, group, of_parameters, residual, draws.c)
    centre, delta = draws.centre, draws.delta
    first, second = draws.pairs
    products = draws.products * (of_inputs.T @ of_inputs)[first, second][:, None]
    total = np.empty((len(of_parameters), len(draws.c)))
    for block in blocks(len(of_parameters), p**2, LARGE_BLOCK):
        part = of_parameters[block]
        rest = residual - (part * centre) @ of_inputs.T
        cross = part * (rest @ of_inputs)
        total[block] = np.einsum("jn,jn->j", rest, rest)[:, None]
        total[block] += (part[:, first] * part[:, second]) @ products
        total[block] -= 2 * cross @ delta.T
    return np.maximum(total, 0.0)


def _squares_of_groups(
    distinct: FloatArray,
    group: NDArray[np.intp],
    of_parameters: FloatArray,
    residual: FloatArray,
    c: FloatArray,
) -> FloatArray:
    """Return squares for factors of the inputs ``distinct[:, group]``, in the space they span."""
    Q, R = np.linalg.qr(distinct)
    along = Q.T @ residual
    beyond = residual - Q @ along
    g, J, S = len(R.T), len(of_parameters), len(c)
    # columns in one piece, and blocks that stay in the processor's cache with their residuals: half
    # of the time
    members = [(of_parameters[:, group == k], c.T[group == k]) for k in range(g)]
    total = np.full((J, S), beyond @ beyond)
    for block in blocks(J, 2 * g * S, BLOCK):
        sums = np.stack([of_j[block] @ of_s for of_j, of_s in members]).reshape(g, -1)
        rest = R @ sums
        rest -= along[:, None]
        total[block] += np.einsum("rm,rm->m", rest, rest).reshape(-1, S)
    return total


def node_shares(log_weight: FloatArray) -> FloatArray:
    """Return weights (J, S) of nodes that sum to one for each draw."""
    weight = log_weight - log_weight.max(axis=0)
    np.exp(weight, out=weight)
    weight /= weight.sum(axis=0)
    return weight


def quality(log_weight: FloatArray, share: FloatArray, most: int) -> tuple[float, float]:
    """Return k-hat and effective number of weights (J, S), medians over draws.

    The former over ``most`` of them.
    """
    S = log_weight.shape[1]
    some = np.linspace(0, S - 1, min(most, S)).astype(int)
    khat = float(np.median([level_smooth(log_weight[:, s])[1] for s in some]))
    return khat, float(np.median(1 / np.sum(share**2, axis=0)))


def one_node_each(weight: FloatArray, random_state: np.random.RandomState) -> NDArray[np.intp]:
    """Return the index of one node for each draw, by inversion of weights (J, S)."""
    cumulative = np.cumsum(weight, axis=0)
    target = random_state.uniform(size=weight.shape[1]) * cumulative[-1]
    return np.minimum((cumulative < target).sum(axis=0), len(weight) - 1)


def main_directions(problem: MeasuredGiven, z: FloatArray, sigma: float) -> MeasuredGiven:
    """Return the problem with only those directions of the coefficients that its rows notice.

    At the measured inputs hundreds of features span some tens of directions: the principal
    components of the outputs of all draws at some of the nodes. A fit of 100 runs by Kriging takes
    14 instead of 26 s with 300 measured rows, and as long with 30.

    Parameters
    ----------
    problem : MeasuredGiven
    z : ndarray of shape (J, n_unknowns)
        Nodes at which it will be asked for.
    sigma : float
        Standard deviation of the noise.

    Returns
    -------
    MeasuredGiven
        As it was where features factorise, none exist, or noise or a cause follows their output.
    """
    model, c = problem.model, problem.c
    follows = model.noise_follows or any("response" in effect.acts_on for effect in model.effects)
    if model.factorises or follows or not c.shape[1]:
        return problem
    asked = max(1, LARGE_BLOCK // (len(problem.y) * c.shape[1]))
    some = np.unique(np.linspace(0, len(z) - 1, min(len(z), asked)).astype(int))
    features = model.parts(problem.X, model.values(z[some])).features.reshape(-1, c.shape[1])
    features = features[np.isfinite(features).all(axis=1)]
    v, axes = problem.draws.principal
    seen, turn = np.linalg.eigh(axes.T @ (features.T @ features) @ axes)
    left_out = np.sqrt(np.cumsum(np.maximum(seen, 0.0)) / max(len(features), 1))
    turned = turn[:, left_out > SETTINGS.output_truncation * sigma]
    model = replace(model, basis=model.basis.along(axes @ turned))
    return replace(problem, model=model, c=v @ turned)
