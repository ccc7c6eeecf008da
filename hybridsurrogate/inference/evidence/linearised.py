"""A cause linearised: the model of the measured rows around one point.

Around one point the model of the measured rows is linear in the simulation's parameters (as
standard normal z) and in the *sizes* of the cause: the coefficients of its columns, or a gain, a
constant, a slope measured from the value at which it changes nothing.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.inference.evidence.grid import Grid
from hybridsurrogate.inference.evidence.settings import SETTINGS
from hybridsurrogate.model.context import disjoint_moves
from hybridsurrogate.model.observation import MAX_KEPT_PLACES, MeasuredModel
from hybridsurrogate.model.statistics import EmulatorPosterior
from hybridsurrogate.numerics.linear_algebra import LARGE_BLOCK, SINGULAR, blocks, in_blocks
from hybridsurrogate.simulation.arrays import LARGEST
from hybridsurrogate.types import FloatArray

# of differences of what is smooth to rounding, such as an emulator: a step to one side is enough,
# at half the price
SHORT_STEP = 1e-4
# numbers of the columns of all nodes that are kept
_MOST_KEPT = 2 * LARGE_BLOCK


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
        Factor of the known covariance: the emulator's own error, a remainder, errors that rows
        share.
    log_weight : ndarray of shape (T,)
        Log prior mass of the nodes.
    noise : ndarray of shape (K, n) or None
        Factor on sigma, K is 1 where the nodes do not touch it, else T. None: one everywhere.
    """

    mean: FloatArray
    G: FloatArray
    H: FloatArray
    H_rms: FloatArray
    cap: FloatArray
    U: FloatArray
    log_weight: FloatArray
    noise: FloatArray | None = None

    def at(self, index: NDArray[np.intp] | slice) -> Linearised:
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
        )

    def pieces(self, n_responses: int) -> list[Linearised]:
        """Cut the nodes into pieces of which all numbers stay in the processor's cache.

        A node has its columns and, where it differs in the simulation, its mean and slopes (for
        many responses also slopes that differ from those of another node), in all rows; and
        products of these with all responses.
        """
        T, n, q = self.H.shape
        own = q if len(self.mean) == 1 else q + 2 * (1 + self.G.shape[2])
        cuts = blocks(T, own * max(n, n_responses))
        return [self] if len(cuts) == 1 else [self.at(piece) for piece in cuts]

    def simplified(self) -> Linearised:
        """Return the same with one mean and G where all nodes share them, as at a size of zero."""
        if np.all(self.mean[0] == self.mean) and np.all(self.G[0] == self.G):
            return replace(self, mean=self.mean[:1], G=self.G[:1])
        return self

    def by_noise(self) -> list[tuple[Linearised, FloatArray]]:
        """Split into models of unit noise factor, rows scaled, each with its factor (n,)."""
        if self.noise is None:
            return [(self, np.ones(1))]
        everything = np.arange(len(self.H))
        nodes = [everything] if len(self.noise) == 1 else list(everything[:, None])
        out = []
        for index, factor in zip(nodes, self.noise, strict=True):
            some, column = self.at(index), factor[:, None]
            G, H, U = some.G / column, some.H / column, some.U / column
            unit = replace(some, mean=some.mean / factor, G=G, H=H, U=U, noise=None)
            out.append((unit, factor))
        return out


class Columns(NamedTuple):
    """What causes add at the nodes of a grid.

    Attributes
    ----------
    earlier : ndarray of shape (n, e)
        Columns of earlier causes, times the prior sd of their coefficients.
    own : ndarray of shape (T, n, q)
        Those of the last cause, with unit root mean square.
    rms : ndarray of shape (T, q)
        What was divided out of them.
    """

    earlier: FloatArray
    own: FloatArray
    rms: FloatArray

    def at(self, index: NDArray[np.intp]) -> Columns:
        """Return the columns at some of the nodes."""
        return Columns(self.earlier, self.own[index], self.rms[index])


