"""Kriging: a Gaussian process through the runs, whose covariance is learned from them once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from hybridsurrogate.cholesky import nudged_cholesky, pivoted_cholesky
from hybridsurrogate.design import draw_design
from hybridsurrogate.priors import FloatArray
from hybridsurrogate.surrogates.base import Basis, Domain, Surrogate
from hybridsurrogate.surrogates.covariance import (
    Apart,
    Covariance,
    alike,
    bent,
    between,
    learned,
)
from hybridsurrogate.surrogates.polynomial_chaos import PolynomialChaos

# the covariance is learned from at most this many runs; as many as the second limit are used,
# drawn at random, as files of runs are often in order
_LEARN, _RUNS = 200, 500
# runs, and places between them, on which the features stand: at most so many, fewer where all
# others are as good as known, to these shares of the variance of the outputs
_RUN_FEATURES, _RUNS_KNOWN, _MORE_FEATURES, _KNOWN = 200, 1e-5, 100, 3e-4
_CANDIDATES = 1024


class Kriging(Surrogate):
    """Gaussian process through the runs, on the terms of another surrogate.

    Outputs are as alike as the terms make them, plus a Matern 5/2 process over inputs and
    parameters: polynomial-chaos Kriging (Schoebi, Sudret and Wiart 2015, International Journal for
    Uncertainty Quantification 5:171). How much of each, the lengths, and how each axis is stretched
    are learned from the runs, once and by likelihood; so it follows simulations that a polynomial
    misses, and where a polynomial is right it is one. Its features are the covariances with up to
    200 of the runs and 100 places between them, each chosen where the others tell least (pivoted
    Cholesky), whitened: a linear surrogate, trained with any ``beta`` and in both steps like the
    others.

    Parameters
    ----------
    trend : Surrogate or None, default=None
        Its terms; a linear surrogate without hyperparameters. None: ``PolynomialChaos()``.

    Notes
    -----
    `GaussianProcess` infers its length scales together with everything else, which takes many times
    as long from four dimensions on. Here they are held at their most likely values.
    Inputs and parameters beyond the runs are held at the ends, for the process. The covariance is
    learned from 200 runs and features stand on some of 500, drawn at random where there are more;
    all runs train the coefficients. Under likelihoods that are not normal or log-normal hundreds of
    features take minutes to fit: a polynomial has fewer.

    Raises
    ------
    TypeError, ValueError
        When an estimator is fitted: for a trend that is no surrogate, or not linear.

    Examples
    --------
    >>> import hybridsurrogate as hs
    >>> from hybridsurrogate.datasets import make_log_sin
    >>> case = make_log_sin(random_state=0)
    >>> model = hs.PowerScaledSurrogate(case.simulation, surrogate=hs.Kriging(), random_state=0)
    >>> model.fit(case.X, case.y).predict(case.X_in).shape
    (100,)
    """

    def __init__(self, trend: Surrogate | None = None):
        self.trend = trend

    def build(self, domain: Domain) -> Basis:
        """Return the basis on a domain; raise ValueError for a trend that is not linear."""
        given = PolynomialChaos() if self.trend is None else self.trend
        needs = (
            "Kriging needs a trend that is linear in its coefficients and has no other unknowns, "
            f"such as PolynomialChaos(), got {given!r}."
        )
        if not isinstance(given, Surrogate):
            raise TypeError(needs)
        trend = given.build(domain)
        if trend.hyperpriors or trend.is_simulation:
            raise ValueError(needs)
        ranges = np.vstack([domain.input_ranges, domain.parameter_ranges])
        process = process_through(trend, ranges, domain.X, domain.omega, domain.eta)
        runs = process.some(domain.X, domain.omega, domain.eta)
        matrix = runs.places.among_themselves()
        sd = conditioned(matrix, process.covariance.nugget, runs.residual).sd
        # outputs that are all the same would leave nothing to learn
        sd = max(sd, 1e-6 * domain.scale)
        spread = float(np.var(domain.eta)) / sd**2
        stands = _stands(process, runs.places, matrix, spread, len(domain.input_ranges))
        lower = nudged_cholesky(stands.among_themselves()[None])[0]
        p = len(lower)
        whiten = solve_triangular(lower, np.eye(p), lower=True).T
        return KrigingBasis(np.zeros(p), np.full(p, sd), process, stands, whiten)


def _stands(
    process: Process, runs: Places, matrix: FloatArray, spread: float, n_inputs: int
) -> Places:
    """Return the places on which features stand, of runs with covariance ``matrix``.

    ``spread`` is the variance of the outputs in units of the process's.

    Features that stand on the runs alone know no variance between them (Quinonero-Candela and
    Rasmussen 2005, Journal of Machine Learning Research 6:1939, section 5): others are added there.
    """
    factor, chosen = pivoted_cholesky(
        np.diagonal(matrix), lambda k: matrix[k], _RUNS_KNOWN * spread, _RUN_FEATURES
    )
    stands = runs.of(chosen)
    points = draw_design(process.ranges.tolist(), _CANDIDATES, random_state=0)
    between_runs = process.places(points[:, :n_inputs], points[:, n_inputs:])
    white = solve_triangular(factor[chosen], stands.alike(between_runs), lower=True).T
    left = np.maximum(between_runs.variances() - np.sum(white**2, axis=1), 0.0)

    def column(k: int) -> FloatArray:
        one = between_runs.of(np.array([k]))
        return between_runs.alike(one)[:, 0] - white @ white[k]

    _, more = pivoted_cholesky(left, column, _KNOWN * spread, _MORE_FEATURES)
    return stands.beside(between_runs.of(more))


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
        return alike(self.halves.squares(others.halves.right)) + self.terms @ others.terms.T

    def among_themselves(self) -> FloatArray:
        """Return covariances (n, n)."""
        return self.alike(self)

    def variances(self) -> FloatArray:
        """Return variances (n,)."""
        return 1 + np.sum(self.terms**2, axis=1)

    def of(self, chosen: NDArray[np.intp]) -> Places:
        """Return some of the points."""
        left, right = self.halves
        return Places(Apart(left[chosen], right[chosen]), self.terms[chosen])

    def beside(self, others: Places) -> Places:
        """Return both."""
        halves = (np.concatenate(pair) for pair in zip(self.halves, others.halves, strict=True))
        return Places(Apart(*halves), np.concatenate([self.terms, others.terms]))


class Runs(NamedTuple):
    """Runs that a process is conditioned on: their places, and outputs less their prior mean."""

    places: Places
    residual: FloatArray


@dataclass(frozen=True)
class Process:
    """Covariance of a simulation's outputs at inputs and parameters.

    Attributes
    ----------
    trend : Basis
    ranges : ndarray of shape (n_inputs + n_parameters, 2)
        Of the runs.
    covariance : Covariance
    term_sd : ndarray of shape (p,)
        Prior sd of the trend's coefficients in units of the process's; p is 0 where the runs have
        no use for its terms.
    """

    trend: Basis
    ranges: FloatArray
    covariance: Covariance
    term_sd: FloatArray

    def places(self, X: FloatArray, omega: FloatArray) -> Places:
        """Return rows of inputs and parameters as the process sees them."""
        points = bent(between(np.hstack([X, omega]), self.ranges), self.covariance.bends)
        terms = np.empty((len(X), 0))
        if len(self.term_sd):
            terms = self.trend.features(X, omega) * self.term_sd
        return Places(Apart.of(points / self.covariance.lengths), terms)

    def prior_mean(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Return the trend at its prior mean, (n,)."""
        known = self.trend.known(X, omega)
        if np.any(self.trend.coefficient_mean):
            known = known + self.trend.features(X, omega) @ self.trend.coefficient_mean
        return known

    def some(self, X: FloatArray, omega: FloatArray, eta: FloatArray) -> Runs:
        """Return the runs that are used, of runs with outputs eta (n,)."""
        chosen = _used(len(eta))
        X, omega = X[chosen], omega[chosen]
        return Runs(self.places(X, omega), eta[chosen] - self.prior_mean(X, omega))


