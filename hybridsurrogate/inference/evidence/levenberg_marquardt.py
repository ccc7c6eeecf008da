"""Descents from many starts at once: for causes inside the dynamics, and constants far away.

Where a location or a width acts inside the simulation, the best parameters of one node of a grid
are poor starts for the next one. Moving node and parameters together ends where it began. But a
solution of an ODE is smooth in all of them, so descents can follow it. Here every start has
separate parameters, the enumerated ones too. All starts take Levenberg-Marquardt steps in one call
of the simulation, and every few steps only the better half goes on.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.effects.base import Cause
from hybridsurrogate.inference.evidence.grid import Grid
from hybridsurrogate.inference.evidence.settings import SETTINGS
from hybridsurrogate.model.context import disjoint_moves, single_moves
from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.model.statistics import EmulatorPosterior
from hybridsurrogate.numerics.linear_algebra import LARGE_BLOCK, NEGLIGIBLE, SINGULAR
from hybridsurrogate.priors import Z_LIMIT, to_normal
from hybridsurrogate.simulation.arrays import LARGEST
from hybridsurrogate.types import FloatArray

# places far away: along a size, how far these reach in standard deviations of the prior, and
# besides; how much better (minus twice the log posterior) one has to be
_LINE_POINTS, REACH_SD, _N_SPREAD, _WORTH_FOLLOWING = 49, 2.4, 400, 2.0
# sizes that starts move to either side, in all combinations
_MAX_MOVED_SIZES = 4


def is_followed(cause: Cause) -> bool:
    """Whether all unknowns of a cause are followed, none enumerated."""
    return cause.modification is not None


def best_of_many(
    model: MeasuredModel,
    X: FloatArray,
    y: FloatArray,
    emulator: EmulatorPosterior,
    grid: Grid,
    centre: FloatArray,
    floor: float,
) -> tuple[FloatArray, float]:
    """Return z (n_unknowns,) of the best fit that is reached from many starts, and its sigma.

    Parameters
    ----------
    centre : ndarray of shape (k,)
        The first unknowns, at the fit without the cause.
    floor : float
        Noise below which no fit counts as better.
    """
    place = np.concatenate([grid.fixed, grid.sizes, grid.nodes])
    z = _starts(model, grid, centre)
    return _descend(_Residual(model, X, y, emulator, floor), z, place)


def best_of_spread(
    model: MeasuredModel, X: FloatArray, y: FloatArray, emulator: EmulatorPosterior, floor: float
) -> tuple[FloatArray, float]:
    """Return z (n_unknowns,) of the best fit reached from a spread over the prior, and its sigma.

    Parameters
    ----------
    floor : float
        As in `best_of_many`.
    """
    # a fixed spread: what a fit finds does not depend on its random draws
    z = np.random.RandomState(0).standard_normal((_N_SPREAD, model.n_unknowns))
    residual = _Residual(model, X, y, emulator, floor)
    value = residual.deviance(residual(z), z)
    starts = z[np.argsort(value)[: SETTINGS.max_followed]]
    return _descend(residual, starts, np.arange(model.n_unknowns))


def best_of_global_starts(
    model: MeasuredModel,
    X: FloatArray,
    y: FloatArray,
    emulator: EmulatorPosterior,
    grid: Grid,
    centre: FloatArray,
    known: FloatArray,
    floor: float,
) -> FloatArray | None:
    """Return a place (n_unknowns,) that fits better than one that is known, None without one.

    For the last cause of a model if it changes the simulation and has a size, such as a wrong
    constant. An optimiser follows the tangent where nothing is wrong, and of an oscillation whose
    frequency is far off it sees nothing. Here the size runs over its whole prior, at the fit
    without the cause, and all unknowns over a spread. Where the fit improves and worsens more than
    once on the way, the best of a wider spread are followed, too.

    Parameters
    ----------
    known : ndarray of shape (n_unknowns,)
    centre, floor
        As in `best_of_many`.
    """
    if not model.effects[-1].touches_simulation or not len(grid.sizes):
        return None
    line = np.tile(grid.neutral, (_LINE_POINTS, 1))
    line[:, : len(centre)] = centre
    line[:, grid.nodes] = _at_nodes(model, grid, np.array([len(grid.points) // 2]))
    line[:, grid.sizes[0]] = np.linspace(-REACH_SD, REACH_SD, _LINE_POINTS)
    residual = _Residual(model, X, y, emulator, floor)

    def deviance(z: FloatArray) -> FloatArray:
        return residual.deviance(residual(z), z)

    along = deviance(line)
    inner = (along[1:-1] < along[:-2]) & (along[1:-1] <= along[2:])
    is_rough = np.count_nonzero(inner) > 1
    if len(grid.nodes) and not is_rough:
        return None  # nodes are enumerated, and sizes are followed from each
    wide = _N_SPREAD if is_rough else _LINE_POINTS
    if is_rough and model.basis.is_quick:
        wide = int(np.clip(LARGE_BLOCK // len(y), _N_SPREAD, SETTINGS.max_population))
    # a fixed spread of parameters, size and nodes, those of earlier causes held: the search is
    # deterministic
    random = np.random.RandomState(0)
    spread = np.tile(line[0], (wide, 1))
    place = [*np.arange(model.n_parameters), *grid.sizes]
    # far out in a heavy tail an ODE would be solved for many times the measured span
    spread[:, place] = np.clip(random.standard_normal((wide, len(place))), -REACH_SD, REACH_SD)
    spread[:, grid.nodes] = _at_nodes(model, grid, random.randint(len(grid.points), size=wide))
    z = np.vstack([known, line, spread])
    value = np.concatenate([deviance(known[None]), along, deviance(spread)])
    if is_rough:
        followed = z[np.argsort(value)[: SETTINGS.max_followed]]
        end, _ = _descend(residual, followed, np.concatenate([grid.fixed, grid.sizes, grid.nodes]))
        z, value = np.vstack([z, end]), np.append(value, deviance(end[None]))
    best = int(np.argmin(value))
    return z[best] if value[best] < value[0] - _WORTH_FOLLOWING else None


def _at_nodes(model: MeasuredModel, grid: Grid, index: NDArray[np.intp]) -> FloatArray:
    """Return the enumerated coordinates of nodes (k,) in standard normal units, (k, n_nodes)."""
    return to_normal([model.priors[k] for k in grid.nodes], grid.points[index])


def _starts(model: MeasuredModel, grid: Grid, centre: FloatArray) -> FloatArray:
    """Return starts (S, n_unknowns): nodes spread over the grid, sizes moved to either side."""
    # of the waves of a process the first, which are the largest: all corners would be a million
    moved = grid.sizes[:_MAX_MOVED_SIZES]
    T, k = len(grid.points), len(moved)
    most = min(T, SETTINGS.max_followed * 2 ** max(k - 1, 0))
    chosen = np.unique(np.linspace(0, T - 1, most).round().astype(int))
    # one standard deviation to either side; of a cause without sizes one row without columns
    moves = np.array(list(product([-1.0, 1.0], repeat=k)))
    base = grid.neutral.copy()
    base[: len(centre)] = centre
    z = np.tile(base, (len(chosen), len(moves), 1))
    z[:, :, moved] += moves
    z[:, :, grid.nodes] = _at_nodes(model, grid, chosen)[:, None, :]
    return np.clip(z.reshape(-1, len(base)), -Z_LIMIT, Z_LIMIT)


@dataclass(frozen=True)
class _Residual:
    """Residuals of the measured rows with the columns of all causes fitted by ridge regression."""

    model: MeasuredModel
    X: FloatArray
    y: FloatArray
    emulator: EmulatorPosterior
    floor: float

    def __call__(self, z: FloatArray) -> FloatArray:
        """Return residuals (J, n) in units of the noise factor."""
        values = self.model.values(z)
        output, _, noise = self.model.simulated(self.X, values, self.emulator.mean)
        residual = (self.y - output) / noise
        # the logarithm of an output that has run to zero, which columns would carry to all rows
        residual[~(np.abs(residual) < LARGEST)] = np.nan
        columns = self.model.added(self.X, values) / noise[..., None]
        if columns.shape[2]:
            columns = columns * self.model.column_sd
            normal = np.swapaxes(columns, 1, 2) @ columns
            # columns of two causes may be the same curve
            least = SINGULAR * np.trace(normal, axis1=1, axis2=2)[:, None, None]
            normal += np.maximum(self.floor**2, least) * np.eye(columns.shape[2])
            right = np.einsum("jnq,jn->jq", columns, residual)
            fitted = np.linalg.solve(normal, right[..., None])
            residual = residual - (columns @ fitted)[..., 0]
        # where the simulation fails, or runs away, which is finite for a while
        most = max(self.floor, float(np.ptp(self.y))) / NEGLIGIBLE
        return np.where(np.abs(residual) < most, residual, most)

    def with_slopes(self, z: FloatArray, place: NDArray[np.intp]) -> tuple[FloatArray, FloatArray]:
        """Return residuals (J, n) and their slopes downwards (J, len(place), n) in one call."""
        step, together = self.model.step, disjoint_moves(self.model, self.X, place)
        if together.touched is not None and self.model.column_names:
            # columns that are fitted anew carry a move of one row to all others
            together = single_moves(self.model.n_unknowns, place)
        moves = step * np.vstack([np.zeros(z.shape[1]), together.steps])
        points = z[:, None] + moves
        residual = self(points.reshape(-1, z.shape[1])).reshape(len(z), len(moves), -1)
        slopes = (residual[:, :1] - residual[:, 1:]) / step
        return residual[:, 0], together.of_directions(slopes)

    def deviance(self, residual: FloatArray, z: FloatArray) -> FloatArray:
        """Return minus twice the log posterior, the noise at its best value, (J,)."""
        return self.y.size * np.log(self.variance(residual)) + np.sum(z**2, axis=-1)

    def variance(self, residual: FloatArray) -> FloatArray:
        """Return the variance of the noise that suits residuals best, (J,)."""
        # a simulation may run away far from the data, and is infinitely bad there
        with np.errstate(over="ignore"):
            return np.mean(residual**2, axis=-1) + self.floor**2


def _descend(
    residual: _Residual, z: FloatArray, place: NDArray[np.intp]
) -> tuple[FloatArray, float]:
    """Follow starts z (S, n_unknowns) along some unknowns; return the best end and its sigma."""
    d = len(place)
    rest, slopes = residual.with_slopes(z, place)
    deviance = residual.deviance(rest, z)
    damping = np.full(len(z), 1e-2)
    for step in range(SETTINGS.optimiser_steps):
        variance = residual.variance(rest)[:, None]
        normal = slopes @ np.swapaxes(slopes, 1, 2) / variance[..., None] + np.eye(d)
        right = np.einsum("jdn,jn->jd", slopes, rest) / variance - z[:, place]
        normal[:, np.arange(d), np.arange(d)] *= 1 + damping[:, None]
        move = np.linalg.solve(normal, right[..., None])[..., 0]
        trial = z.copy()
        trial[:, place] += move
        trial = np.clip(trial, -Z_LIMIT, Z_LIMIT)
        # slopes of a trial that fails are in vain, but a second call would cost more
        trial_rest, trial_slopes = residual.with_slopes(trial, place)
        trial_badness = residual.deviance(trial_rest, trial)
        better = trial_badness < deviance
        best = int(np.argmin(np.minimum(deviance, trial_badness)))
        converged = better[best] and deviance[best] - trial_badness[best] < SETTINGS.converged_gain
        z[better], rest[better], slopes[better] = (
            trial[better],
            trial_rest[better],
            trial_slopes[better],
        )
        deviance = np.minimum(deviance, trial_badness)
        damping = np.where(better, 0.2, 6.0) * damping
        if converged:
            break
        if step % SETTINGS.halving_steps == SETTINGS.halving_steps - 1 and len(z) > 2:
            kept = np.argsort(deviance)[: (len(z) + 1) // 2]
            z, rest, slopes = z[kept], rest[kept], slopes[kept]
            deviance, damping = deviance[kept], damping[kept]
    best = int(np.argmin(deviance))
    return z[best], float(np.sqrt(residual.variance(rest[best])))