def columns_at_nodes(model: MeasuredModel, X: FloatArray, grid: Grid, z: FloatArray) -> Columns:
    """Return the columns of all causes at every node."""
    before, values = range(len(model.effects) - 1), values_at_nodes(model, grid, z)
    earlier = model.added(X, values[:1], before)[0]
    earlier = earlier * model.column_sd[: earlier.shape[1]]
    process = bool(model.effects) and model.effects[-1].is_process
    last = range(len(before), len(model.effects))

    def scaled(block: FloatArray) -> tuple[FloatArray, ...]:
        # some nodes at a time, before they leave the processor's cache
        curves = np.swapaxes(model.added(X, block, last), 1, 2)
        rms = _rms(curves, process)
        return curves / rms[:, :, None], rms

    numbers = len(X) * len(model.effects[-1].coefficients) if model.effects else 0
    own, rms = in_blocks(scaled, values, numbers)
    # a column that is tiny compared with those of other nodes stays so
    least = SINGULAR * float(np.max(rms, initial=0.0))
    low = rms < least
    own[low] *= (rms[low] / least)[:, None]
    return Columns(earlier, np.swapaxes(own, 1, 2), np.maximum(rms, least))


def _rms(curves: FloatArray, process: bool) -> FloatArray:
    """Return the root mean square of curves (T, q, n), (T, q), of a zero one as good as zero.

    Of a process that of all its columns together: prior variance per row, not per column.
    """
    squares: FloatArray = np.einsum("tqn,tqn->tq", curves, curves) / curves.shape[2]
    rms = np.sqrt(squares)
    if process:
        rms = np.broadcast_to(np.sqrt(squares.sum(axis=1, keepdims=True)), squares.shape)
    return np.maximum(rms, SINGULAR * max(float(np.max(rms, initial=0.0)), 1e-280))


def values_at_nodes(model: MeasuredModel, grid: Grid, z: FloatArray) -> FloatArray:
    """Return the unknowns at every node, those that are not enumerated at z, (T, n_unknowns)."""
    values = np.repeat(model.values(z[None]), len(grid.points), axis=0)
    values[:, grid.nodes] = grid.points
    return values


def _noise_at_nodes(
    model: MeasuredModel,
    X: FloatArray,
    grid: Grid,
    z: FloatArray,
    c: FloatArray,
    simulated: FloatArray,
) -> FloatArray | None:
    """Return the noise factor where it differs from one, (T, n), or (1, n) for all nodes.

    Where noise follows the simulation's output or its slope, it is that at z and at the surrogate's
    coefficients ``c`` (p,): ``simulated`` (n,).
    """
    if not model.touches_noise:
        return None
    values = values_at_nodes(model, grid, z)
    values = values if model.effects and "noise" in model.effects[-1].acts_on else values[:1]
    slopes: list[FloatArray | None] = [None] * len(model.effects)
    if any(effect.follows_slope for effect in model.effects):
        at_z = model.slopes(X, model.values(z[None]), c, simulated[None])
        slopes = [None if slope is None else slope[0] for slope in at_z]
    noise = model.noise(X, values, np.nan_to_num(simulated), slopes)
    return None if noise.shape[1] == 1 else noise


class _Slopes(NamedTuple):
    """The simulation around a point: mean (M, n), slopes (M, D, n); output (n,) and U at one node.

    ``mean`` is that at the prior's centre: fixed directions at 0, sizes at their neutral value.
    """

    mean: FloatArray
    slopes: FloatArray
    output: FloatArray
    U: FloatArray


def _slopes(
    model: MeasuredModel, X: FloatArray, emulator: EmulatorPosterior, grid: Grid, z: FloatArray
) -> _Slopes:
    """Return the output and its slopes, at all nodes where these touch the simulation.

    Some nodes at a time, as the slopes need runs. Where the sizes are zero all nodes share the
    simulation, and differ in the slopes along the sizes alone: unless one of them is a node, as
    that of a store.
    """
    directions = np.append(grid.fixed, grid.sizes)
    touches = len(grid.nodes) and model.effects[-1].touches_simulation
    change = model.effects[-1].modification if touches else None
    enumerated = change is not None and set(change.sizes) & model.effects[-1].grid().keys()
    if touches and len(grid.sizes) and grid.is_neutral(z) and not enumerated:
        first = grid.at(np.zeros(1, dtype=int))
        shared = _slopes_along(model, X, emulator, first, z, directions)
        along = _slopes_along(model, X, emulator, grid, z, grid.sizes).slopes
        fixed = shared.slopes[:, : len(grid.fixed)]
        fixed = np.broadcast_to(fixed, (len(along), *fixed.shape[1:]))
        mean = np.broadcast_to(shared.mean, (len(along), len(X)))
        return shared._replace(mean=mean, slopes=np.concatenate([fixed, along], axis=1))
    return _slopes_along(model, X, emulator, grid, z, directions)