def _used(n: int) -> NDArray[np.intp]:
    return np.random.default_rng(0).permutation(n)[:_RUNS]


def process_through(
    trend: Basis, ranges: FloatArray, X: FloatArray, omega: FloatArray, eta: FloatArray
) -> Process:
    """Return the most likely covariance of outputs.

    Parameters
    ----------
    trend : Basis
        Without hyperparameters.
    ranges : ndarray of shape (n_inputs + n_parameters, 2)
        Of the runs.
    X, omega, eta : ndarray of shape (n, n_inputs), (n, n_parameters), (n,)
        Runs.
    """
    chosen = _used(len(eta))[:_LEARN]
    X, omega = X[chosen], omega[chosen]
    features = trend.features(X, omega)
    residual = eta[chosen] - trend.known(X, omega) - features @ trend.coefficient_mean
    terms = features * trend.coefficient_sd
    arrays = between(np.hstack([X, omega]), ranges), terms, residual
    covariance = _learned(*(array.tobytes() for array in arrays), len(chosen))
    size = float(np.mean(np.sum(terms**2, axis=1)))
    used = slice(None if covariance.share else 0)
    term_sd = np.sqrt(covariance.share / max(size, 1e-300)) * trend.coefficient_sd[used]
    return Process(trend, ranges, covariance, term_sd)


