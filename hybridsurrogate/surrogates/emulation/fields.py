"""Runs that are fields: outputs over all pairs of the places of two inputs, such as time and depth.

A field is one run, and its components are over both axes: of 80 runs of 20 times and 20 depths
errors are a half to a quarter of those of curves along time with the depth as a further input, in a
tenth of the time. Between the places it is interpolated along one axis and then the other.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.interpolate import NdBSpline, make_interp_spline

from hybridsurrogate.surrogates.emulation.between_places import (
    BetweenPlaces,
    Piece,
    between_places,
    degree_of,
    neighbours,
)
from hybridsurrogate.surrogates.emulation.components import Curves, principal, scatter_of
from hybridsurrogate.surrogates.emulation.curves import MIN_CURVE_ROWS, MIN_CURVES, distinct
from hybridsurrogate.types import FloatArray


@dataclass(frozen=True, eq=False)
class Field(Curves):
    """Runs as fields, ``places`` (n_places, 2) all pairs of those of two axes.

    Attributes
    ----------
    axes : tuple of two ndarray
        The places of each.
    degrees : tuple of int
        Of the interpolation along each.
    """

    axes: tuple[FloatArray, FloatArray]
    degrees: tuple[int, int]

    def interpolated(self, table: FloatArray) -> Callable[[FloatArray], FloatArray]:
        """Return the function of places (n, 2) -> (n, m) that interpolates (n_places, m)."""
        c, knots = table.reshape(*map(len, self.axes), -1), []
        for axis, (places, degree) in enumerate(zip(self.axes, self.degrees, strict=True)):
            spline = make_interp_spline(places, np.moveaxis(c, axis, 0), k=degree)
            knots.append(spline.t)
            c = np.moveaxis(spline.c, 0, axis)
        out: Callable[[FloatArray], FloatArray]
        out = NdBSpline(tuple(knots), np.ascontiguousarray(c), self.degrees)
        return out


@dataclass(frozen=True, eq=False)
class BetweenBoth:
    """Error of interpolation along two axes, one after the other: the sum of both.

    Attributes
    ----------
    axes : tuple of two BetweenPlaces
    alike : tuple of two float
        Correlation of the error along one axis between neighbouring places of the other.
    """

    axes: tuple[BetweenPlaces, BetweenPlaces]
    alike: tuple[float, float]

    def sd(self, x: FloatArray) -> FloatArray:
        """Return the standard deviation at places (n, 2)."""
        return np.hypot(*(one.sd(at) for one, at in zip(self.axes, x.T, strict=True)))

    def correlations(self, x: FloatArray, others: FloatArray) -> FloatArray:
        """Return those of errors at places (n, 2) and (m, 2), shape (n, m)."""
        total = np.zeros((len(x), len(others)))
        for k, (one, alike) in enumerate(zip(self.axes, self.alike, strict=True)):
            places = self.axes[1 - k].places
            steps = np.arange(len(places))
            at, by = (np.interp(p[:, 1 - k], places, steps) for p in (x, others))
            own = one.correlations(x[:, k], others[:, k]) * alike ** np.abs(at[:, None] - by)
            total += own * np.outer(one.sd(x[:, k]), one.sd(others[:, k]))
        size = np.outer(self.sd(x), self.sd(others))
        return np.divide(total, size, out=np.zeros_like(total), where=size > 0)


def field_of(X: FloatArray, omega: FloatArray, eta: FloatArray) -> Field | None:
    """Return runs as fields, None where they have no two inputs of which all have all pairs.

    Parameters
    ----------
    X, omega, eta : ndarray of shape (n, n_inputs), (n, n_parameters), (n,)
        Rows of all runs, in any order.
    """
    for along in combinations(range(X.shape[1]), 2):
        first, second = (np.unique(X[:, k], return_inverse=True) for k in along)
        shape = len(first[0]), len(second[0])
        n_places = shape[0] * shape[1]
        if min(shape) < MIN_CURVE_ROWS or n_places * MIN_CURVES > len(eta):
            continue
        others, run = distinct(np.hstack([np.delete(X, along, axis=1), omega]))
        n_runs = len(others)
        if n_runs < MIN_CURVES or n_places * n_runs > len(eta):
            continue
        column = first[1].ravel() * shape[1] + second[1].ravel()
        count = np.bincount(run * n_places + column, minlength=n_runs * n_places)
        if not count.all():
            continue
        total = np.bincount(run * n_places + column, eta, n_runs * n_places)
        outputs = (total / count).reshape(n_runs, n_places)
        scatter = scatter_of(column, run, eta, n_places, others)
        seen = outputs
        if scatter.directions:  # it is no error of interpolation
            mean, left, size, curves = principal(outputs, scatter)
            seen = mean + left * size @ curves
        axes = first[0], second[0]
        degrees, between = _between(axes, seen.reshape(n_runs, *shape))
        places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
        own = max(degrees), between, scatter, axes, degrees
        return Field(along, places, others, outputs, *own)
    return None


def _between(
    axes: tuple[FloatArray, FloatArray], fields: FloatArray
) -> tuple[tuple[int, int], BetweenBoth]:
    """Return degrees and error of the interpolation of fields (n_runs, n_first, n_second)."""
    found = []
    for k, places in enumerate(axes):
        lines = np.moveaxis(fields, 1 + k, 2)
        piece: Piece = places, lines.reshape(-1, len(places))
        degree = degree_of([piece])
        between = between_places(places, np.zeros(len(places)), [piece], degree)
        found.append((degree, between, neighbours(piece, degree, len(axes[1 - k]))))
    degrees, betweens, alike = zip(*found, strict=True)
    return degrees, BetweenBoth(betweens, alike)