def _slopes_along(
    model: MeasuredModel,
    X: FloatArray,
    emulator: EmulatorPosterior,
    grid: Grid,
    z: FloatArray,
    directions: NDArray[np.intp],
) -> _Slopes:
    """Return the output and its slopes along some of the unknowns."""
    both = model.basis.is_simulation
    step = model.step if both else SHORT_STEP
    together = disjoint_moves(model, X, directions)
    moves = step * together.steps
    points = z + np.vstack([np.zeros((1, len(z))), moves, *([-moves] if both else [])])
    values = model.values(points)
    in_simulation = bool(len(grid.nodes)) and model.effects[-1].touches_simulation
    M = len(grid.points) if in_simulation else 1
    mean, slopes = np.empty((M, len(X))), np.empty((M, len(directions), len(X)))
    at_one: tuple[FloatArray, FloatArray] | None = None
    for piece in blocks(M, len(points) * len(X)):
        runs = np.tile(values, (piece.stop - piece.start, 1, 1))
        if in_simulation:
            runs[:, :, grid.nodes] = grid.points[piece, None, :]
        places = runs.reshape(len(runs) * len(points), len(z))
        response, _ = model.output(X, places, emulator.mean, len(points))
        # a simulation may fail far out: NaN marks the place and is never better than another one
        response[~(np.abs(response) < LARGEST)] = np.nan
        response = response.reshape(len(runs), len(points), len(X))
        ahead, behind = response[:, 1 : 1 + len(moves)], response[:, 1 + len(moves) :]
        here = response[:, :1]
        change = (ahead - here) / step
        if both:
            # where the simulation runs on one side alone, the difference to that side
            center = (ahead - behind) / (2 * step)
            change = np.where(np.isnan(change), (here - behind) / step, change)
            change = np.where(np.isnan(center), change, center)
        slope = together.of_directions(change)
        # a node that fails at a row is impossible, and what other rows have there may be any size
        broken = ~np.isfinite(response[:, 0]).all(axis=1)
        slope[broken] = 0.0
        slope[~np.isfinite(slope)] = 0.0
        slopes[piece] = slope
        mean[piece] = response[:, 0] - (z - grid.neutral)[directions] @ slope
        if at_one is None:
            at_one = response[0, 0].copy(), model.emulator_error(X, runs[0, :1], emulator.factor)
    assert at_one is not None
    return _Slopes(mean, slopes, *at_one)


class RecentSlopes:
    """The latest slopes of the simulation at the same rows and with the same emulator.

    Causes that leave the simulation as it is are compared from few places: a third of their
    linearisations are repeats, 5 to 13 % of a search.
    """

    def __init__(self) -> None:
        self._kept: OrderedDict[tuple[Any, ...], _Slopes] = OrderedDict()

    def __reduce__(self) -> tuple[type[RecentSlopes], tuple[()]]:
        return RecentSlopes, ()

    def at(
        self,
        model: MeasuredModel,
        X: FloatArray,
        emulator: EmulatorPosterior,
        grid: Grid,
        z: FloatArray,
    ) -> _Slopes:
        """Return what `_slopes` does."""
        touching = [k for k, e in enumerate(model.effects) if e.touches_simulation]
        if touching and touching[-1] == len(model.effects) - 1:
            return _slopes(model, X, emulator, grid, z)
        own = [k for k, (owner, _) in enumerate(model.theta_names) if owner in touching]
        places = z[[*range(model.n_parameters), *(model.n_parameters + k for k in own)]]
        key = (
            tuple(model.effects[k] for k in touching),
            places.tobytes(),
            grid.fixed.tobytes(),
            grid.neutral[grid.fixed].tobytes(),
        )
        if key not in self._kept:
            self._kept[key] = _slopes(model, X, emulator, grid, z)
            if len(self._kept) > MAX_KEPT_PLACES:
                self._kept.popitem(last=False)
        self._kept.move_to_end(key)
        return self._kept[key]


def linearise(
    model: MeasuredModel,
    X: FloatArray,
    emulator: EmulatorPosterior,
    grid: Grid,
    z: FloatArray,
    columns: Columns | None = None,
    recent: RecentSlopes | None = None,
) -> Linearised:
    """Linearise around z (n_unknowns,), at all nodes of the grid.

    The columns of earlier causes join G with their prior sd, or U if they are errors that rows
    share; those of the last one are sizes.
    ``columns`` may be given where they are known from `columns_at_nodes`, and slopes from calls
    with the same rows and emulator.
    """
    slopes = _slopes if recent is None else recent.at
    around = slopes(model, X, emulator, grid, z)
    return _linearise(model, X, emulator, grid, z, columns, around)


