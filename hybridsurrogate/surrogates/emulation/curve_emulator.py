"""Runs that are curves, emulated: a Gaussian process for the coefficients of their components.

A run that returns the output at many places along one input, mostly time, is one run and not many:
its parameters stand once. All curves together are a mean plus a few principal components, and each
component's coefficient is a function of the parameters alone (Higdon, Gattiker, Williams and
Rightley 2008, Journal of the American Statistical Association 103:570, section 2.2).

All coefficients share one correlation of the parameters and each has a separate variance, so that
R runs of T places cost R^3 + R^2 T and not (R T)^3 (Higdon, Gattiker, Williams and Rightley 2008,
Journal of the American Statistical Association 103:570; one correlation for all: Conti and O'Hagan
2010, Journal of Statistical Planning and Inference 140:640). What the components leave out is part
of the error, and so is the interpolation along the curves between places that were simulated.

Runs of a stochastic simulation that repeat the same parameters differ by a curve: its covariance
along the places is pooled over all repeats, and components are those of the mean curves.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_interp_spline

from hybridsurrogate.numerics.linear_algebra import (
    NEGLIGIBLE,
    blocks,
    each_with_each,
    pivoted_cholesky,
    pivoted_factor,
)
from hybridsurrogate.surrogates.emulation.between_places import (
    BetweenPlaces,
    Piece,
    between_places,
    degree_of,
)
from hybridsurrogate.surrogates.emulation.covariance import (
    MOST_CURVES,
    LocalError,
    Places,
    Process,
    condensed,
    process_through,
    used_rows,
)
from hybridsurrogate.types import FloatArray

# rows are curves where there are so many runs at least and so many rows a run on average
_LEAST_RUNS, _LEAST_ROWS = 8, 5
# places of a common grid, at most, where each run has its own; and columns of the error of
# interpolation, of which the residual shares one
_MOST_PLACES = 1000
# what the components leave of the spread of all curves, and how many there are at most
_LEFT, _MOST_COMPONENTS = 1e-3, 40
# of the variance of repeated runs, what is left to the noise of single rows
_HUNDREDTH = 0.01
# rounds in which missing pieces of curves are filled in from the components
_ROUNDS = 10


@dataclass(frozen=True, eq=False)
class Curves:
    """Runs as curves along one input.

    Attributes
    ----------
    along : int
        The input along which a run has many rows.
    places : ndarray of shape (n_places,)
        Its values.
    others : ndarray of shape (n_runs, d)
        The other inputs and the parameters, one row a run.
    outputs : ndarray of shape (n_runs, n_places)
    degree : int
        Of the interpolation along the curves, 1 or 3.
    between : BetweenPlaces
        Error of interpolation along the curves.
    scatter : ndarray of shape (q, n_places)
        Repeated runs differ by the sum of these curves, each times a standard normal number,
    rest : ndarray of shape (n_places,)
        and by independent numbers with these standard deviations.
    share : float
        Variance of the mean of a run's repeats in units of that of one.
    """

    along: int
    places: FloatArray
    others: FloatArray
    outputs: FloatArray
    degree: int
    between: BetweenPlaces
    scatter: FloatArray
    rest: FloatArray
    share: float

    @cached_property
    def components(self) -> Components:
        """The principal components of the outputs, of mean curves those above their noise."""
        noise = _noise(self.scatter, self.rest, self.share)
        mean, left, size, curves, k = _principal(self.outputs, noise)
        square = np.mean((left[:, k:] * size[k:] @ curves[k:]) ** 2, axis=0)
        noise = noise - noise @ curves[:k].T @ curves[:k]
        missed = np.sqrt(np.maximum(square - np.sum(noise**2, axis=0), 0.0))
        table = np.vstack([mean, curves[:k], missed, self.rest, self.scatter]).T
        spline = make_interp_spline(self.places, table, k=self.degree)
        return Components(left[:, :k] * size[:k], self.places[[0, -1]], spline, self.between)


def _noise(scatter: FloatArray, rest: FloatArray, share: float) -> FloatArray:
    """Return N (r, n_places): the noise of mean curves has covariance N' N."""
    return np.sqrt(share) * np.vstack([scatter, np.diag(rest)[rest > 0]])


