"""A cause linearised: the model of the measured rows around one point.

Around one point the model of the measured rows is linear in the simulation's parameters (as
standard normal z) and in the *sizes* of the cause: the coefficients of its columns, or a gain, a
constant, a slope measured from the value at which it changes nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.inference.layout import Layout
from hybridsurrogate.inference.measured import MeasuredModel
from hybridsurrogate.inference.statistics import Statistics
from hybridsurrogate.priors import FloatArray
from hybridsurrogate.surrogates.base import Basis

_STEP = 1e-3
_ABSURD = 1e100
# a size that is a parameter of its own keeps within its prior: z displaced by its prior sd at most
_SIZE_CAP = 1.0


class Belief(NamedTuple):
    """Gaussian belief about the surrogate's coefficients: mean (p,) and factor (p, p) of V."""

    mean: FloatArray
    factor: FloatArray


def coefficient_belief(basis: Basis, simulation: Statistics | None, power: float = 1.0) -> Belief:
    """Return what the simulation alone says about the coefficients, its noise estimated."""
    precision = basis.coefficient_sd**-2.0
    mean = basis.coefficient_mean
    if simulation is None or not power or not len(mean):
        return Belief(mean, np.diag(basis.coefficient_sd))
    variance = max(simulation.yy / simulation.n, 1e-300)
    for _ in range(8):
        matrix = np.diag(precision) + power * simulation.ff / variance
        right = precision * basis.coefficient_mean + power * simulation.fy / variance
        mean = np.linalg.solve(matrix, right)
        squares = simulation.yy - 2 * mean @ simulation.fy + mean @ simulation.ff @ mean
        used = np.trace(np.linalg.solve(matrix, power * simulation.ff / variance))
        variance = max(squares, 1e-14 * simulation.yy) / max(simulation.n - used, 1.0)
    lower = np.linalg.cholesky(np.diag(precision) + power * simulation.ff / variance)
    return Belief(mean, np.linalg.inv(lower).T)


@dataclass(frozen=True)
class Linearised:
    """The model of measured rows around one point.

    ``y = mean + G @ g + H_t @ h + U @ u + noise_t * e`` with g, u ~ N(0, I), e ~ N(0, sigma^2 I),
    columns of H with unit root mean square, so that h is the size of the effect in units of y.

    Attributes
    ----------
    mean : ndarray of shape (M, n)
        M is 1 where the nodes do not touch the simulation, else T.
    G : ndarray of shape (M, n, d)
    H : ndarray of shape (T, n, q)
    H_rms : ndarray of shape (T, q)
        What was divided out of H.
    cap : ndarray of shape (T, q)
        Largest prior scale of each size in units of y; infinity for columns.
    U : ndarray of shape (n, r)
        Factor of the known covariance: the emulator's own error, a remainder.
    log_weight : ndarray of shape (T,)
    noise : ndarray of shape (K, n) or None
        Factor on sigma, K is 1 where the nodes do not touch it, else T. None: one everywhere.
    outliers : ndarray of shape (T,) or None
        Share of rows that are outliers; e then has heavy tails. None: e is normal.
    """

    mean: FloatArray
    G: FloatArray
    H: FloatArray
    H_rms: FloatArray
    cap: FloatArray
    U: FloatArray
    log_weight: FloatArray
    noise: FloatArray | None = None
    outliers: FloatArray | None = None

    def at(self, index: NDArray[np.intp]) -> Linearised:
        """Return the model at some of the nodes."""
        several = len(self.mean) > 1
        noise = self.noise
        return replace(
            self,
            mean=self.mean[index] if several else self.mean,
            G=self.G[index] if several else self.G,
            H=self.H[index],
            H_rms=self.H_rms[index],
            cap=self.cap[index],
            log_weight=self.log_weight[index],
            noise=noise if noise is None or len(noise) == 1 else noise[index],
            outliers=None if self.outliers is None else self.outliers[index],
        )

    @property
    def noise_differs(self) -> bool:
        """Whether the nodes differ in the noise of single rows."""
        several = self.noise is not None and len(self.noise) > 1
        return several or self.outliers is not None

    def by_noise(self) -> list[tuple[Linearised, FloatArray]]:
        """Split into models of unit noise factor, rows scaled, each with its factor (n,)."""
        if self.noise is None:
            return [(self, np.ones(1))]
        everything = np.arange(len(self.H))
        nodes = [everything] if len(self.noise) == 1 else list(everything[:, None])
        return [
            (self.at(index)._over(factor), factor)
            for index, factor in zip(nodes, self.noise, strict=True)
        ]

    def _over(self, factor: FloatArray) -> Linearised:
        column = factor[:, None]
        return replace(
            self,
            mean=self.mean / factor,
            G=self.G / column,
            H=self.H / column,
            U=self.U / column,
            noise=None,
        )