def linearised_pieces(
    model: MeasuredModel, X: FloatArray, emulator: EmulatorPosterior, grid: Grid, z: FloatArray
) -> Iterator[Linearised]:
    """Return what `linearise` does in pieces, where the columns of all nodes are much memory."""
    if not is_long(model, X, grid):
        yield linearise(model, X, emulator, grid, z)
        return
    around = _slopes(model, X, emulator, grid, z)
    for piece in blocks(len(grid.points), _numbers(model, X), LARGE_BLOCK):
        some = grid.at(np.arange(piece.start, piece.stop))
        yield _linearise(model, X, emulator, some, z, None, around)


def is_long(model: MeasuredModel, X: FloatArray, grid: Grid) -> bool:
    """Return whether a grid has more nodes than are kept with their columns, 64 MB.

    Only that of a cause that adds columns and leaves the simulation and the noise as they are.
    """
    if not len(grid.nodes) or model.effects[-1].touches_simulation:
        return False
    if {"noise", "outliers"} & set(model.effects[-1].acts_on):
        return False
    return len(grid.points) * _numbers(model, X) > _MOST_KEPT


def _numbers(model: MeasuredModel, X: FloatArray) -> int:
    return len(X) * len(model.effects[-1].coefficients)


def _linearise(
    model: MeasuredModel,
    X: FloatArray,
    emulator: EmulatorPosterior,
    grid: Grid,
    z: FloatArray,
    columns: Columns | None,
    around: _Slopes,
) -> Linearised:
    """Return what `linearise` does, with the simulation's slopes known."""
    T, M, d = len(grid.points), len(around.mean), len(grid.fixed)
    G, curves = np.swapaxes(around.slopes[:, :d], 1, 2), around.slopes[:, d:]
    rms = _rms(curves, bool(model.effects) and model.effects[-1].is_process)
    curves /= rms[:, :, None]
    H = np.broadcast_to(np.swapaxes(curves, 1, 2), (T, len(X), len(grid.sizes)))
    rms = np.broadcast_to(rms, (T, len(grid.sizes)))
    # a size that is a separate parameter keeps within its prior: z displaced by its sd at most
    cap, U = rms, around.U
    if model.column_names:
        if columns is None:
            columns = columns_at_nodes(model, X, grid, z)
        if columns.earlier.shape[1]:
            # errors that rows share are of the noise, like those of the emulator
            owners = [model.effects[k] for k, _ in model.column_names]
            of_noise = np.array([one.concerns == "noise" and not one.is_process for one in owners])
            of_noise = of_noise[: columns.earlier.shape[1]]
            U = np.hstack([U, columns.earlier[:, of_noise]])
            earlier = columns.earlier[:, ~of_noise]
            earlier = np.broadcast_to(earlier, (M, *earlier.shape))
            G = np.concatenate([G, earlier], axis=2)
        H = np.concatenate([H, columns.own], axis=2) if len(grid.sizes) else columns.own
        rms = np.concatenate([rms, columns.rms], axis=1)
        cap = np.concatenate([cap, np.full(columns.rms.shape, np.inf)], axis=1)
    noise = _noise_at_nodes(model, X, grid, z, emulator.mean, around.output)
    log_weight = grid.log_weight + _odds_of_places(model, grid, H)
    return Linearised(around.mean, G, H, rms, cap, U, log_weight, noise)


def _odds_of_places(model: MeasuredModel, grid: Grid, H: FloatArray) -> FloatArray | float:
    """Return the log odds (T,) of each place: less than one where few rows carry the shape.

    How many these are is the participation ratio of the squares w of the shape at the rows,
    ``(sum w)^2 / sum w^2``: k where k rows have the same and all others nothing.
    """
    if not len(grid.nodes) or not H.size:
        return 0.0
    last = model.effects[-1]
    if last.is_process or last.concerns == "data":
        return 0.0
    w = np.einsum("tnq,tnq->tn", H, H)
    total = np.maximum(np.sum(w, axis=1), np.finfo(float).tiny)
    w /= total[:, None]
    carrying = 1 / np.maximum(np.einsum("tn,tn->t", w, w), 1 / w.shape[1])
    return np.where(carrying < SETTINGS.isolated_rows, np.log(SETTINGS.isolated_odds), 0.0)
