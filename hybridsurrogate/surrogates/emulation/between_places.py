"""The error between the places of a curve: none where it was simulated.

A place that is left out and interpolated from its neighbours shows how rough a curve is there. Over
twice and four times the step such errors give the power of the distance with which they grow:
1/2 of a path that is driven at random, 2 of a smooth curve met by lines, 4 of one met by cubics.
Between two places that were simulated the error is that of a bridge, a path fixed at both ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from hybridsurrogate.numerics.linear_algebra import NEGLIGIBLE
from hybridsurrogate.types import FloatArray

# places and outputs (n_runs, n_places) of runs that have all of them
Piece = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, eq=False)
class BetweenPlaces:
    """Error of interpolation along curves.

    Attributes
    ----------
    places : ndarray of shape (n,)
    middle : ndarray of shape (n - 1,)
        Standard deviation half way between a place and the next.
    interpolated : ndarray of shape (n,)
        Share of the runs that were not simulated at a place.
    power : float
        Of the distance, with which errors grow; at least 0.
    correlation : float
        Of errors between neighbouring pairs of places.
    """

    places: FloatArray
    middle: FloatArray
    interpolated: FloatArray
    power: float
    correlation: float

    def sd(self, x: FloatArray) -> FloatArray:
        """Return the standard deviation at places (n,).

        Beyond the ends as in the middle of the last pair, from half of its distance on.
        """
        k, u = self._where(x)
        # a Brownian bridge has variance 4 u (1 - u) of that in its middle; a smooth curve's
        # error is a parabola
        bridge = (4 * u * (1 - u)) ** (2 * self._shape)
        floor = (1 - u) * self.interpolated[k] + u * self.interpolated[k + 1]
        out: FloatArray = self.middle[k] * np.sqrt(bridge + floor * (1 - bridge))
        return out

    def correlations(self, x: FloatArray, others: FloatArray) -> FloatArray:
        """Return those of errors at places (n,) and (m,), shape (n, m)."""
        (k, u), (k_others, u_others) = self._where(x), self._where(others)
        apart = np.abs(k[:, None] - k_others)
        # of a Brownian bridge exp(-|t - t'|) with 2 t = logit(u); of a smooth curve 1
        t, t_others = (_half_logit(each) for each in (u, u_others))
        along = np.exp(-2 * (1 - self._shape) * np.abs(t[:, None] - t_others))
        out: FloatArray = np.power(self.correlation, apart) * along
        return out

    @property
    def _shape(self) -> float:
        return float(np.clip(self.power, 0.5, 1.0))

    def _where(self, x: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
        """Return pairs of neighbours (n,) and the share of the way from one to the next (n,)."""
        k = np.clip(np.searchsorted(self.places, x, side="right") - 1, 0, len(self.middle) - 1)
        u = (x - self.places[k]) / np.diff(self.places)[k]
        u = np.where(u < 0, np.minimum(-u, 0.5), np.where(u > 1, np.maximum(2 - u, 0.5), u))
        return k, np.where(np.minimum(u, 1 - u) < NEGLIGIBLE, np.round(u), u)


def _half_logit(u: FloatArray) -> FloatArray:
    inside = np.clip(u, NEGLIGIBLE, 1 - NEGLIGIBLE)
    return 0.5 * np.log(inside / (1 - inside))


class _LeftOut(NamedTuple):
    """Places that were interpolated from the rest.

    Attributes
    ----------
    at : ndarray of shape (m,)
        Which places, in order.
    gap, share : ndarray of shape (m,)
        Distance between the neighbours that were kept, and how much of it lies before the place.
    error : ndarray of shape (n_runs, m)
    """

    at: NDArray[np.intp]
    gap: FloatArray
    share: FloatArray
    error: FloatArray


def _left_out(piece: Piece, degree: int, step: int) -> _LeftOut | None:
    """Interpolate the middle of every ``step`` steps; None of too few places."""
    places, table = piece
    which, errors = [], []
    for first in range(step):
        kept = np.arange(first, len(places), step)
        if len(kept) <= degree:
            continue
        left = kept[:-1] + step // 2
        spline = make_interp_spline(places[kept], table[:, kept].T, k=degree)
        which.append(left)
        errors.append(spline(places[left]).T - table[:, left])
    if not which:
        return None
    at = np.concatenate(which)
    order = np.argsort(at)
    at, error = at[order], np.concatenate(errors, axis=1)[:, order]
    before, after = places[at - step // 2], places[at + step // 2]
    return _LeftOut(at, after - before, (places[at] - before) / (after - before), error)


def degree_of(pieces: Sequence[Piece]) -> int:
    """Return that of lines, 1, where they predict left-out places as well as cubics do, else 3."""
    squares = dict.fromkeys((1, 3), 0.0)
    for degree in squares:
        found = [_left_out(piece, degree, 2) for piece in pieces]
        if not pieces or any(each is None for each in found):
            return 1
        squares[degree] = sum(float(np.sum(each.error**2)) for each in found if each is not None)
    return 3 if squares[3] < squares[1] else 1


def between_places(
    places: FloatArray, interpolated: FloatArray, pieces: Sequence[Piece], degree: int
) -> BetweenPlaces:
    """Return the error of interpolation with a degree along a common grid.

    Parameters
    ----------
    places : ndarray of shape (n,)
        The grid.
    interpolated : ndarray of shape (n,)
        Share of the runs that were not simulated there.
    pieces : sequence of (places (m,), outputs (n_runs, m))
        Outputs that were simulated: all on the grid in one piece, or each run with its own places.
    degree : int
    """
    twice = [(piece, _left_out(piece, degree, 2)) for piece in pieces]
    found = [(piece, left) for piece, left in twice if left is not None]
    n = len(places)
    if not found:
        return BetweenPlaces(places, np.zeros(n - 1), interpolated, 1.0, 0.0)
    power = _power(found, degree)
    shape = float(np.clip(power, 0.5, 1.0))
    x = np.concatenate([own[left.at] for (own, _), left in found])
    gap = np.concatenate([left.gap for _, left in found])
    share = np.concatenate([left.share for _, left in found])
    squares = np.concatenate([np.mean(left.error**2, axis=0) for _, left in found])
    unit = float(np.median(gap))
    # the variance in the middle of a pair so far apart
    rough = squares / (4 * share * (1 - share)) ** (2 * shape) / (gap / unit) ** (2 * power)
    nearest = np.searchsorted((places[1:] + places[:-1]) / 2, x)
    rough = _binned(nearest, rough, n)
    one_grid = len(pieces) == 1 and len(pieces[0][0]) == n
    widths = np.diff(places)
    if not one_grid:
        own = _binned(nearest, gap / 2, n)
        widths = np.maximum(widths, (own[1:] + own[:-1]) / 2)
    growth = (widths / unit) ** (2 * power)
    # what lies between two places shows at both: a jump in one pair is none of the next
    local = np.sqrt(rough[1:] * rough[:-1]) * growth
    total = np.sum((rough[1:] + rough[:-1]) / 2 * growth)
    local *= total / max(float(np.sum(local)), 1e-300)
    return BetweenPlaces(places, np.sqrt(local), interpolated, power, _correlation(found))


def neighbours(piece: Piece, degree: int, n_lines: int) -> float:
    """Return the correlation of errors along lines that follow one another, n_lines of each run."""
    left = _left_out(piece, degree, 2)
    if left is None:
        return 0.0
    error = left.error.reshape(-1, n_lines, left.error.shape[1])
    total = np.sum(error**2)
    both = np.sum(error[:, :-1] * error[:, 1:])
    return float(np.clip(both / total, 0.0, 1.0)) if total else 0.0


def _binned(which: NDArray[np.intp], values: FloatArray, n: int) -> FloatArray:
    """Return the mean of the values (m,) at each of n places, those without any interpolated."""
    count = np.bincount(which, minlength=n)
    there = np.flatnonzero(count)
    mean = np.bincount(which, weights=values, minlength=n)[there] / count[there]
    return np.interp(np.arange(n), there, mean)


def _power(found: Sequence[tuple[Piece, _LeftOut]], degree: int) -> float:
    """Return that of the distance with which errors grow, from twice and four times the step."""
    squares = np.zeros(2)
    for piece, twice in found:
        four = _left_out(piece, degree, 4)
        if four is None:
            continue
        both = np.isin(twice.at, four.at)
        squares += np.sum(twice.error[:, both] ** 2), np.sum(four.error**2)
    if squares[1] <= 0 or squares[0] <= 0:
        return 1.0
    return max(0.5 * float(np.log2(squares[1] / squares[0])), 0.0)


def _correlation(found: Sequence[tuple[Piece, _LeftOut]]) -> float:
    """Return the mean correlation of errors in neighbouring gaps, 0 where they alternate."""
    each = []
    for _, left in found:
        first, second = left.error[:, :-2], left.error[:, 2:]
        size = np.sqrt(np.sum(first**2, axis=0) * np.sum(second**2, axis=0))
        there = size > 0
        each.append(np.sum(first * second, axis=0)[there] / size[there])
    every = np.concatenate(each)
    return float(np.clip(np.mean(every), 0.0, 1.0)) if len(every) else 0.0
