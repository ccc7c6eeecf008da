"""Kriging: a Gaussian process through the runs, whose covariance is learned from them once."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_triangular

from hybridsurrogate.numerics.linear_algebra import (
    MAX_DENSE,
    blocks,
    in_turn,
    nudged_cholesky,
    pivoted_cholesky,
)
from hybridsurrogate.simulation.design import draw_design
from hybridsurrogate.surrogates.basis import Basis, Domain, Surrogate, register
from hybridsurrogate.surrogates.emulation.covariance import (
    Places,
    Process,
    conditioned,
    process_through,
)
from hybridsurrogate.surrogates.emulation.curve_emulator import CurveEmulator, emulate_curves
from hybridsurrogate.surrogates.families.polynomial_chaos import PolynomialChaos
from hybridsurrogate.types import FloatArray

# runs, and places between them, on which the features stand: at most so many, fewer where all
# others are as good as known, to these shares of the variance of the outputs
_STANDS, _FEATURES, _REST, _MORE_FEATURES, _MORE_REST = 500, 200, 1e-5, 100, 3e-4


class Kriging(Surrogate):
    """Gaussian process through the runs, on the terms of another surrogate.

    The covariance of outputs is that of the terms plus a Matern 5/2 process over inputs and
    parameters: polynomial-chaos Kriging (Schoebi, Sudret and Wiart 2015, International Journal for
    Uncertainty Quantification 5:171). The share of each, the lengths, and how each axis is
    stretched are estimated from the runs, once and by likelihood. So it follows simulations that a
    polynomial misses, and where a polynomial is right it is one. The terms are dropped where the
    process alone predicts left-out runs better, to a hundredth of the outputs' spread. The
    features are whitened covariances with up to 200 of the runs and 100 places between them. Each
    is chosen where the others leave the largest variance (pivoted Cholesky). This is a linear
    surrogate, trained with any ``beta`` and in both steps like the others.

    Parameters
    ----------
    trend : Surrogate or None, default=None
        Its terms; a linear surrogate without hyperparameters. None: ``PolynomialChaos()``.

    Notes
    -----
    Where runs are curves, with at least five rows along one input for equal parameters, and no
    trend is given, the process is that of the curves' principal components, a function of the
    parameters. So it is where runs are fields, with all pairs of at least five places along each of
    two inputs. It has no terms, which gained nothing in ten simulations. All runs train it, and the
    coefficients describe its remaining error. The measured data then train these, and ``beta``
    sets the weight of the measured data alone.

    `GaussianProcess` infers its length scales together with everything else, which takes many times
    as long from four dimensions on. Here they are fixed at their most likely values. The process
    takes inputs and parameters beyond the runs as those at the ends of the range. The covariance is
    estimated from 500 runs, and features are chosen from 500, drawn at random where there are more.
    All runs train the coefficients. Under likelihoods that are not normal or log-normal hundreds of
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
        if self.trend is None:
            rows = domain.X, domain.omega, domain.eta
            curves = emulate_curves(*rows, domain.input_ranges, domain.parameter_ranges)
            if curves is not None:
                return CurveBasis.of(curves)
        trend = given.build(domain)
        if trend.hyperpriors or trend.is_simulation:
            raise ValueError(needs)
        ranges = np.vstack([domain.input_ranges, domain.parameter_ranges])
        process = process_through(trend, ranges, domain.X, domain.omega, domain.eta)
        runs = process.some(domain.X, domain.omega, domain.eta, _STANDS)
        matrix = runs.places.alike(runs.places)
        sd = conditioned(matrix, process.covariance.nugget, runs.residual).sd[0]
        # outputs that are all the same would leave nothing to learn
        sd = max(float(sd), 1e-6 * domain.scale)
        spread = float(np.var(domain.eta)) / sd**2 if np.ptp(domain.eta) else 1.0
        stands = _stands(process, runs.places, matrix, spread, len(domain.input_ranges))
        lower = nudged_cholesky(stands.alike(stands)[None])[0]
        p = len(lower)
        whiten = solve_triangular(lower, np.eye(p), lower=True).T
        return KrigingBasis(np.zeros(p), np.full(p, sd), process, stands, whiten)


