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
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

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
    LocalError,
    Places,
    Process,
    condensed,
    process_through,
)
from hybridsurrogate.types import FloatArray

# rows are curves where there are so many runs at least and so many rows a run on average
_LEAST_RUNS, _LEAST_ROWS = 8, 5
# places of a common grid, at most, where each run has its own; and columns of the error of
# interpolation, of which the residual shares one
_MOST_PLACES = 1000
# what the components leave of the spread of all curves, and how many there are at most
_LEFT, _MOST_COMPONENTS = 1e-3, 40
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
    """

    along: int
    places: FloatArray
    others: FloatArray
    outputs: FloatArray
    degree: int
    between: BetweenPlaces

    @cached_property
    def components(self) -> Components:
        """The principal components of the outputs."""
        mean = self.outputs.mean(axis=0)
        left, size, curves = np.linalg.svd(self.outputs - mean, full_matrices=False)
        total = float(np.sum(size**2))
        rest = np.append(np.cumsum(size[::-1] ** 2)[::-1], 0.0)
        k = int(np.argmax(rest <= max(_LEFT**2 * total, 1e-300)))
        k = min(max(k, 1), _MOST_COMPONENTS, len(size))
        missed = np.sqrt(np.mean((left[:, k:] * size[k:] @ curves[k:]) ** 2, axis=0))
        table = np.vstack([mean, curves[:k], missed]).T
        spline = make_interp_spline(self.places, table, k=self.degree)
        return Components(left[:, :k] * size[:k], self.places[[0, -1]], spline, self.between)


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
        Mean, components, and the standard deviation of the residual, k + 2 curves.
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
        table = self.spline(np.clip(places, *self.ends))
        return table[:, 0], table[:, 1:-1], np.maximum(table[:, -1], 0.0)


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
    best: tuple[int, FloatArray, NDArray[np.intp]] | None = None
    for along in range(X.shape[1]):
        others, run = _alike(np.hstack([np.delete(X, along, axis=1), omega]))
        are_curves = _LEAST_RUNS <= len(others) <= len(eta) / _LEAST_ROWS
        if are_curves and (best is None or len(others) < len(best[1])):
            best = along, others, run
    if best is None:
        return None
    along, others, run = best
    places, table, interpolated = _on_one_grid(X[:, along], run, eta, len(others))
    if len(places) < _LEAST_ROWS:
        return None
    whole = ~(interpolated | np.isnan(table)).any(axis=1)
    enough = np.sum(whole) >= _LEAST_RUNS
    pieces = [(places, table[whole])] if enough else _runs(X[:, along], run, eta)
    degree = degree_of(pieces)
    between = between_places(places, interpolated.mean(axis=0), pieces, degree)
    return Curves(along, places, others, _filled(table), degree, between)


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
    """

    along: int
    components: Components
    process: Process
    runs: Places
    weights: FloatArray
    whiten: FloatArray
    sd: FloatArray
    local: LocalError

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
        """Return `output` (n,) and `spread` (n, k + 1)."""
        points, group = self._points(X, omega)
        coefficients, left = self._given_runs(points)
        mean, curves, missed = self.components.at(X[:, self.along])
        output = mean + np.einsum("nk,nk->n", curves, coefficients[group])
        rest = np.hypot(missed, self.between(X))
        return output, np.column_stack([left[group, None] * curves * self.sd, rest])

    def spread(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Return S (n, k + 1): the error has covariance S S' among rows of equal parameters.

        But for interpolation, of which the last column has the size: `error` has its correlations.
        """
        return self.both(X, omega)[1]

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
        """Return `both` of n inputs for each of J parameters, (J, n) and (J, n, k + 1)."""
        if X.shape[1] > 1:
            output, spread = self.both(*each_with_each(X, omega))
            return output.reshape(len(omega), -1), spread.reshape(len(omega), len(X), -1)
        mean, curves, missed = self.components.at(X[:, 0])
        coefficients, left = self._given_runs(omega)
        spread = np.empty((len(omega), len(X), len(self.sd) + 1))
        np.multiply(left[:, None, None], curves * self.sd, out=spread[..., :-1])
        spread[..., -1] = np.hypot(missed, self.between(X))
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
        """Return F (n, r): the covariance of the error at all these rows is F F'."""
        points, group = self._points(X, omega)
        places = self._places(points)
        _, curves, missed = self.components.at(X[:, self.along])
        if len(points) == 1:
            factor = self._given_runs(points)[1][:, None]
        else:
            factor = _factor(self.covariance(points))
        of_runs = (curves * self.sd)[:, :, None] * factor[group][:, None, :]
        of_places, rest = self._error_between(X, places, group, missed)
        F = np.column_stack([of_runs.reshape(len(X), -1), of_places, rest])
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
    return CurveEmulator(
        curves.along,
        components,
        process,
        runs.places.of(given.centers),
        given.weights,
        given.whiten,
        given.sd,
        local,
    )