@lru_cache(maxsize=8)
def _learned(points: bytes, terms: bytes, residual: bytes, n: int) -> Covariance:
    """Return `learned`: folds and grids over beta ask for the same runs again and again."""
    arrays = (np.frombuffer(array).reshape(n, -1) for array in (points, terms, residual))
    places, features, outputs = arrays
    return learned(places, features, outputs[:, 0])


class Conditioned(NamedTuple):
    """A process given its runs.

    Attributes
    ----------
    weights : ndarray of shape (n,)
        Of the runs.
    whiten : ndarray of shape (n, n)
        Inverse of the lower factor of their covariance in units of the process's variance.
    sd : float
        Of the process.
    """

    weights: FloatArray
    whiten: FloatArray
    sd: float


def conditioned(matrix: FloatArray, nugget: float, residual: FloatArray) -> Conditioned:
    """Return a process given runs with covariance (n, n) and outputs (n,) less their mean."""
    n = len(residual)
    lower = nudged_cholesky((matrix + nugget * np.eye(n))[None])[0]
    whiten: FloatArray = solve_triangular(lower, np.eye(n), lower=True)
    weights = whiten.T @ (whiten @ residual)
    # leave-one-out errors in units of their sd (Rasmussen and Williams 5.12): 1 on average where
    # the covariance is right
    deviation = weights**2 / np.sum(whiten**2, axis=0)
    variance = max(float(residual @ weights), float(np.sum(deviation))) / n
    return Conditioned(weights, whiten, float(np.sqrt(variance)))


@dataclass(frozen=True)
class KrigingBasis(Basis):
    """Covariances with some of the runs and with places between them, whitened.

    Attributes
    ----------
    process : Process
    stands : Places
        What the features stand on.
    whiten : ndarray of shape (n_stands, p)
    """

    process: Process
    stands: Places
    whiten: FloatArray

    def known(
        self, X: FloatArray, omega: FloatArray, hyper: FloatArray | None = None
    ) -> FloatArray:
        """Return the trend at its prior mean."""
        return self.process.prior_mean(X, omega)

    def features(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Return the whitened covariances, (n, p)."""
        return self.process.places(X, omega).alike(self.stands) @ self.whiten

    def along(self, directions: FloatArray) -> KrigingBasis:
        """Return the basis with features along directions (p, r) of the coefficients."""
        r = directions.shape[1]
        whiten = self.whiten @ directions
        return replace(self, coefficient_mean=np.zeros(r), coefficient_sd=np.ones(r), whiten=whiten)