def _stands(
    process: Process, runs: Places, matrix: FloatArray, spread: float, n_inputs: int
) -> Places:
    """Return the places on which features stand, of runs with covariance ``matrix``.

    ``spread`` is the variance of the outputs in units of the process's.

    Features at the runs alone have no variance between them (Quinonero-Candela and Rasmussen 2005,
    Journal of Machine Learning Research 6:1939, section 5): others are added there.
    """
    factor, chosen = pivoted_cholesky(
        np.diagonal(matrix), lambda k: matrix[k], _REST * spread, _FEATURES
    )
    stands = runs.of(chosen)
    points = draw_design(process.ranges.tolist(), MAX_DENSE, random_state=0)
    between_runs = process.places(points[:, :n_inputs], points[:, n_inputs:])
    white = solve_triangular(factor[chosen], stands.alike(between_runs), lower=True).T
    left = np.maximum(between_runs.variances() - np.sum(white**2, axis=1), 0.0)

    def column(k: int) -> FloatArray:
        return between_runs.alike(between_runs.of(slice(k, k + 1)))[:, 0] - white @ white[k]

    _, more = pivoted_cholesky(left, column, _MORE_REST * spread, _MORE_FEATURES)
    return stands.joined(between_runs.of(more))


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

    def output_in_turn(self, X: FloatArray, omega: FloatArray, c: FloatArray) -> FloatArray:
        """Return the output for J draws, from the weights of the places."""
        n, weights = len(X) // len(c), c @ self.whiten.T
        added = np.empty(len(X))
        for some in blocks(len(c), n * (1 + self.stands.terms.shape[1])):
            rows = slice(some.start * n, some.stop * n)
            places = self.process.places(X[rows], omega[rows])
            added[rows] = places.weighted_in_turn(self.stands, weights[some])
        return self.known(X, omega) + added

    def along(self, directions: FloatArray) -> KrigingBasis:
        """Return the basis with features along directions (p, r) of the coefficients."""
        r = directions.shape[1]
        whiten = self.whiten @ directions
        return replace(self, coefficient_mean=np.zeros(r), coefficient_sd=np.ones(r), whiten=whiten)


@dataclass(frozen=True)
class CurveBasis(Basis):
    """The most probable curves given the runs, and features for their error.

    Attributes
    ----------
    emulator : CurveEmulator
    """

    emulator: CurveEmulator
    holds_runs = True

    @classmethod
    def of(cls, emulator: CurveEmulator) -> CurveBasis:
        """Return the basis of an emulator: each feature has a standard normal coefficient."""
        p = emulator.n_spread
        return cls(np.zeros(p), np.ones(p), emulator)

    def known(
        self, X: FloatArray, omega: FloatArray, hyper: FloatArray | None = None
    ) -> FloatArray:
        """Return the most probable output."""
        return self.emulator.output(X, omega)

    def features(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Return the standard deviations of the error, each along its component."""
        return self.emulator.spread(X, omega)

    def known_and_features(
        self, X: FloatArray, omega: FloatArray, hyper: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Return both from the same covariances."""
        return self.emulator.both(X, omega)

    def outer(self, X: FloatArray, omega: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return both of all inputs for all parameters."""
        return self.emulator.outer_both(X, omega)

    def outer_output(self, X: FloatArray, omega: FloatArray, c: FloatArray) -> FloatArray:
        """Return the output of all inputs for all parameters, of one draw or one for each."""
        known, features = self.outer(X, omega)
        return known + np.einsum("jnp,p->jn" if c.ndim == 1 else "jnp,jp->jn", features, c)

    def output_in_turn(self, X: FloatArray, omega: FloatArray, c: FloatArray) -> FloatArray:
        """Return the output (n,) for J draws of c (J, p), the first for the first n / J rows."""
        known, features = self.emulator.both(X, omega)
        return known + in_turn(features, c)


register("kriging", Kriging())
