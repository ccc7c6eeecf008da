"""The few curves that all runs are made of, and those by which repeated runs differ.

Runs of a stochastic simulation that repeat the same parameters differ by a curve: its covariance
along the places is pooled over all repeats, and components are those of the mean curves.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from hybridsurrogate.numerics.linear_algebra import NEGLIGIBLE
from hybridsurrogate.types import FloatArray

# what the components leave of the spread of all curves, and how many there are at most
LEFT_OUT, _MAX_COMPONENTS = 1e-3, 40


class Between(Protocol):
    """Error of interpolation between places."""

    def sd(self, x: FloatArray) -> FloatArray:
        """Return the standard deviation at places, (n,)."""

    def correlations(self, x: FloatArray, others: FloatArray) -> FloatArray:
        """Return those of errors at n and m places, shape (n, m)."""


class Scatter(NamedTuple):
    """How runs that are repeated differ.

    Attributes
    ----------
    curves : ndarray of shape (q, n_places)
        By the sum of these, each times a standard normal number,
    rest : ndarray of shape (n_places,)
        and by independent numbers with these standard deviations.
    share : float
        Variance of the mean of a run's repeats in units of that of one.
    factor : float
        On the curves where the inverse of their covariance is meant: that of an estimate is too
        large (Hartlap, Simon and Schneider 2007, Astronomy and Astrophysics 464:399, equation 17).
    """

    curves: FloatArray
    rest: FloatArray
    share: float
    factor: float

    def along(self, components: FloatArray) -> FloatArray:
        """Return the variance (k,) of mean curves along components (k, n_places)."""
        of_curves = np.sum((components @ self.curves.T) ** 2, axis=1)
        return np.asarray(self.share * (of_curves + components**2 @ self.rest**2))

    def left_by(self, components: FloatArray) -> FloatArray:
        """Return the variance (n_places,) of what components leave of mean curves."""
        curves = self.curves - self.curves @ components.T @ components
        of_rest = self.rest**2 * (1 - 2 * np.sum(components**2, axis=0))
        both = (components * self.rest**2) @ components.T
        of_rest += np.einsum("kt,kt->t", components, both @ components)
        return np.asarray(self.share * (np.sum(curves**2, axis=0) + of_rest))

    @property
    def directions(self) -> float:
        """How many of equal variance it has: the participation ratio, 0 of no scatter."""
        variance = np.append(np.sum(self.curves**2, axis=1), self.rest**2)
        total = float(np.sum(variance))
        return total**2 / float(np.sum(variance**2)) if total else 0.0


@dataclass(frozen=True, eq=False)
class Curves:
    """Runs as curves along one input.

    Attributes
    ----------
    along : int
        The input along which a run has many rows; of fields two.
    places : ndarray of shape (n_places,)
        Its values.
    others : ndarray of shape (n_runs, d)
        The other inputs and the parameters, one row a run.
    outputs : ndarray of shape (n_runs, n_places)
    degree : int
        Of the interpolation along the curves, 1 or 3.
    between : BetweenPlaces or BetweenBoth
        Error of interpolation along the curves.
    scatter : Scatter
    """

    along: int | tuple[int, int]
    places: FloatArray
    others: FloatArray
    outputs: FloatArray
    degree: int
    between: Between
    scatter: Scatter

    @cached_property
    def components(self) -> Components:
        """The principal components of the outputs, of mean curves those above their noise."""
        mean, left, size, curves = principal(self.outputs, self.scatter)
        missed = np.mean((self.outputs - mean - left * size @ curves) ** 2, axis=0)
        missed = np.sqrt(np.maximum(missed - self.scatter.left_by(curves), 0.0))
        table = np.vstack([mean, curves, missed, self.scatter.rest, self.scatter.curves]).T
        spline, factor = self.interpolated(table), self.scatter.factor
        return Components(left * size, self.ends, spline, self.between, factor)

    @property
    def ends(self) -> FloatArray:
        """The first and the last place."""
        return np.array([self.places[0], self.places[-1]])

    def interpolated(self, table: FloatArray) -> Callable[[FloatArray], FloatArray]:
        """Return the function of places (n,) -> (n, m) that interpolates a table (n_places, m)."""
        spline: Callable[[FloatArray], FloatArray]
        spline = make_interp_spline(self.places, table, k=self.degree)
        return spline


def principal(
    outputs: FloatArray, scatter: Scatter
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the mean of curves (n, n_places), and k singular vectors and values of the others.

    Of stochastic runs those with more variance than noise alone has.
    """
    mean = outputs.mean(axis=0)
    left, size, curves = np.linalg.svd(outputs - mean, full_matrices=False)
    rest = np.append(np.cumsum(size[::-1] ** 2)[::-1], 0.0)
    k = int(np.argmax(rest <= max(LEFT_OUT**2 * rest[0], 1e-300)))
    directions, n = scatter.directions, len(outputs)
    if directions:
        least = n * scatter.along(curves[:k]) * _by_chance(directions, n)
        k = int(np.sum(np.cumprod(size[:k] ** 2 > least)))
    k = min(max(k, 1), _MAX_COMPONENTS, len(size))
    return mean, left[:, :k], size[:k], curves[:k]


