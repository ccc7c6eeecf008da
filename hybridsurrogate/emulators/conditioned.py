"""The simulation conditioned on its runs, and runs predicted from all others.

A polynomial may miss the simulation by a curve, which would be blamed on the simulation. One with
more terms than runs is arbitrary between them. So a search takes the
surrogate's terms as the trend of a Gaussian process (`Kriging`), or the process itself where it is
the surrogate. What is still unknown between the runs is part of the covariance of the measured
rows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats
from scipy.linalg import block_diag, cho_factor, cho_solve

from hybridsurrogate.model.statistics import (
    EmulatorPosterior,
    emulator_posterior,
    statistics_of_runs,
)
from hybridsurrogate.numerics.linear_algebra import (
    MAX_DENSE,
    blocks,
    each_with_each,
    factor_by_columns,
)
from hybridsurrogate.simulation.simulator import SimulationData
from hybridsurrogate.surrogates.basis import Basis
from hybridsurrogate.surrogates.emulation.covariance import (
    LocalError,
    Places,
    Process,
    conditioned,
    process_through,
    used_rows,
    weights_of,
)
from hybridsurrogate.surrogates.emulation.curve_emulator import CurveEmulator, emulate_curves
from hybridsurrogate.surrogates.families.kriging import CurveBasis, KrigingBasis
from hybridsurrogate.surrogates.families.stacked import StackedBasis, stacked
from hybridsurrogate.types import FloatArray


class LeftOut(NamedTuple):
    """Outputs, and what an emulator of all other runs predicts for them.

    Attributes
    ----------
    rows : ndarray of shape (n,)
        Which of the runs' rows.
    y, mean, sd : ndarray of shape (n,)
    """

    rows: NDArray[np.intp]
    y: FloatArray
    mean: FloatArray
    sd: FloatArray

    @property
    def q2(self) -> float:
        """1 - sum (y - mean)^2 / sum (y - average)^2: 1 where every run is predicted exactly."""
        total = np.sum((self.y - np.mean(self.y)) ** 2)
        return float(1 - np.sum((self.y - self.mean) ** 2) / total) if total else 1.0

    @property
    def pit(self) -> FloatArray:
        """Where each output lies in its predictive distribution, (n,): uniform if that is right."""
        return np.asarray(stats.norm.cdf(self.y, self.mean, np.maximum(self.sd, 1e-300)))

    def coverage(self, level: float = 0.9) -> float:
        """Return the share of outputs in their central intervals."""
        return float(np.mean(np.abs(self.pit - 0.5) <= level / 2))


def _without(
    points: FloatArray, weights: FloatArray, precision: FloatArray, noise: FloatArray | float
) -> tuple[FloatArray, FloatArray]:
    """Return errors (n,) of runs that are left out, and their variances (n,).

    A run is left out with its repeats, of equal points (n, d). A block of the precision matrix P
    is the inverse of their covariance given the others (Dubrule 1983, Mathematical Geology 15:687):
    noise I + c 11', with c from its diagonal. ``weights`` (n,) are P times the outputs.
    """
    groups = pd.Series(weights).groupby(
        pd.DataFrame(points).groupby([*range(points.shape[1])]).ngroup()
    )
    size, total = groups.transform("size").to_numpy(), groups.transform("sum").to_numpy()
    share = 1 - noise * precision
    c = noise * share / np.maximum(1 - size * share, 1e-6)
    alone = size == 1
    error = np.where(alone, weights / precision, noise * weights + c * total)
    return error, np.where(alone, 1 / precision, noise + c)


def of_process(basis: KrigedBasis, y: FloatArray) -> LeftOut:
    """Return the runs of a process, each given all others but its repeats.

    Parameters
    ----------
    basis : KrigedBasis
        With the error of all its runs.
    y : ndarray of shape (n,)
        Outputs of all runs.
    """
    rows = used_rows(len(y))
    y = y[rows]
    points, nugget = basis.runs.points, basis.nugget
    precision = np.sum(basis.whiten**2, axis=0)
    error, variance = _without(points, basis.weights, precision, nugget)
    return LeftOut(rows, y, y - error, basis.sd * basis.local.at(points) * np.sqrt(variance))


def of_curves(basis: KrigedCurves, X: FloatArray, omega: FloatArray, y: FloatArray) -> LeftOut:
    """Return the rows of runs that are curves, each curve given all others.

    Parameters
    ----------
    basis : KrigedCurves
    X, omega, y : ndarray of shape (n, n_inputs), (n, n_parameters), (n,)
    """
    emulator, left = basis.emulator, basis.emulator.left_out
    position = np.full(len(emulator.components.coefficients), -1)
    position[left.runs] = np.arange(len(left.runs))
    run = position[emulator.run_of(X, omega)]
    # those that the process is conditioned on, if there are more
    used = np.flatnonzero(run >= 0)
    X, y, run = X[used], y[used], run[used]
    mean, curves, missed = emulator.components.at(X[:, emulator.along])
    mean = mean + np.einsum("nk,nk->n", curves, left.coefficients[run])
    scatter = basis.noise(X, omega[used]) ** 2
    # repeats are curves of their own, and the process's noise is that of their mean
    variance = left.variance - left.noise * bool(scatter.any())
    spread = np.maximum(variance, 0.0)[run] * np.sum((curves * emulator.sd) ** 2, axis=1)
    return LeftOut(used, y, mean, np.sqrt(spread + missed**2 + scatter))


@dataclass(frozen=True)
class LinearEmulator:
    """Coefficients given the runs, and the size of what they leave.

    Attributes
    ----------
    basis : Basis
    mean : ndarray of shape (p,)
    covariance : ndarray of shape (p, p)
        Of the coefficients, in units of ``sd`` squared.
    sd : float
        Root mean square of what the polynomial misses in runs that are left out.
    noise : float
        The part of it that is noise of a stochastic simulation.
    left_out : LeftOut
    """

    basis: Basis
    mean: FloatArray
    covariance: FloatArray
    sd: float
    noise: float
    left_out: LeftOut

    def predict(self, X: FloatArray, omega: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard deviation (n,) at rows of inputs and parameters.

        A polynomial that misses the simulation does so between the runs as at them: what it misses
        is part of the error.
        """
        features = self.basis.features(X, omega)
        leverage = np.einsum("np,pq,nq->n", features, self.covariance, features)
        known = self.basis.known(X, omega) + features @ self.mean
        missed = max(self.sd**2 - self.noise**2, 0.0)
        return known, np.sqrt(missed + self.sd**2 * leverage)


