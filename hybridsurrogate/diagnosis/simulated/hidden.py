"""Causes of a given size, drawn from their priors, at rows in which nothing else is wrong.

The size of a cause in the output is the root mean square, over the rows, of what the simulation's
parameters cannot follow of it, in standard deviations of the noise. Of a cause in the noise it is
the largest standard deviation of a row over the smallest, less one; of noise that neighbouring rows
share, the size of the shared part in that of the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hybridsurrogate.diagnosis.search.candidate import prior_odds
from hybridsurrogate.diagnosis.simulated.place import Place, output_of
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.inference.evidence.grid import Grid, make_grid, with_cells
from hybridsurrogate.inference.evidence.linearised import Linearised, linearised_pieces
from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.types import FloatArray

# draws of a cause's shape at a place
_SHAPES = 256
# parameters that follow more of a curve than this leave nothing to detect
_LEAST_LEFT = 0.1
# how far a parameter is moved at most, in standard deviations of its prior
_FURTHEST = 3.0
# of a shape that has its size: how near, on a logarithmic scale, it has to be, before it is scaled
_NEAR = 0.3


class Shapes(NamedTuple):
    """Shapes of one cause, drawn from its prior; each can be given some sizes.

    Attributes
    ----------
    curves : ndarray of shape (k, n)
        On the scale of eta, of size one where they may be scaled.
    factors : ndarray of shape (k, n)
        On the noise.
    smallest, largest : ndarray of shape (k,)
        Sizes that each can have.
    weight : ndarray of shape (k,)
        Share of the prior.
    is_path : bool
        Whether they are noise that neighbouring rows share.
    """

    curves: FloatArray
    factors: FloatArray
    smallest: FloatArray
    largest: FloatArray
    weight: FloatArray
    is_path: bool

    def weight_at(self, size: float) -> FloatArray:
        """Return the share (k,) of each shape among those that can have a size."""
        return self.weight * ((self.smallest <= size) & (size <= self.largest))

    def at(self, index: FloatArray, size: float) -> tuple[FloatArray, FloatArray]:
        """Return curves and factors of some shapes at a size, both (m, n)."""
        curves, factors = self.curves[index] * size, self.factors[index]
        if self.is_path:
            shared = 1 / np.sqrt(1 + size**2)
            return curves * shared, factors * shared
        contrast = np.log(np.max(factors, axis=1) / np.min(factors, axis=1))
        power = np.divide(np.log1p(size), contrast, out=np.ones_like(contrast), where=contrast > 0)
        factors = factors ** power[:, None]
        return curves, factors / np.sqrt(np.mean(factors**2, axis=1, keepdims=True))


def shapes_of(place: Place, cause: Cause, random: np.random.RandomState) -> Shapes:
    """Draw shapes of one cause from its prior.

    Those that the parameters follow are left out: none may remain.

    Parameters
    ----------
    place : Place
    cause : Cause
        Prepared.
    random : RandomState
    """
    problem, null = place.context.problem, place.null
    model = problem.model.with_effects((*problem.model.effects, cause))
    grid = _drawn(model, make_grid(model), random)
    z = grid.neutral.copy()
    z[: len(null.mode.z)] = null.mode.z
    pieces = [
        _shapes(place, cause, parts, output_of(parts, z[grid.fixed]), random)
        for parts in linearised_pieces(model, problem.X, place.context.emulator, grid, z)
    ]
    curves, factors, smallest, largest, weight = (
        np.concatenate([piece[k] for piece in pieces]) for k in range(5)
    )
    return Shapes(curves, factors, smallest, largest, weight, cause.is_correlated_noise)


def _drawn(model: MeasuredModel, grid: Grid, random: np.random.RandomState) -> Grid:
    """Return the grid with draws of its coordinates from their prior in place of its nodes."""
    weight = np.exp(grid.log_weight - np.logaddexp.reduce(grid.log_weight))
    index = random.choice(len(weight), _SHAPES, p=weight / weight.sum())
    cells, points = grid.edges[index], grid.points[index]
    for k, position in enumerate(grid.nodes if not grid.exact else ()):
        prior = model.priors[position]
        below, above = prior.cdf(cells[:, k, 0]), prior.cdf(cells[:, k, 1])
        within = prior.ppf(below + (above - below) * random.uniform(size=_SHAPES))
        points[:, k] = np.clip(within, cells[:, k, 0], cells[:, k, 1])
    edges = np.repeat(points[:, :, None], 2, axis=2)
    return with_cells(grid, edges, np.full(_SHAPES, -np.log(_SHAPES)))


def _shapes(
    place: Place,
    cause: Cause,
    parts: Linearised,
    output: FloatArray,
    random: np.random.RandomState,
) -> Shapes:
    """Return shapes, one for each node, each with a random direction of its coefficients.

    ``output`` are the rows without noise at the nodes, sizes neutral: (k, n) or, of all, (1, n).
    """
    k, n, q = parts.H.shape
    weight = np.exp(parts.log_weight)
    own = np.ones((k, n))
    if parts.noise is not None:
        relative = parts.noise if place.parts.noise is None else parts.noise / place.parts.noise
        own = np.broadcast_to(relative, (k, n))
    smallest, largest = np.zeros(k), np.full(k, np.inf)
    if not q and not cause.touches_simulation:
        # noise alone: a shape has its contrast, and may be scaled a little
        contrast = np.max(own, axis=1) / np.min(own, axis=1) - 1
        near = np.exp([-_NEAR, _NEAR])
        zero = np.zeros((k, n))
        return Shapes(zero, own, contrast * near[0], contrast * near[1], weight, False)
    moved = np.broadcast_to(output - place.output, (k, n))
    direction = random.standard_normal((k, q))
    curves = moved + np.einsum("knq,kq->kn", parts.H, direction)
    left = place.left_of(curves)
    size = np.sqrt(np.mean(left**2, axis=1))
    raw = np.sqrt(np.mean((curves / place.noise) ** 2, axis=1))
    valid = np.isfinite(size) & (size > _LEAST_LEFT * raw) & (size > 0)
    unit = np.where(valid, size, 1.0)
    if q:
        # a parameter moves within its prior
        with np.errstate(divide="ignore"):
            reach = _FURTHEST * np.min(parts.cap / np.abs(direction), axis=1)
        largest = reach * unit
    else:
        smallest, largest = unit * np.exp(-_NEAR), unit * np.exp(_NEAR)
    curves = np.where(valid[:, None], curves, 0.0) / unit[:, None]
    factors = np.ones((k, n)) if cause.is_process else own
    return Shapes(curves, factors, smallest, largest, weight * valid, False)


class Hidden(NamedTuple):
    """Data sets with a cause of one kind and size.

    Attributes
    ----------
    responses : ndarray of shape (m, n)
    change : ndarray of shape (m,)
        The largest change of a row without noise, on the scale of eta.
    """

    responses: FloatArray
    change: FloatArray


def hidden(
    place: Place,
    shapes: Sequence[tuple[Cause, Shapes]],
    size: float,
    m: int,
    random: np.random.RandomState,
) -> Hidden | None:
    """Draw m data sets with a cause of a kind; None where none of its forms has this size.

    Parameters
    ----------
    place : Place
    shapes : sequence of (Cause, Shapes)
        The forms of the kind: each has its share of the prior of the kind.
    size : float
    m : int
    random : RandomState
    """
    odds = prior_odds([cause for cause, _ in shapes])
    able = np.array([one.weight_at(size).any() for _, one in shapes])
    if not able.any():
        return None
    share = odds * able / np.sum(odds * able)
    counts = random.multinomial(m, share)
    curves, factors = [], []
    for (_, one), count in zip(shapes, counts, strict=True):
        weight = one.weight_at(size)
        if count:
            index = random.choice(len(weight), count, p=weight / weight.sum())
            both = one.at(index, size)
            curves.append(both[0])
            factors.append(both[1])
    added, factor = np.concatenate(curves), np.concatenate(factors)
    return Hidden(place.responses(added, factor, random), np.max(np.abs(added), axis=1))
