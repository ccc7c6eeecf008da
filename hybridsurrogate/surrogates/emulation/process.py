"""The process of kriging: a covariance estimated from the runs, and predictions given them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, solve_triangular

from hybridsurrogate.numerics.blocks import in_turn
from hybridsurrogate.numerics.cholesky import nudged_cholesky
from hybridsurrogate.surrogates.basis import Basis
from hybridsurrogate.surrogates.emulation.covariance import (
    Apart,
    Covariance,
    alike,
    bent,
    between,
    learned,
    weighted,
    weighted_in_turn,
)
from hybridsurrogate.types import FloatArray

# the covariance is learned from at most so many runs, drawn at random, as files of runs are often
# in order (of runs that are curves fewer: each is as much as hundreds of rows), and the process is
# conditioned on at most so many
_LEARN, _LEARN_CURVES, MOST_RUNS, _CURVES = 500, 200, 5000, 2000


class Places(NamedTuple):
    """Points as a process sees them.

    Attributes
    ----------
    halves : Apart
        Of squared distances in lengths.
    terms : ndarray of shape (n, p)
        Times their sd; p is 0 where the runs have no use for them.
    """

    halves: Apart
    terms: FloatArray

    def alike(self, others: Places) -> FloatArray:
        """Return covariances (n, m) in units of the process's variance."""
        out = alike(self.halves, others.halves)
        if self.terms.shape[1]:
            out += self.terms @ others.terms.T
        return out

    def weighted_in_turn(self, others: Places, weights: FloatArray) -> FloatArray:
        """Return sums (n,) of covariances times weights (J, m), the first for the first n / J."""
        out = weighted_in_turn(self.halves, others.halves, weights)
        if self.terms.shape[1]:
            out += in_turn(self.terms, weights @ others.terms)
        return out

    def weighted(
        self, others: Places, weights: FloatArray, shape: tuple[int, int, int]
    ) -> FloatArray:
        """Return sums of covariances times weights (m, k), shape (n, k), terms left out.

        Rows are of ``shape``: nodes, short moves of which the first is none, and measured rows.
        Along the moves these sums follow their slopes.
        """
        points = self.points.reshape(*shape, -1)
        first = np.arange(len(self.terms)).reshape(shape)[:, 0].ravel()
        value, slopes = weighted(self.of(first).halves, others.halves, weights)
        nodes, _, n = shape
        moved = points - points[:, :1]
        along = np.einsum("tmnd,tnkd->tmnk", moved, slopes.reshape(nodes, n, *slopes.shape[1:]))
        return (value.reshape(nodes, 1, n, -1) + along).reshape(len(self.terms), -1)

    @property
    def points(self) -> FloatArray:
        """Stretched inputs and parameters in lengths of the process, (n, d)."""
        return self.halves.right[:, :-2]

    def variances(self) -> FloatArray:
        """Return variances (n,)."""
        return 1 + np.sum(self.terms**2, axis=1)

    def of(self, chosen: NDArray[np.intp] | slice) -> Places:
        """Return some of the points."""
        left, right = self.halves
        return Places(Apart(left[chosen], right[chosen]), self.terms[chosen])

    def joined(self, others: Places) -> Places:
        """Return both."""
        halves = (np.concatenate(pair) for pair in zip(self.halves, others.halves, strict=True))
        return Places(Apart(*halves), np.concatenate([self.terms, others.terms]))


class Runs(NamedTuple):
    """Runs that a process is conditioned on: their places, and outputs less their prior mean.

    Of shapes (n, ...) and (n, k).
    """

    places: Places
    residual: FloatArray


