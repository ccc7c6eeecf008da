"""The few curves that all runs are made of, and those by which repeated runs differ.

Runs of a stochastic simulation that repeat the same parameters differ by a curve: its covariance
along the places is pooled over all repeats, but for its size, and components are those of the mean
curves.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline
from scipy.special import digamma, polygamma
from sklearn.exceptions import ConvergenceWarning

from hybridsurrogate.numerics.linear_algebra import NEGLIGIBLE
from hybridsurrogate.types import FloatArray

# what the components leave of the spread of all curves, and how many there are at most
LEFT_OUT, _MAX_COMPONENTS = 1e-3, 40


# repeated runs that a changing noise is learned from, at random of more: time grows with their cube
_LEARNED_REPEATS = 300
# bounds of the variance of its log, where a low one is a constant, and of lengths in ranges
_AMPLITUDES, _LENGTHS = (1e-5, 1e2), (0.2, 100.0)
# of the pooled variance: repeats that agree have no logarithm
_LEAST_SHARE = 1e-4


class Noise(NamedTuple):
    """How far runs of equal inputs and parameters differ.

    Attributes
    ----------
    sd : float
        Pooled over all runs that are repeated; 0 where none is.
    low, width : ndarray of shape (d,)
        Ranges of the runs.
    process : GaussianProcessRegressor or None
        Of the log of the variance; None where it is equal everywhere.
    level : float
        Of the standard deviation, in units of the process's.
    """

    sd: float
    low: FloatArray
    width: FloatArray
    process: Any = None
    level: float = 1.0

    @classmethod
    def of_rows(cls, points: FloatArray, y: FloatArray) -> Noise:
        """Return what repeats at equal points (n, d) show, with outputs (n,)."""
        table = pd.DataFrame(points)
        keys = table.groupby([*table.columns]).ngroup().to_numpy()
        groups = pd.Series(y).groupby(keys)
        degrees = groups.size().to_numpy() - 1
        squares = groups.var(ddof=0).to_numpy() * (degrees + 1)
        return cls.of(table.groupby(keys).first().to_numpy(), squares, degrees)

    @classmethod
    def of(cls, points: FloatArray, squares: FloatArray, degrees: FloatArray) -> Noise:
        """Return the noise that sums of squares (n,) at points (n, d) show, and its change.

        The log of a variance of f degrees of freedom has a known mean and variance (Bartlett and
        Kendall 1946, Journal of the Royal Statistical Society Supplement 8:128); over the points
        it is a Gaussian process (Ankenman, Nelson and Staum 2010, Operations Research 58:371), its
        amplitude, which may vanish, and its lengths at their most likely values.
        """
        low, width = points.min(axis=0), np.ptp(points, axis=0)
        width[width == 0] = 1.0
        repeated = np.flatnonzero(degrees)
        if not len(repeated) or not squares.any():
            return cls(0.0, low, width)
        pooled = np.sum(squares) / np.sum(degrees)
        equal = cls(float(np.sqrt(pooled)), low, width)
        # takes long to import, and few simulations scatter
        from sklearn.gaussian_process import GaussianProcessRegressor
        from sklearn.gaussian_process.kernels import RBF, ConstantKernel

        some = np.random.default_rng(0).permutation(repeated)[:_LEARNED_REPEATS]
        half, variance = degrees[some] / 2, squares[some] / degrees[some]
        log = np.log(np.maximum(variance / pooled, _LEAST_SHARE)) - digamma(half) + np.log(half)
        error = polygamma(1, half)
        kernel = ConstantKernel(1.0, _AMPLITUDES) * RBF(np.ones(len(low)), _LENGTHS)
        process = GaussianProcessRegressor(kernel, alpha=error, random_state=0)
        with warnings.catch_warnings():  # an input of no influence has the longest length
            warnings.simplefilter("ignore", ConvergenceWarning)
            process.fit((points[some] - low) / width, log - np.average(log, weights=1 / error))
        # an amplitude and the lengths must pay for themselves (Akaike 1974, IEEE Transactions on
        # Automatic Control 19:716)
        constant = np.log([_AMPLITUDES[0], *np.ones(len(low))])
        gain = process.log_marginal_likelihood_value_ - process.log_marginal_likelihood(constant)
        if gain < len(constant):
            return equal
        found = equal._replace(process=process)
        ratio = variance / found.at(points[some]) ** 2
        return found._replace(level=float(np.sqrt(np.average(ratio, weights=half))))

    def at(self, points: FloatArray) -> FloatArray:
        """Return the standard deviation (n,) at inputs and parameters (n, d)."""
        if self.process is None:
            return np.full(len(points), self.sd)
        log, error = self.process.predict((points - self.low) / self.width, return_std=True)
        return np.asarray(self.level * np.exp((log + error**2 / 2) / 2))


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
    size : Noise
        On both, over the further inputs and the parameters.
    """

    curves: FloatArray
    rest: FloatArray
    share: float
    factor: float
    size: Noise

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
    def is_known(self) -> bool:
        """Whether some runs are repeated."""
        return self.share < 1

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
        spline, scatter = self.interpolated(table), self.scatter
        of_scatter = scatter.factor, scatter.size
        return Components(left * size, self.ends, spline, self.between, *of_scatter)

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
    size : Noise
        Both of the scatter.
    """

    coefficients: FloatArray
    ends: FloatArray
    spline: Callable[[FloatArray], FloatArray]
    between: Between
    factor: float
    size: Noise

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
    column: NDArray[np.intp],
    run: NDArray[np.intp],
    eta: FloatArray,
    n_places: int,
    others: FloatArray,
) -> Scatter:
    """Return how repeats that have all places differ, of rows (n,) at a place of a run.

    Curves as long as they are larger than those of independent rows. ``others`` (n_runs, d) are the
    further inputs and the parameters of the runs.
    """
    n_runs, nothing = len(others), np.zeros(len(others))
    equal = Noise.of(others, nothing, nothing)._replace(sd=1.0)
    none = Scatter(np.empty((0, n_places)), np.zeros(n_places), 1.0, 1.0, equal)
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
    scatter = Scatter(
        size[:q, None] * curves[:q], rest, float(share / n_runs), float(factor), equal
    )
    total = float(np.sum(differ**2))
    if not total:
        return scatter
    # a sum over all places has the degrees of freedom of so many directions (Satterthwaite 1946,
    # Biometrics Bulletin 2:110)
    squares = pd.Series(degrees * np.sum(differ**2, axis=1) / total).groupby(
        whole.index.get_level_values("run")
    )
    own = others[squares.size().index]
    each = scatter.directions * np.array([squares.sum(), squares.size() - 1])
    return scatter._replace(size=Noise.of(own, *each)._replace(sd=1.0))