def columns_at_nodes(
    model: MeasuredModel, X: FloatArray, plan: Layout, z: FloatArray
) -> FloatArray:
    """Return the columns of all causes at every node, (T, n, q)."""
    return model.added(X, _values_at_nodes(model, plan, z))


def _values_at_nodes(model: MeasuredModel, plan: Layout, z: FloatArray) -> FloatArray:
    values = np.repeat(model.values(z[None]), len(plan.grid), axis=0)
    values[:, plan.nodes] = plan.grid
    return values


def _noise_at_nodes(
    model: MeasuredModel, X: FloatArray, plan: Layout, z: FloatArray, simulated: FloatArray
) -> FloatArray | None:
    """Return the noise factor where it differs from one, (T, n), or (1, n) for all nodes.

    Where noise follows the simulation's output, it is that at z, ``simulated`` (n,).
    """
    if not any(effect.touches_noise for effect in model.effects):
        return None
    values = _values_at_nodes(model, plan, z)
    values = values if model.effects[-1].touches_noise else values[:1]
    noise = model.noise(X, values, np.nan_to_num(simulated))
    return None if noise.shape[1] == 1 else noise


def _outliers_at_nodes(model: MeasuredModel, plan: Layout, z: FloatArray) -> FloatArray | None:
    if not any(effect.has_outliers for effect in model.effects):
        return None
    return model.outlier_share(_values_at_nodes(model, plan, z))


def linearise(
    model: MeasuredModel,
    X: FloatArray,
    belief: Belief,
    plan: Layout,
    z: FloatArray,
    columns: FloatArray | None = None,
) -> Linearised:
    """Linearise around z (n_unknowns,), at all nodes of the grid.

    The columns of earlier causes join G with their prior sd; those of the last one are sizes.
    ``columns`` may be given where they are known from `columns_at_nodes`.
    """
    in_simulation = bool(len(plan.nodes)) and model.effects[-1].touches_simulation
    T = len(plan.grid)
    M = T if in_simulation else 1
    directions = np.concatenate([plan.fixed, plan.sizes])
    points = np.broadcast_to(z, (M, 1 + 2 * len(directions), len(z))).copy()
    for k, position in enumerate(directions):
        points[:, 1 + 2 * k, position] += _STEP
        points[:, 2 + 2 * k, position] -= _STEP
    values = model.values(points)
    if in_simulation:
        values[:, :, plan.nodes] = plan.grid[:, None, :]
    known, features, _ = model.simulated(X, values.reshape(-1, len(z)))
    response = known + features @ belief.mean
    # a simulation may fail far out: NaN marks the place and is never better than another one
    response = np.where(np.abs(response) < _ABSURD, response, np.nan)
    response = response.reshape(M, 1 + 2 * len(directions), len(X))
    slopes = (response[:, 1::2] - response[:, 2::2]) / (2 * _STEP)
    slopes = np.where(np.isfinite(slopes), slopes, 0.0)
    d = len(plan.fixed)
    G = np.swapaxes(slopes[:, :d], 1, 2)
    H: FloatArray = np.swapaxes(slopes[:, d:], 1, 2)
    # expand around the prior's centre: fixed directions at 0, sizes at their neutral value
    mean = response[:, 0] - G @ z[plan.fixed] - H @ (z[plan.sizes] - plan.neutral[plan.sizes])

    own = np.array([owner == len(model.effects) - 1 for owner, _ in model.column_names], dtype=bool)
    if len(own):
        if columns is None:
            columns = columns_at_nodes(model, X, plan, z)
        earlier = columns[:1, :, ~own] * model.column_sd[~own]
        G = np.concatenate([G, np.broadcast_to(earlier, (M, *earlier.shape[1:]))], axis=2)
        if H.shape[2]:
            H = np.concatenate([np.broadcast_to(H, (T, *H.shape[1:])), columns[:, :, own]], axis=2)
        else:
            H = columns[:, :, own]
    H = np.broadcast_to(H, (T, len(X), H.shape[2]))
    rms: FloatArray = np.sqrt(np.einsum("tnq,tnq->tq", H, H) / len(X))
    if model.effects and model.effects[-1].is_process:
        # the basis of a process is one object: its prior variance per row, not per column
        rms = np.broadcast_to(np.sqrt(np.sum(rms**2, axis=1, keepdims=True)), rms.shape)
    rms = np.maximum(rms, 1e-12 * max(float(np.max(rms, initial=0.0)), 1e-300))
    cap = np.full(rms.shape, np.inf)
    cap[:, : len(plan.sizes)] = _SIZE_CAP * rms[:, : len(plan.sizes)]
    U = features[0] @ belief.factor
    noise = _noise_at_nodes(model, X, plan, z, response[0, 0])
    outliers = _outliers_at_nodes(model, plan, z)
    H = H / rms[:, None, :]
    return Linearised(mean, G, H, rms, cap, U, plan.log_weight, noise, outliers)