@dataclass(frozen=True)
class Process:
    """Covariance of a simulation's outputs at inputs and parameters.

    Attributes
    ----------
    trend : Basis or None
    ranges : ndarray of shape (n_inputs + n_parameters, 2)
        Of the runs.
    covariance : Covariance
    term_sd : ndarray of shape (p,)
        Prior sd of the trend's coefficients in units of the process's; p is 0 where the runs have
        no use for its terms.
    """

    trend: Basis | None
    ranges: FloatArray
    covariance: Covariance
    term_sd: FloatArray

    def places(self, X: FloatArray, omega: FloatArray) -> Places:
        """Return rows of inputs and parameters as the process sees them."""
        points = bent(between(np.hstack([X, omega]), self.ranges), self.covariance.bends)
        terms = np.empty((len(X), 0))
        if self.trend is not None and len(self.term_sd):
            terms = self.trend.features(X, omega) * self.term_sd
        return Places(Apart.of(points / self.covariance.lengths), terms)

    def prior_mean(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Return the trend at its prior mean, (n,)."""
        if self.trend is None:
            return np.zeros(len(X))
        known = self.trend.known(X, omega)
        if np.any(self.trend.coefficient_mean):
            known = known + self.trend.features(X, omega) @ self.trend.coefficient_mean
        return known

    def some(
        self, X: FloatArray, omega: FloatArray, eta: FloatArray, most: int = MOST_RUNS
    ) -> Runs:
        """Return the runs that are used, of runs with outputs eta (n,) or (n, k)."""
        chosen = used_rows(len(eta), most if eta.ndim == 1 else _CURVES)
        X, omega = X[chosen], omega[chosen]
        outputs = eta[chosen].reshape(len(chosen), -1)
        return Runs(self.places(X, omega), outputs - self.prior_mean(X, omega)[:, None])


def used_rows(n: int, most: int = MOST_RUNS) -> NDArray[np.intp]:
    """Return the rows of n runs that are used, at random."""
    return np.random.default_rng(0).permutation(n)[:most]


def process_through(
    trend: Basis | None,
    ranges: FloatArray,
    X: FloatArray,
    omega: FloatArray,
    eta: FloatArray,
    noise: float = 0.0,
) -> Process:
    """Return the most likely covariance of outputs.

    Parameters
    ----------
    trend : Basis or None
        Without hyperparameters; None: nothing but the process.
    ranges : ndarray of shape (n_inputs + n_parameters, 2)
        Of the runs.
    X, omega, eta : ndarray of shape (n, n_inputs), (n, n_parameters), (n,)
        Runs; of outputs (n, k) the covariance that they share but for its size.
    noise : float, default=0.0
        Least standard deviation of what differs from run to run, such as rounding.
    """
    chosen = used_rows(len(eta), _LEARN if eta.ndim == 1 else _LEARN_CURVES)
    X, omega = X[chosen], omega[chosen]
    mean, terms = np.zeros(len(X)), np.empty((len(X), 0))
    if trend is not None:
        features = trend.features(X, omega)
        mean = trend.known(X, omega) + features @ trend.coefficient_mean
        terms = features * trend.coefficient_sd
    residual = eta[chosen].reshape(len(chosen), -1) - mean[:, None]
    arrays = between(np.hstack([X, omega]), ranges), terms, residual
    least = noise**2 / max(float(np.var(residual)), np.finfo(float).tiny) if noise else 0.0
    covariance = _learned(*(array.tobytes() for array in arrays), len(chosen), least)
    if trend is None:
        return Process(None, ranges, covariance, np.empty(0))
    size = float(np.mean(np.sum(terms**2, axis=1)))
    used = slice(None if covariance.share else 0)
    term_sd = np.sqrt(covariance.share / max(size, 1e-300)) * trend.coefficient_sd[used]
    return Process(trend, ranges, covariance, term_sd)


@lru_cache(maxsize=8)
def _learned(points: bytes, terms: bytes, residual: bytes, n: int, least: float) -> Covariance:
    """Return `learned`: folds and grids over beta ask for the same runs again and again."""
    arrays = (np.frombuffer(array).reshape(n, -1) for array in (points, terms, residual))
    places, features, outputs = arrays
    return learned(places, features, outputs, least)


class Conditioned(NamedTuple):
    """A process given its runs.

    Attributes
    ----------
    weights : ndarray of shape (n, k)
        Of the runs, for each output.
    whiten : ndarray of shape (n, n)
        Inverse of the lower factor of their covariance in units of the process's variance.
    sd : ndarray of shape (k,)
        Of the process.
    misses : ndarray of shape (n,)
        Squared leave-one-out errors of the runs, in units of their variance; of several outputs
        the sums of both.
    """

    weights: FloatArray
    whiten: FloatArray
    sd: FloatArray
    misses: FloatArray


def conditioned(matrix: FloatArray, nugget: float, residual: FloatArray) -> Conditioned:
    """Return a process given runs with covariance (n, n) and outputs (n, k) less their mean."""
    n = len(residual)
    lower = nudged_cholesky((matrix + nugget * np.eye(n))[None])[0]
    whiten: FloatArray = solve_triangular(lower, np.eye(n), lower=True)
    weights = whiten.T @ (whiten @ residual)
    # leave-one-out errors in units of their sd (Rasmussen and Williams 5.12): 1 on average where
    # the covariance is right
    deviation = weights**2 / np.sum(whiten**2, axis=0)[:, None]
    variance = np.maximum(np.sum(residual * weights, axis=0), np.sum(deviation, axis=0)) / n
    # outputs that are all the same vary by nothing
    misses = np.sum(deviation, axis=1) / max(float(np.sum(variance)), 1e-300)
    return Conditioned(weights, whiten, np.sqrt(variance), misses)


def weights_of(matrix: FloatArray, nugget: float, residual: FloatArray) -> FloatArray:
    """Return the weights (n, k) of `conditioned` alone: a third of its time."""
    lower = nudged_cholesky((matrix + nugget * np.eye(len(residual)))[None])[0]
    return np.asarray(cho_solve((lower, True), residual))