def fit_linear(
    basis: Basis, X: FloatArray, omega: FloatArray, y: FloatArray, noise: float = 0.0
) -> LinearEmulator:
    """Return the emulator of a linear basis without hyperparameters.

    Parameters
    ----------
    basis : Basis
    X, omega, y : ndarray of shape (n, n_inputs), (n, n_parameters), (n,)
    noise : float, default=0.0
        Standard deviation by which runs of equal inputs and parameters differ.
    """
    features, target = basis.features(X, omega), y - basis.known(X, omega)
    scale = float(np.std(y))
    mean = emulator_posterior(basis, statistics_of_runs(basis, X, omega, y, scale)).mean
    residual = target - features @ mean
    prior = np.diag(basis.coefficient_sd**-2.0)
    variance = max(float(np.mean(residual**2)), (1e-9 * scale) ** 2, 1e-300)
    covariance = cho_solve(cho_factor(features.T @ features + variance * prior), np.eye(len(mean)))
    leverage = np.einsum("np,pq,nq->n", features, covariance, features)
    precision = np.maximum(1 - leverage, 1e-6)
    left, own = _without(np.hstack([X, omega]), residual, precision, 1.0)
    # of so many terms, or of those that were chosen for these runs, residuals are too small: errors
    # of runs that are left out have the size of others
    sd = float(np.sqrt(np.mean(left**2 / own)))
    left_out = LeftOut(np.arange(len(y)), y, y - left, sd * np.sqrt(own))
    return LinearEmulator(basis, mean, covariance, sd, noise, left_out)


# the rest of a variance when its factor has enough columns, in shares of the median: of a hundredth
# of it evidence of one of 14 searches is 3.8 nats off
_REST_SHARE = 1e-4


