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
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from hybridsurrogate.numerics.linear_algebra import (
    MAX_DENSE,
    NEGLIGIBLE,
    blocks,
    each_with_each,
    factor_by_columns,
    pivoted_factor,
)
from hybridsurrogate.surrogates.emulation.components import Components
from hybridsurrogate.surrogates.emulation.covariance import (
    LEAST_NUGGET,
    MAX_CURVES,
    LocalError,
    Places,
    Process,
    condensed,
    process_through,
    used_rows,
)
from hybridsurrogate.surrogates.emulation.curves import (
    MIN_CURVE_ROWS,
    MIN_CURVES,
    curves_of,
    distinct,
)
from hybridsurrogate.surrogates.emulation.fields import field_of
from hybridsurrogate.types import FloatArray


@dataclass(frozen=True, eq=False)
class CurveEmulator:
    """The most probable simulation given its runs, and its error.

    Attributes
    ----------
    along : int, or tuple of two
        The input along which a run is a curve, those over which it is a field.
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
    repeated : bool
        Whether some runs are repeated.
    """

    along: int | tuple[int, int]
    components: Components
    process: Process
    runs: Places
    weights: FloatArray
    whiten: FloatArray
    sd: FloatArray
    local: LocalError
    left_out: LeftOutRuns
    repeated: bool

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
        scatter = self.realisation(X) * self.components.size.at(points)[group, None]
        spread = [left[group, None] * curves * self.sd, rest, scatter]
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
        return 1 + len(self.sd) + self.realisation(np.zeros((1, 1 + np.max(self.along)))).shape[1]

    def run_of(self, X: FloatArray, omega: FloatArray) -> NDArray[np.intp]:
        """Return which run each row (n,) is of, in the order of the coefficients.

        ``X`` and ``omega`` are all that it was learned from.
        """
        return distinct(np.hstack([np.delete(X, self.along, axis=1), omega]))[1]

    def scatter(self, X: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return S (n, q) and s (n,): runs at equal parameters differ by S S' + diag(s^2).

        Where the scatter is of its usual size.
        """
        return self.components.scatter(X[:, self.along])

    def size(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Return how large the scatter is at rows of inputs and parameters, (n,): usually 1."""
        points, group = self._points(X, omega)
        return self.components.size.at(points)[group]

    def realisation(self, X: FloatArray) -> FloatArray:
        """Return F (n, q): one measured run differs from the mean by F F', at the usual size.

        Independent numbers are left to the noise of measured rows.
        """
        return self.scatter(X)[0] * self.components.factor

    def between(self, X: FloatArray) -> FloatArray:
        """Return the standard deviation of interpolation between simulated places, (n,)."""
        return self.components.between.sd(X[:, self.along])

    def outer_output(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Return the output (J, n) of n inputs for each of J parameters."""
        if X.shape[1] > np.size(self.along):
            return self.output(*each_with_each(X, omega)).reshape(len(omega), len(X))
        mean, curves, _ = self.components.at(X[:, self.along])
        return mean + self._coefficients(omega) @ curves.T

    def outer_both(self, X: FloatArray, omega: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return `both` of n inputs for each of J parameters, (J, n) and (J, n, k + 1 + q)."""
        if X.shape[1] > np.size(self.along):
            output, spread = self.both(*each_with_each(X, omega))
            return output.reshape(len(omega), -1), spread.reshape(len(omega), len(X), -1)
        mean, curves, missed = self.components.at(X[:, self.along])
        coefficients, left = self._given_runs(omega)
        scatter, k = self.realisation(X), len(self.sd)
        spread = np.empty((len(omega), len(X), k + 1 + scatter.shape[1]))
        np.multiply(left[:, None, None], curves * self.sd, out=spread[..., :k])
        spread[..., k] = np.hypot(missed, self.between(X))
        np.multiply(
            self.components.size.at(omega)[:, None, None], scatter, out=spread[..., k + 1 :]
        )
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
            variance = np.maximum(variance, 0.0) + self.unrepeated
            left[some] = np.sqrt(variance) * self.local.at(places.points)
        return coefficients, left

    @property
    def unrepeated(self) -> float:
        """Variance of what a run differs by from its neighbours, where none shows that it is noise.

        In units of the process's. Without repeats it is open what a run at these parameters gives.
        """
        noise = self.process.covariance.nugget
        return 0.0 if self.repeated else max(noise - LEAST_NUGGET, 0.0)

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
            factor = _factor(self._of_one_run(points, X.shape[1] - np.size(self.along)))
        of_runs = (curves * self.sd)[:, :, None] * factor[group][:, None, :]
        of_places, rest = self._error_between(X, places, group, missed)
        scatter: FloatArray = self.realisation(X) * self.components.size.at(points)[group, None]
        run = distinct(np.delete(X, self.along, axis=1))[1]
        if scatter.shape[1] and run.any():
            scatter = _factor(scatter @ scatter.T * (run[:, None] == run))
        F = np.column_stack([of_runs.reshape(len(X), -1), of_places, rest, scatter])
        if F.shape[1] <= len(X):
            return F
        return _factor(F @ F.T)

    def _of_one_run(self, points: FloatArray, n_inputs: int) -> FloatArray:
        """Return `covariance` of rows of one run each value of the inputs."""
        run = distinct(points[:, :n_inputs])[1] if n_inputs else np.zeros(len(points))
        local = self.local.at(self._places(points).points)
        same = self.unrepeated * (run[:, None] == run)
        return self.covariance(points) + same * local * local[:, None]

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

            def columns(k: slice) -> FloatArray:
                along = self.components.between.correlations(at, at[k])
                return along * places.alike(places.of(of[k]))[of] * own[k] * own[:, None]

            least = max(NEGLIGIBLE * float(np.max(own**2)), float(np.mean(missed**2)))
            some = factor_by_columns(own**2, columns, least, MAX_DENSE)
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
    noise : ndarray of shape (m,)
        The part of it that is noise.
    """

    runs: NDArray[np.intp]
    coefficients: FloatArray
    variance: FloatArray
    noise: FloatArray


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
    if not omega.shape[1] or len(eta) < MIN_CURVES * MIN_CURVE_ROWS:
        return None
    # quick, for runs that are no curves may be millions
    if np.sum(~pd.DataFrame(omega).duplicated()) * MIN_CURVE_ROWS > len(eta):
        return None
    fields = field_of(X, omega, eta) if X.shape[1] > 1 else None
    curves = fields or curves_of(X, omega, eta)
    if curves is None:
        return None
    ranges = np.vstack([np.delete(input_ranges, curves.along, axis=0), parameter_ranges])
    components = curves.components
    empty = np.empty((len(curves.others), 0))
    coefficients = components.coefficients
    process = process_through(None, ranges, empty, curves.others, coefficients)
    runs = process.some(empty, curves.others, coefficients)
    matrix = runs.places.alike(runs.places)
    used = used_rows(len(coefficients), MAX_CURVES)
    nugget, shares = process.covariance.nugget, components.size.at(curves.others[used]) ** 2
    shares = shares / np.mean(shares)
    given = condensed(matrix, nugget, runs.residual, shares)
    local = LocalError.of(runs.places.points, given.misses)
    variance = local.at(runs.places.points) ** 2 / given.precision
    mean = coefficients[used] - given.left_out
    left_out = LeftOutRuns(used, mean, variance, nugget * shares)
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
        curves.scatter.is_known,
    )