def _principal(
    outputs: FloatArray, noise: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, int]:
    """Return mean and singular values and vectors of curves, and how many of these are kept.

    Of stochastic runs, with noise as from `_noise`, those with more variance than noise alone has.
    """
    mean = outputs.mean(axis=0)
    left, size, curves = np.linalg.svd(outputs - mean, full_matrices=False)
    rest = np.append(np.cumsum(size[::-1] ** 2)[::-1], 0.0)
    k = int(np.argmax(rest <= max(_LEFT**2 * rest[0], 1e-300)))
    if len(noise):
        variance = np.sum(noise**2, axis=1)
        most = _by_chance(np.sum(variance) ** 2 / np.sum(variance**2), len(outputs))
        own = np.sum((curves[:k] @ noise.T) ** 2, axis=1)
        k = int(np.sum(np.cumprod(size[:k] ** 2 > len(outputs) * own * most)))
    return mean, left, size, curves, min(max(k, 1), _MOST_COMPONENTS, len(size))


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
    spline : BSpline
        Mean, components, the standard deviations of the residual and of the rest of the scatter,
        and the scatter of repeated runs, k + 3 + q curves.
    between : BetweenPlaces
        Error of interpolation along them.
    """

    coefficients: FloatArray
    ends: FloatArray
    spline: BSpline
    between: BetweenPlaces

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


def curves_of(X: FloatArray, omega: FloatArray, eta: FloatArray) -> Curves | None:
    """Return runs as curves, None where each row is a separate run.

    Rows with the same parameters and the same inputs but one are a run along that one.

    Parameters
    ----------
    X, omega, eta : ndarray of shape (n, n_inputs), (n, n_parameters), (n,)
        Rows of all runs, in any order.
    """
    if not omega.shape[1] or len(eta) < _LEAST_RUNS * _LEAST_ROWS:
        return None
    # quick, for runs that are no curves may be millions
    if np.sum(~pd.DataFrame(omega).duplicated()) * _LEAST_ROWS > len(eta):
        return None
    # repeats of a run are no rows of a curve
    n_rows = int(np.sum(~pd.DataFrame(np.hstack([X, omega])).duplicated()))
    best: tuple[int, FloatArray, NDArray[np.intp]] | None = None
    for along in range(X.shape[1]):
        others, run = _alike(np.hstack([np.delete(X, along, axis=1), omega]))
        are_curves = _LEAST_RUNS <= len(others) <= n_rows / _LEAST_ROWS
        if are_curves and (best is None or len(others) < len(best[1])):
            best = along, others, run
    if best is None:
        return None
    along, others, run = best
    places, table, interpolated = _on_one_grid(X[:, along], run, eta, len(others))
    if len(places) < _LEAST_ROWS:
        return None
    scatter, rest, share = _scatter(places, X[:, along], run, eta, len(others))
    whole = ~(interpolated | np.isnan(table)).any(axis=1)
    enough = np.sum(whole) >= _LEAST_RUNS
    pieces = [(places, table[whole])] if enough else _runs(X[:, along], run, eta)
    filled = _filled(table)
    noise = _noise(scatter, rest, share)
    if len(noise):  # it is no error of interpolation
        mean, left, size, curves, k = _principal(filled, noise)
        pieces = [(places, mean + left[:, :k] * size[:k] @ curves[:k])]
    degree = degree_of(pieces)
    between = between_places(places, interpolated.mean(axis=0), pieces, degree)
    return Curves(along, places, others, filled, degree, between, scatter, rest, share)


def _scatter(
    places: FloatArray, x: FloatArray, run: NDArray[np.intp], eta: FloatArray, n_runs: int
) -> tuple[FloatArray, FloatArray, float]:
    """Return ``scatter``, ``rest`` and ``share`` of `Curves`: of repeats that have all places.

    Curves as long as they are larger than those of independent rows. The inverse of a covariance
    that is estimated is too large, by a factor that makes up for it (Hartlap, Simon and Schneider
    2007, Astronomy and Astrophysics 464:399, equation 17).
    """
    none = np.empty((0, len(places))), np.zeros(len(places)), 1.0
    column = np.searchsorted(places, x)
    if np.any(places[np.minimum(column, len(places) - 1)] != x):
        return none
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
    directions = len(places) - np.arange(len(size))
    larger = size**2 > left / directions * _by_chance(directions, degrees)
    q = int(np.sum(np.cumprod(larger & (left > _HUNDREDTH * left[0]))[:_MOST_COMPONENTS]))
    share = np.sum(1 / by_run.size()) + n_runs - by_run.ngroups
    rest = np.sqrt(np.sum((size[q:, None] * curves[q:]) ** 2, axis=0))
    size = size * np.sqrt(degrees / max(degrees - q - 1, 1))
    return size[:q, None] * curves[:q], rest, float(share / n_runs)


def _alike(rows: FloatArray) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return the different rows, and which of them each is; quick where equal ones follow."""
    new = np.append(True, np.any(rows[1:] != rows[:-1], axis=1))
    first, which = np.unique(rows[new], axis=0, return_inverse=True)
    return first, which.ravel()[np.cumsum(new) - 1]


