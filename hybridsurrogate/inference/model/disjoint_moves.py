"""Which unknowns can be moved at the same time where slopes are taken.

Two unknowns that change no row in common, such as deviations of two experiments, have their slopes
from one run: each row shows the slope of the unknown it depends on (Curtis, Powell and Reid 1974).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.inference.model.effects import CausesOnRows
from hybridsurrogate.priors import FloatArray


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