@dataclass(frozen=True)
class KrigedBasis(Basis):
    """The most probable simulation given its runs, without free coefficients, and its error.

    Attributes
    ----------
    process : Process
    c : ndarray of shape (p,)
        Coefficients of the trend's terms; p is 0 where the runs have no use for them.
    runs : Places
        The runs.
    weights : ndarray of shape (n_runs,)
        Of the runs.
    whiten : ndarray of shape (m, m)
        Inverse of the lower factor of the covariance of the first m runs in units of the process's
        variance: its error is that given these alone, so that it takes no longer with more.
    sd : float
        Of the process.
    local : LocalError
        Factors on the error where the runs show that it is larger.
    nugget : ndarray of shape (n_runs,)
        Variance of each run's noise in units of the process's.
    """

    process: Process
    c: FloatArray
    runs: Places
    weights: FloatArray
    whiten: FloatArray
    sd: float
    local: LocalError
    nugget: FloatArray

    leaves_open = True

    def open_at(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Return the covariance (m, m) of what is open at runs."""
        factor = self.error(X, omega)
        return factor @ factor.T

    def known(
        self, X: FloatArray, omega: FloatArray, hyper: FloatArray | None = None
    ) -> FloatArray:
        """Return the terms plus the process."""
        return self._terms(X, omega) + self._through_runs(X, omega)

    def output_close_by(
        self, X: FloatArray, omega: FloatArray, c: FloatArray, shape: tuple[int, int, int]
    ) -> FloatArray:
        """Return the terms plus the process, that along its slopes."""
        process, runs = self._alone
        added = process.places(X, omega).weighted(runs, self.weights[:, None], shape)
        return self._terms(X, omega) + added[:, 0]

    def outer_output(self, X: FloatArray, omega: FloatArray, c: FloatArray) -> FloatArray:
        """Return the output of all inputs for all parameters."""
        rows, points = each_with_each(X, omega)
        missed = self._through_runs(rows, points).reshape(len(omega), len(X))
        if len(self.c):
            return self._trend.outer_output(X, omega, self.c) + missed
        return self._trend.known(rows, points).reshape(missed.shape) + missed

    def predict(self, X: FloatArray, omega: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard deviation (n,) of the simulation."""
        pieces = blocks(len(X), len(self.weights))
        sd = np.concatenate([self._left(X[k], omega[k])[3] for k in pieces])
        return self.known(X, omega), sd

    def error(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Return F (n, r): the covariance of what is unknown of the simulation is F F'."""
        places, white, sd, left = self._left(X, omega)
        diagonal = left**2
        # at a steep end of a range variances can be a million times those elsewhere
        typical = float(np.median(diagonal)) if len(diagonal) else 0.0
        least = max(_REST_SHARE * typical, 1e-12 * float(np.max(diagonal, initial=0.0)))

        def columns(k: slice) -> FloatArray:
            return (places.alike(places.of(k)) - white @ white[k].T) * sd[k] * sd[:, None]

        return factor_by_columns(diagonal, columns, least, len(diagonal))

    def _left(
        self, X: FloatArray, omega: FloatArray
    ) -> tuple[Places, FloatArray, FloatArray, FloatArray]:
        """Return places, whitened covariances with the runs, and the sd before and given these."""
        places = self.process.places(X, omega)
        white = places.alike(self.runs.of(slice(len(self.whiten)))) @ self.whiten.T
        sd = self.sd * self.local.at(places.points)
        left = np.maximum(places.variances() - np.sum(white**2, axis=1), 0.0)
        return places, white, sd, sd * np.sqrt(left)

    @property
    def _trend(self) -> Basis:
        assert self.process.trend is not None  # curves have none, and a separate basis
        return self.process.trend

    def _terms(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        return self._trend.output(X, omega, self.c) if len(self.c) else self._trend.known(X, omega)

    @cached_property
    def _alone(self) -> tuple[Process, Places]:
        """The process and the runs without the terms."""
        runs = self.runs._replace(terms=np.empty((len(self.weights), 0)))
        return replace(self.process, term_sd=np.empty(0)), runs

    def _through_runs(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Return what the process adds to the terms."""
        process, runs = self._alone
        pieces = blocks(len(X), len(self.weights))
        return np.concatenate(
            [process.places(X[k], omega[k]).alike(runs) @ self.weights for k in pieces]
        )


@dataclass(frozen=True)
class KrigedCurves(Basis):
    """The most probable simulation given runs that are curves, without coefficients, and its error.

    Attributes
    ----------
    emulator : CurveEmulator
    """

    emulator: CurveEmulator

    leaves_open = True

    def predict(self, X: FloatArray, omega: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard deviation (n,) of the simulation."""
        mean, spread = self.emulator.both(X, omega)
        return mean, np.sqrt(np.sum(spread[:, : 1 + len(self.emulator.sd)] ** 2, axis=1))

    def of_runs(self, X: FloatArray) -> FloatArray:
        """Return the inputs that a run has one value of: without that along which it is a curve."""
        return np.delete(X, self.emulator.along, axis=1)

    def open_at(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Return the covariance (m, m) of what is open at runs, all places of each together."""
        return self.emulator.covariance(np.hstack([X, omega]))

    def between(self, X: FloatArray) -> FloatArray:
        """Return the error of interpolation between simulated places, (n,)."""
        return self.emulator.between(X)

    def scatter(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Return the part (n,) of `error` by which repeated runs differ."""
        usual = np.linalg.norm(self.emulator.realisation(X), axis=1)
        return usual * self.emulator.size(X, omega)

    def unrepeated(self, X: FloatArray) -> FloatArray:
        """Return the part (n,) of `error` by which runs differ from those of near parameters."""
        _, curves, _ = self.emulator.components.at(X[:, self.emulator.along])
        size = np.sqrt(self.emulator.unrepeated)
        return size * np.linalg.norm(curves * self.emulator.sd, axis=1)

    def noise(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Return the standard deviation of repeated runs, (n,)."""
        curves, rest = self.emulator.scatter(X)
        return np.hypot(np.linalg.norm(curves, axis=1), rest) * self.emulator.size(X, omega)

    @property
    def with_features(self) -> CurveBasis:
        """The same with features for its error: a few coefficients."""
        return CurveBasis.of(self.emulator)

    def known(
        self, X: FloatArray, omega: FloatArray, hyper: FloatArray | None = None
    ) -> FloatArray:
        """Return the most probable output."""
        return self.emulator.output(X, omega)

    def outer_output(self, X: FloatArray, omega: FloatArray, c: FloatArray) -> FloatArray:
        """Return the output of all inputs for all parameters."""
        return self.emulator.outer_output(X, omega)

    def output_close_by(
        self, X: FloatArray, omega: FloatArray, c: FloatArray, shape: tuple[int, int, int]
    ) -> FloatArray:
        """Return the most probable output, the process along its slopes."""
        return self.emulator.output_close_by(X, omega, shape)

    def error(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Return F (n, r): the covariance of what is unknown of the simulation is F F'."""
        return self.emulator.error(X, omega)


def krige(
    basis: Basis,
    emulator: EmulatorPosterior,
    simulation: SimulationData,
    run_eta: FloatArray,
    noise: float = 0.0,
) -> tuple[Basis, EmulatorPosterior]:
    """Return the simulation conditioned on its runs, and the posterior of its coefficients.

    Parameters
    ----------
    basis : Basis
        The surrogate's.
    emulator : EmulatorPosterior
        About its coefficients, from the runs.
    simulation : SimulationData
        One output a row.
    run_eta : ndarray of shape (n_rows,)
        Outputs of the runs on the scale of eta.
    noise : float, default=0.0
        Standard deviation of an error of each run, such as rounding: the least that is smoothed.

    Returns
    -------
    KrigedBasis, or KrigedCurves of runs that are curves, and the posterior of no coefficients;
    what was given where that fits all runs. Of several outputs one of each.
    """
    of_inputs, of_parameters = (
        np.array(list(ranges.values()), dtype=float).reshape(-1, 2)
        for ranges in (simulation.input_ranges, simulation.parameter_ranges)
    )
    X, omega = simulation.X, simulation.omega
    if not isinstance(basis, StackedBasis):
        return _kriged(basis, emulator, X, omega, run_eta, of_inputs, of_parameters, noise)
    of_inputs = np.delete(of_inputs, basis.at, axis=0)
    parts: list[tuple[Basis, EmulatorPosterior]] = []
    for k, (one, own) in enumerate(zip(basis.bases, basis.coefficients_of, strict=True)):
        here = X[:, basis.at] == k
        posterior = EmulatorPosterior(emulator.mean[own], emulator.factor[own, own])
        rows = np.delete(X[here], basis.at, axis=1), omega[here], run_eta[here]
        parts.append(_kriged(one, posterior, *rows, of_inputs, of_parameters, noise))
    posterior = EmulatorPosterior(
        np.concatenate([posterior.mean for _, posterior in parts]),
        block_diag(*(posterior.factor for _, posterior in parts)),
    )
    return stacked([one for one, _ in parts], basis.at, basis.names), posterior


def _kriged(
    basis: Basis,
    emulator: EmulatorPosterior,
    X: FloatArray,
    omega: FloatArray,
    run_eta: FloatArray,
    of_inputs: FloatArray,
    of_parameters: FloatArray,
    noise: float,
) -> tuple[Basis, EmulatorPosterior]:
    """Return what `krige` does for one output, from runs and the ranges of what was varied."""
    none = np.empty(0)
    nothing = EmulatorPosterior(none, np.empty((0, 0)))
    if isinstance(basis, CurveBasis):
        return KrigedCurves(none, none, basis.emulator), nothing
    ranges = np.vstack([of_inputs, of_parameters])
    if isinstance(basis, KrigingBasis):
        process = basis.process
        if noise:
            process = process_through(process.trend, ranges, X, omega, run_eta, noise)
    else:
        missed = run_eta - basis.output(X, omega, emulator.mean)
        # exact to rounding; with as many terms as runs that means nothing
        exact = float(np.sqrt(np.mean(missed**2))) < 1e-6 * np.std(run_eta)
        if exact and len(run_eta) > len(basis.coefficient_mean):
            return basis, emulator
        curves = emulate_curves(X, omega, run_eta, of_inputs, of_parameters)
        if curves is not None:
            return KrigedCurves(none, none, curves), nothing
        process = process_through(basis, ranges, X, omega, run_eta, noise)
    return through_runs(process, X, omega, run_eta), nothing


def through_runs(
    process: Process,
    X: FloatArray,
    omega: FloatArray,
    run_eta: FloatArray,
    most_open: int = MAX_DENSE,
    shares: FloatArray | float = 1.0,
) -> KrigedBasis:
    """Return a process with a trend, conditioned on runs of one output.

    Parameters
    ----------
    process : Process
    X, omega, run_eta : ndarray of shape (n, n_inputs), (n, n_parameters), (n,)
    most_open : int, default=1000
        Of more runs the error is that given the first so many alone, which is a little larger.
    shares : ndarray of shape (n,) or float, default=1.0
        Of each run's noise variance, where it is not that of all runs.
    """
    none = np.empty(0)
    runs = process.some(X, omega, run_eta)
    matrix = runs.places.alike(runs.places)
    nuggets = np.broadcast_to(process.covariance.nugget * shares, len(run_eta))
    nugget, first = nuggets[used_rows(len(run_eta))], slice(most_open)
    fitted = conditioned(matrix[first, first], nugget[first], runs.residual[first])
    weights = fitted.weights[:, 0]
    if len(matrix) > len(weights):
        weights = weights_of(matrix, nugget, runs.residual)[:, 0]
    assert process.trend is not None
    prior = process.trend.coefficient_mean
    used = slice(None if len(process.term_sd) or np.any(prior) else 0)
    c = prior[used].copy()
    if len(process.term_sd):
        c += process.term_sd * (runs.places.terms.T @ weights)
    local = LocalError.of(runs.places.of(first).points, fitted.misses)
    sd = float(fitted.sd[0])
    return KrigedBasis(
        none, none, process, c, runs.places, weights, fitted.whiten, sd, local, nugget
    )