def _runs(x: FloatArray, run: NDArray[np.intp], eta: FloatArray) -> list[Piece]:
    """Return places and outputs of each run, in order."""
    order = np.lexsort((x, run))
    pieces = []
    for rows in np.split(order, np.cumsum(np.bincount(run))[:-1]):
        own, first = np.unique(x[rows], return_index=True)
        pieces.append((own, eta[rows][first][None]))
    return pieces


def _on_one_grid(
    x: FloatArray, run: NDArray[np.intp], eta: FloatArray, n_runs: int
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Return places (n_places,), outputs (n_runs, n_places), and which of these are interpolated.

    NaN where a run has no output. Gaps are left to the components where most runs have none: these
    know a rough curve better.
    """
    places, column = np.unique(x, return_inverse=True)
    rows_a_run = np.bincount(run, minlength=n_runs)
    if len(places) <= 2 * np.median(rows_a_run):
        flat = run * len(places) + column.ravel()
        count = np.bincount(flat, minlength=n_runs * len(places))
        total = np.bincount(flat, weights=eta, minlength=n_runs * len(places))
        with np.errstate(invalid="ignore"):
            table = (total / count).reshape(n_runs, len(places))
        gaps = np.isnan(table)
        some = np.flatnonzero(gaps.any(axis=1))
        if n_runs - len(some) < max(_LEAST_RUNS, n_runs // 2):
            for k in some:
                there = ~gaps[k]
                table[k] = _interpolated(places[there], table[k, there], places)
        return places, table, gaps & ~np.isnan(table)
    # each run has its own places: as many as a run has, where their quantiles are
    n = min(2 * int(np.median(rows_a_run)), _MOST_PLACES)
    grid = np.unique(np.quantile(places, np.linspace(0, 1, n)))
    table = np.array([_interpolated(own, y[0], grid) for own, y in _runs(x, run, eta)])
    return grid, table, ~np.isnan(table)


def _interpolated(x: FloatArray, y: FloatArray, at: FloatArray) -> FloatArray:
    """Return y at places within its range, NaN beyond by more than half a typical step."""
    if len(x) < 2:
        return np.full(len(at), np.nan)
    degree = degree_of([(x, y[None])])
    value: FloatArray = make_interp_spline(x, y, k=degree)(np.clip(at, x[0], x[-1]))
    margin = 0.5 * float(np.median(np.diff(x)))
    value[(at < x[0] - margin) | (at > x[-1] + margin)] = np.nan
    return value


def _filled(table: FloatArray) -> FloatArray:
    """Return curves whose missing pieces are what the components make of the rest.

    The mean of the missing outputs given the others, all curves being draws of a normal
    distribution with the components' covariance; its components are those of complete curves, then
    of all as they are filled.
    """
    gaps = np.isnan(table)
    incomplete = np.flatnonzero(gaps.any(axis=1))
    if not len(incomplete):
        return table
    out = np.where(gaps, np.nanmean(table, axis=0), table)
    out = np.where(np.isnan(out), np.nanmean(table), out)
    whole = np.delete(np.arange(len(table)), incomplete)
    source = whole if len(whole) >= max(_LEAST_RUNS, len(table) // 2) else slice(None)
    for _ in range(_ROUNDS):
        curves = out[source]
        mean = curves.mean(axis=0)
        _, size, axes = np.linalg.svd(curves - mean, full_matrices=False)
        factor = axes.T * (size / np.sqrt(len(curves)))
        noise = (_LEFT * float(np.std(curves))) ** 2
        moved = 0.0
        for k in incomplete:
            there = ~gaps[k]
            own = factor[there]
            inner = noise * np.eye(own.shape[1]) + own.T @ own
            score = np.linalg.solve(inner, own.T @ (table[k, there] - mean[there]))
            again = (mean + factor @ score)[gaps[k]]
            moved = max(moved, float(np.max(np.abs(again - out[k, gaps[k]]))))
            out[k, gaps[k]] = again
        if moved < _LEFT * float(np.std(out)):
            break
        source = slice(None)
    return out


@dataclass(frozen=True, eq=False)
class CurveEmulator:
    """The most probable simulation given its runs, and its error.

    Attributes
    ----------
    along : int
        The input along which a run is a curve.
    components : Components
    process : Process
        Of the other inputs and the parameters, which it sees as parameters.
    runs : Places
        That predictions are made of: all, or fewer that give the others.
    weights : ndarray of shape (n_runs, k)
        Of the runs, for each coefficient.
    whiten : ndarray of shape (n_runs, n_runs)
        Of covariances with the runs: the sum of squares is how much of a variance they take away.
    sd : ndarray of shape (k,)
        Of the process, for each coefficient.
    local : LocalError
        Factors on the error where the runs show that it is larger.
    left_out : LeftOutRuns
        Runs that are left out.
    """

    along: int
    components: Components
    process: Process
    runs: Places
    weights: FloatArray
    whiten: FloatArray
    sd: FloatArray
    local: LocalError
    left_out: LeftOutRuns

    def output(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Return the most probable output for rows of inputs and parameters, (n,)."""
        points, group = self._points(X, omega)
        mean, curves, _ = self.components.at(X[:, self.along])
        return mean + np.einsum("nk,nk->n", curves, self._coefficients(points)[group])

    def output_close_by(
        self, X: FloatArray, omega: FloatArray, shape: tuple[int, int, int]
    ) -> FloatArray:
        """As `output`, of rows of ``shape``: nodes, short moves of which the first is none, rows.

        Where parameters differ between rows, coefficients follow their slopes along moves.
        """
        points, group = self._points(X, omega)
        if len(points) < len(X) // 2:
            return self.output(X, omega)
        places = self._places(points[group])
        coefficients = places.weighted(self.runs, self.weights, shape)
        mean, curves, _ = self.components.at(X[:, self.along])
        return mean + np.einsum("nk,nk->n", curves, coefficients)

    def both(self, X: FloatArray, omega: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return `output` (n,) and `spread` (n, k + 1 + q)."""
        points, group = self._points(X, omega)
        coefficients, left = self._given_runs(points)
        mean, curves, missed = self.components.at(X[:, self.along])
        output = mean + np.einsum("nk,nk->n", curves, coefficients[group])
        rest = np.hypot(missed, self.between(X))
        spread = [left[group, None] * curves * self.sd, rest, self.scatter(X)[0]]
        return output, np.column_stack(spread)

    def spread(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Return S (n, k + 1 + q): the error has covariance S S' among rows of equal parameters.

        But for interpolation, of which column k has the size: `error` has its correlations. The
        last q columns are the scatter of repeated runs.
        """
        return self.both(X, omega)[1]

    @property
    def n_spread(self) -> int:
        """Columns of `spread`."""
        return self.components.spline.c.shape[1] - 2

    def run_of(self, X: FloatArray, omega: FloatArray) -> NDArray[np.intp]:
        """Return which run each row (n,) is of, in the order of the coefficients.

        ``X`` and ``omega`` are all that it was learned from.
        """
        return _alike(np.hstack([np.delete(X, self.along, axis=1), omega]))[1]

    def scatter(self, X: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return S (n, q) and s (n,): runs of a stochastic simulation differ by S S' + diag(s^2).

        That is one realisation. Independent numbers are left to the noise of measured rows.
        """
        return self.components.scatter(X[:, self.along])

    def between(self, X: FloatArray) -> FloatArray:
        """Return the standard deviation of interpolation between simulated places, (n,)."""
        return self.components.between.sd(X[:, self.along])

    def outer_output(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Return the output (J, n) of n inputs for each of J parameters."""
        if X.shape[1] > 1:
            return self.output(*each_with_each(X, omega)).reshape(len(omega), len(X))
        mean, curves, _ = self.components.at(X[:, 0])
        return mean + self._coefficients(omega) @ curves.T

    def outer_both(self, X: FloatArray, omega: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return `both` of n inputs for each of J parameters, (J, n) and (J, n, k + 1 + q)."""
        if X.shape[1] > 1:
            output, spread = self.both(*each_with_each(X, omega))
            return output.reshape(len(omega), -1), spread.reshape(len(omega), len(X), -1)
        mean, curves, missed = self.components.at(X[:, 0])
        coefficients, left = self._given_runs(omega)
        scatter, k = self.scatter(X)[0], len(self.sd)
        spread = np.empty((len(omega), len(X), k + 1 + scatter.shape[1]))
        np.multiply(left[:, None, None], curves * self.sd, out=spread[..., :k])
        spread[..., k] = np.hypot(missed, self.between(X))
        spread[..., k + 1 :] = scatter
        return mean + coefficients @ curves.T, spread

    def _coefficients(self, points: FloatArray) -> FloatArray:
        """Return the most probable coefficients of the components (n, k)."""
        out = np.empty((len(points), len(self.sd)))
        for some in blocks(len(points), len(self.weights)):
            out[some] = self._places(points[some]).alike(self.runs) @ self.weights
        return out

    def _given_runs(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return `_coefficients` and their standard deviation, (n,) in units of the process's."""
        coefficients, left = np.empty((len(points), len(self.sd))), np.empty(len(points))
        for some in blocks(len(points), len(self.weights)):
            places = self._places(points[some])
            alike = places.alike(self.runs)
            coefficients[some] = alike @ self.weights
            white = alike @ self.whiten.T
            variance = places.variances() - np.einsum("ij,ij->i", white, white)
            left[some] = np.sqrt(np.maximum(variance, 0.0)) * self.local.at(places.points)
        return coefficients, left

    def error(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Return F (n, r): the covariance of the error at all these rows is F F'.

        With the scatter of a stochastic simulation: rows whose other inputs are equal are one
        realisation, also where parameters differ between them.
        """
        points, group = self._points(X, omega)
        places = self._places(points)
        _, curves, missed = self.components.at(X[:, self.along])
        if len(points) == 1:
            factor = self._given_runs(points)[1][:, None]
        else:
            factor = _factor(self.covariance(points))
        of_runs = (curves * self.sd)[:, :, None] * factor[group][:, None, :]
        of_places, rest = self._error_between(X, places, group, missed)
        realisation = _alike(np.delete(X, self.along, axis=1))[1]
        own = realisation[:, None] == np.arange(np.max(realisation, initial=-1) + 1)
        scatter = (self.scatter(X)[0][:, None] * own[:, :, None]).reshape(len(X), -1)
        F = np.column_stack([of_runs.reshape(len(X), -1), of_places, rest, scatter])
        if F.shape[1] <= len(X):
            return F
        return _factor(F @ F.T)

    def _error_between(
        self, X: FloatArray, places: Places, group: NDArray[np.intp], missed: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the factor (n, r) of the error of interpolation, and one column (n,) of the rest.

        That is what the components leave, and interpolation where it is smaller. Errors are as
        alike between parameters as the curves are.
        """
        sd, x = self.between(X), X[:, self.along]
        off = np.flatnonzero(sd)
        factor = np.zeros((len(X), 0))
        if len(off):
            own, at, of = sd[off], x[off], group[off]

            def column(k: int) -> FloatArray:
                along = self.components.between.correlations(at, at[k : k + 1])[:, 0]
                alike = places.alike(places.of(slice(of[k], of[k] + 1)))[of, 0]
                return own * own[k] * along * alike

            least = max(NEGLIGIBLE * float(np.max(own**2)), float(np.mean(missed**2)))
            some, _ = pivoted_cholesky(own**2, column, least, _MOST_PLACES)
            factor = np.zeros((len(X), some.shape[1]))
            factor[off] = some
        left = np.maximum(sd**2 - np.sum(factor**2, axis=1), 0.0)
        return factor, np.sqrt(missed**2 + left)

    def covariance(self, points: FloatArray) -> FloatArray:
        """Return the covariance (m, m) of the error at runs (m, d), in units of the process's.

        A run is its further inputs and its parameters.
        """
        places = self._places(points)
        white = places.alike(self.runs) @ self.whiten.T
        local = self.local.at(places.points)
        return (places.alike(places) - white @ white.T) * local * local[:, None]

    def _points(self, X: FloatArray, omega: FloatArray) -> tuple[FloatArray, NDArray[np.intp]]:
        """Return the parameters of rows that follow one another with equal ones, and of which."""
        rows = np.hstack([np.delete(X, self.along, axis=1), omega])
        new = np.ones(len(rows), dtype=bool)
        new[1:] = np.any(rows[1:] != rows[:-1], axis=1)
        return rows[new], np.cumsum(new) - 1

    def _places(self, points: FloatArray) -> Places:
        return self.process.places(np.empty((len(points), 0)), points)


class LeftOutRuns(NamedTuple):
    """Runs that are left out, of those that the process is conditioned on.

    Attributes
    ----------
    runs : ndarray of shape (m,)
        Which they are, of all runs in the order of the coefficients.
    coefficients : ndarray of shape (m, k)
        Of their components, as all others predict them.
    variance : ndarray of shape (m,)
        Of these means and of a run's noise, in units of the process's.
    noise : float
        The part of it that is noise.
    """

    runs: NDArray[np.intp]
    coefficients: FloatArray
    variance: FloatArray
    noise: float


def _factor(covariance: FloatArray) -> FloatArray:
    """Return F (n, r) with F F' the covariance (n, n), but for what is negligible."""
    return pivoted_factor(
        covariance, NEGLIGIBLE * float(np.max(np.diagonal(covariance), initial=0))
    )


def emulate_curves(
    X: FloatArray,
    omega: FloatArray,
    eta: FloatArray,
    input_ranges: FloatArray,
    parameter_ranges: FloatArray,
) -> CurveEmulator | None:
    """Return the emulator of runs that are curves, None where each row is a run.

    Parameters
    ----------
    X, omega, eta : ndarray of shape (n, n_inputs), (n, n_parameters), (n,)
        Rows of the runs.
    input_ranges, parameter_ranges : ndarray of shape (n_inputs, 2), (n_parameters, 2)
    """
    curves = curves_of(X, omega, eta)
    if curves is None:
        return None
    ranges = np.vstack([np.delete(input_ranges, curves.along, axis=0), parameter_ranges])
    components = curves.components
    empty = np.empty((len(curves.others), 0))
    coefficients = components.coefficients
    process = process_through(None, ranges, empty, curves.others, coefficients)
    runs = process.some(empty, curves.others, coefficients)
    matrix = runs.places.alike(runs.places)
    given = condensed(matrix, process.covariance.nugget, runs.residual)
    local = LocalError.of(runs.places.points, given.misses)
    used = used_rows(len(coefficients), MOST_CURVES)
    variance = local.at(runs.places.points) ** 2 / given.precision
    mean = coefficients[used] - given.left_out
    left_out = LeftOutRuns(used, mean, variance, process.covariance.nugget)
    return CurveEmulator(
        curves.along,
        components,
        process,
        runs.places.of(given.centers),
        given.weights,
        given.whiten,
        given.sd,
        local,
        left_out,
    )