def _by_chance(directions: Any, n: int) -> Any:
    """Return the largest principal variance of equal directions, from n curves, per their mean.

    Marchenko and Pastur 1967, Mathematics of the USSR-Sbornik 1:457.
    """
    return (1 + np.sqrt(directions / n)) ** 2


@dataclass(frozen=True, eq=False)
class Components:
    """A mean and the components that all curves are made of.

    Attributes
    ----------
    coefficients : ndarray of shape (n_runs, k)
        Of the runs.
    ends : ndarray of shape (2,)
        Of the places.
    spline : callable
        Mean, components, the standard deviations of the residual and of the rest of the scatter,
        and the scatter of repeated runs, k + 3 + q curves.
    between : BetweenPlaces or BetweenBoth
        Error of interpolation along them.
    factor : float
        Of the scatter.
    """

    coefficients: FloatArray
    ends: FloatArray
    spline: Callable[[FloatArray], FloatArray]
    between: Between
    factor: float

    def at(self, places: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return mean (n,), components (n, k) and what these leave (n,) at places.

        Held at the ends. The error of interpolation is not in it.
        """
        table, k = self.spline(np.clip(places, *self.ends)), self.coefficients.shape[1]
        return table[:, 0], table[:, 1 : k + 1], np.maximum(table[:, k + 1], 0.0)

    def scatter(self, places: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return S (n, q) and s (n,): repeated runs have covariance S S' + diag(s^2)."""
        table, k = self.spline(np.clip(places, *self.ends)), self.coefficients.shape[1]
        return table[:, k + 3 :], np.maximum(table[:, k + 2], 0.0)


def scatter_of(
    column: NDArray[np.intp], run: NDArray[np.intp], eta: FloatArray, n_places: int, n_runs: int
) -> Scatter:
    """Return how repeats that have all places differ, of rows (n,) at a place of a run.

    Curves as long as they are larger than those of independent rows.
    """
    none = Scatter(np.empty((0, n_places)), np.zeros(n_places), 1.0, 1.0)
    frame = pd.DataFrame({"run": run, "column": column, "eta": eta})
    frame["repeat"] = frame.groupby(["run", "column"]).cumcount()
    if not frame["repeat"].any():
        return none
    whole = frame.pivot_table("eta", ["run", "repeat"], "column").dropna()
    by_run = whole.groupby("run")
    degrees = len(whole) - by_run.ngroups
    if not degrees:
        return none
    differ = (whole - by_run.transform("mean")).to_numpy() / np.sqrt(degrees)
    _, size, curves = np.linalg.svd(differ, full_matrices=False)
    left = np.cumsum(size[::-1] ** 2)[::-1]
    directions = n_places - np.arange(len(size))
    larger = size**2 > left / directions * _by_chance(directions, degrees)
    # what is left of fewer curves than these is rounding
    larger &= left > NEGLIGIBLE * left[0]
    q = int(np.sum(np.cumprod(larger)[:_MAX_COMPONENTS]))
    share = np.sum(1 / by_run.size()) + n_runs - by_run.ngroups
    rest = np.sqrt(np.sum((size[q:, None] * curves[q:]) ** 2, axis=0))
    factor = np.sqrt(degrees / max(degrees - q - 1, 1))
    return Scatter(size[:q, None] * curves[:q], rest, float(share / n_runs), float(factor))
