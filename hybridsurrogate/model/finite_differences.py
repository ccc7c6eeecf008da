"""How rough a simulation is: over which steps its slopes mean something.

An output jumps where parameters hardly change if it is rounded, random, read from a table, or from
a solver with a loose tolerance. A difference over a short step is then a jump divided by next to
nothing, or zero between two jumps.

Two unknowns that change no row in common, such as deviations of two experiments, have their slopes
from one run: each row shows the slope of the unknown it depends on (Curtis, Powell and Reid 1974).
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.model.effects import CausesOnRows
from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.types import FloatArray

# steps in standard deviations of the priors, and places at which slopes over two are compared
_STEPS = (1e-3, 1e-2, 1e-1)
LONGEST_STEP = _STEPS[-1]
_PLACES = 20
# slopes that differ by this share of their size, root mean square over rows and then averaged over
# places, disagree: smooth ones by some 1e-4, those of an output with a kink by 0.02, of one that
# jumps by 0.7 or more
_DISAGREE = 0.2
# share of rows: jumps of fewer are not those of the output
_FEW_ROWS = 0.1
# of a simulation that runs away more is not to be squared
_ABSURD = 1e100


def least_step(model: MeasuredModel, X: FloatArray) -> float:
    """Return the shortest step over which slopes agree with those over one ten times as long.

    In standard deviations of the priors, for a model without causes; zero for a smooth simulation,
    of which any step will do: slopes over a thousandth agree with those over a hundredth or, where
    it oscillates fast, over a ten-thousandth. A tenth where none agree.
    """
    if not model.basis.is_simulation or not model.n_parameters:
        return 0.0
    shortest, *slopes = [_slopes(model, X, step) for step in (_STEPS[0] / 10, *_STEPS)]
    # what hardly ever changes over so short a step may be about to jump
    changes = np.any(shortest != 0, axis=2).mean(axis=0) > 0.5
    is_smooth = changes & (_disagreement(shortest, slopes[0]) <= _DISAGREE)
    # a parameter that is the place of a jump moves a row or two, however long the step
    is_smooth |= np.mean(slopes[-1] != 0, axis=(0, 2)) < _FEW_ROWS
    for step, (shorter, longer) in zip(_STEPS, pairwise(slopes), strict=False):
        if np.all(is_smooth | (_disagreement(shorter, longer) <= _DISAGREE)):
            return 0.0 if step == _STEPS[0] else step
    return LONGEST_STEP


def _disagreement(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return by which share of their size slopes (places, d, n) differ, (d,)."""
    size = np.maximum(np.linalg.norm(a, axis=2), np.linalg.norm(b, axis=2))
    there = size > 0
    # a place says no more than another one, however large its slopes, and nothing without any
    share = np.linalg.norm(a - b, axis=2) / np.where(there, size, 1.0)
    averaged: FloatArray = share.sum(axis=0) / np.maximum(there.sum(axis=0), 1)
    return averaged


def _slopes(model: MeasuredModel, X: FloatArray, step: float) -> FloatArray:
    """Return slopes (places, d, n) at places of the priors, zero where the simulation fails."""
    # a fixed spread, as the search is deterministic
    z = np.random.RandomState(0).standard_normal((_PLACES, model.n_parameters))
    ahead, behind = np.swapaxes(around(model, X, z, step), 0, 1)
    with np.errstate(invalid="ignore", over="ignore"):
        slopes: FloatArray = (ahead - behind) / (2 * step)
    slopes[~(np.abs(slopes) < _ABSURD)] = 0.0
    return slopes


def around(model: MeasuredModel, X: FloatArray, z: FloatArray, step: float) -> FloatArray:
    """Return outputs (places, 2, d, n) a step ahead of and behind z (places, d)."""
    d = z.shape[1]
    points = z[:, None] + step * np.vstack([np.eye(d), -np.eye(d)])
    return output(model, X, points.reshape(-1, d)).reshape(len(z), 2, d, len(X))


def output(model: MeasuredModel, X: FloatArray, z: FloatArray) -> FloatArray:
    """Return the simulation's output (J, n) at z (J, d)."""
    return model.simulated(X, model.values(z), model.basis.coefficient_mean)[0]


class Moves(NamedTuple):
    """Directions (d,) shared by moves.

    Attributes
    ----------
    steps : ndarray of shape (m, n_unknowns)
        One where a move goes along an unknown, zero elsewhere.
    group : ndarray of shape (d,)
        The move of each direction.
    touched : ndarray of shape (d, n) or None
        Rows that a direction may change; None: each direction has a separate move.
    """

    steps: FloatArray
    group: NDArray[np.intp]
    touched: NDArray[np.bool_] | None

    def of_directions(self, slopes: FloatArray) -> FloatArray:
        """Return slopes (..., d, n) of directions, given those (..., m, n) of moves."""
        if self.touched is None:
            return slopes
        return np.where(self.touched, slopes[..., self.group, :], 0.0)


def disjoint_moves(model: CausesOnRows, X: FloatArray, directions: NDArray[np.intp]) -> Moves:
    """Return as few moves as directions that have rows in common need.

    Parameters
    ----------
    model : CausesOnRows
    X : ndarray of shape (n, n_columns)
    directions : ndarray of shape (d,)
        Positions among the unknowns.
    """
    rows = model.rows_moved(X)
    each = single_moves(model.n_unknowns, directions)
    if rows is None:
        return each
    touched = rows[directions]
    taken: list[NDArray[np.bool_]] = []
    group = np.empty(len(directions), dtype=np.intp)
    for k, own in enumerate(touched):
        free = (j for j, before in enumerate(taken) if not (before & own).any())
        group[k] = next(free, len(taken))
        if group[k] == len(taken):
            taken.append(own)
        else:
            taken[group[k]] = taken[group[k]] | own
    steps = np.zeros((len(taken), model.n_unknowns))
    np.add.at(steps, group, each.steps)
    return Moves(steps, group, touched)


def single_moves(n_unknowns: int, directions: NDArray[np.intp]) -> Moves:
    """Return one move for each direction (d,)."""
    return Moves(np.eye(n_unknowns)[directions], np.arange(len(directions)), None)
