"""Polynomial chaos: orthonormal Legendre polynomials up to a total degree."""

from __future__ import annotations

from dataclasses import dataclass
from math import comb
from numbers import Integral

import numpy as np
from numpy.typing import NDArray
from sklearn.utils import check_scalar

from hybridsurrogate.priors import check_prior
from hybridsurrogate.surrogates.basis import Basis, Domain, Factors, Surrogate, register
from hybridsurrogate.types import FloatArray, Prior

# scale-aware default: five times the spread of the outputs, as N(0, 5) is for the published
# case studies, whose outputs have a spread of about one
RELATIVE_SD = 5.0
# a fit holds several matrices of terms x terms: of 10,000 terms each has 0.8 GB
_MAX_TERMS = 10_000
# of the powers of a sparse expansion: products of many inputs need a low degree in each
_SPARSITY_NORM = 0.75


class PolynomialChaos(Surrogate):
    """Polynomial chaos expansion of a total degree in inputs and parameters.

    The polynomials are orthonormal on [-1, 1] with respect to dx (phi_0 = 1 / sqrt 2), products of
    them span the terms, and the intercept multiplies 1: the conventions of Reiser, Buerkner and
    Guthke (arXiv 2412.11875, section 3). Inputs and parameters are scaled to [-1, 1] from their
    simulated ranges; parameters beyond these are fixed at the ends, where the runs stop.

    Parameters
    ----------
    degree : int, default=3
        Total degree.
    coefficient_prior : frozen scipy.stats distribution or None, default=None
        Prior of each coefficient; its mean and standard deviation are used, as a Gaussian.
        None: mean zero and five standard deviations of the output as sd; the mean of the output
        is then added as a fixed mean, so the intercept is the difference from it.
    sparse : bool, default=False
        Keep the terms that predict the runs best. Candidates have sum(powers^0.75) up to
        degree^0.75, in the order of least-angle regression. As many are kept as have the least
        leave-one-out error (Blatman and Sudret 2011, Journal of Computational Physics 230:2345).
        For many inputs and higher degrees, of which few terms matter.

    Examples
    --------
    >>> from scipy.stats import norm
    >>> import hybridsurrogate as hs
    >>> hs.PolynomialChaos(degree=5, coefficient_prior=norm(0, 5)).degree
    5
    """

    def __init__(
        self, degree: int = 3, coefficient_prior: Prior | None = None, sparse: bool = False
    ):
        self.degree = degree
        self.coefficient_prior = coefficient_prior
        self.sparse = sparse

    def build(self, domain: Domain) -> Basis:
        """Return the basis on a domain."""
        check_scalar(self.degree, "degree", Integral, min_val=1)
        ranges = np.vstack([domain.input_ranges, domain.parameter_ranges])
        if not isinstance(self.sparse, bool | np.bool_):
            raise TypeError(f"sparse must be True or False, got {self.sparse!r}.")
        n_terms = comb(len(ranges) + int(self.degree), len(ranges))
        # of a sparse one most are never looked at
        if n_terms > _MAX_TERMS * (50 if self.sparse else 1):
            raise ValueError(
                f"PolynomialChaos(degree={self.degree}) has {n_terms:.3g} terms in {len(ranges)} "
                f"dimensions, more than the {_MAX_TERMS} for which there is memory: choose a "
                "lower degree, sparse=True, or Kriging()."
            )
        powers = multi_indices(len(ranges), int(self.degree))
        if self.sparse:
            powers = _few_terms(powers, int(self.degree), domain, ranges)
        if self.coefficient_prior is None:
            mean = np.zeros(len(powers))
            sd = np.full(len(powers), RELATIVE_SD * domain.scale)
            # not as the intercept's prior mean: a large offset would cost the digits of the rest
            location = domain.location
        else:
            prior = check_prior(self.coefficient_prior, "coefficient_prior")
            mean = np.full(len(powers), float(prior.mean()))
            sd = np.full(len(powers), float(prior.std()))
            location = 0.0
        return _ChaosBasis(mean, sd, ranges, len(domain.input_ranges), powers, location)


def _few_terms(
    powers: NDArray[np.int_], degree: int, domain: Domain, ranges: FloatArray
) -> NDArray[np.int_]:
    """Return the powers (k, d) of the terms that predict the rows best, the intercept first."""
    # scikit-learn's linear models take a tenth of a second to import
    from sklearn.linear_model import lars_path

    kept = np.sum(powers**_SPARSITY_NORM, axis=1) <= degree**_SPARSITY_NORM + 1e-9
    powers = powers[kept]
    n_inputs = len(domain.input_ranges)
    none = np.zeros(len(powers))
    basis = _ChaosBasis(none, none, ranges, n_inputs, powers, domain.location)
    terms = basis.features(domain.X, domain.omega)[:, 1:]
    y = domain.eta - domain.eta.mean()
    centred = terms - terms.mean(axis=0)
    size = np.maximum(np.linalg.norm(centred, axis=0), 1e-300)
    most = max(min(len(y) // 2, terms.shape[1]), 1)
    _, order, _ = lars_path(centred / size, y, method="lar", max_iter=most)
    chosen = np.asarray(order, dtype=int)[: _least_left_out(terms[:, order], domain.eta)]
    return powers[[0, *sorted(1 + chosen)]]


def _least_left_out(terms: FloatArray, y: FloatArray) -> int:
    """Return how many of the first terms (n, p), with an intercept, predict left-out rows best.

    The leave-one-out error of least squares is in closed form, e / (1 - h), and enlarged by
    n / (n - k) (1 + tr((F'F)^-1)) for k terms, as few rows make it too small (Chapelle, Vapnik and
    Bengio 2002, Machine Learning 48:9).
    """
    n, p = terms.shape
    # terms of unit mean square, for which the trace is meant
    terms = terms / np.maximum(np.sqrt(np.mean(terms**2, axis=0)), 1e-300)
    design = np.column_stack([np.ones(n), terms])
    Q, R = np.linalg.qr(design)
    fitted, leverage = np.zeros(n), np.zeros(n)
    inverse = np.linalg.inv(R + 1e-12 * np.abs(R).max() * np.eye(p + 1))
    errors = np.full(p + 1, np.inf)
    for k in range(min(p + 1, n - 1)):
        fitted += Q[:, k] * (Q[:, k] @ y)
        leverage += Q[:, k] ** 2
        left_out = (y - fitted) / np.maximum(1 - leverage, 1e-9)
        trace = float(np.sum(inverse[: k + 1, : k + 1] ** 2))
        errors[k] = np.mean(left_out**2) * n / (n - k - 1) * (1 + trace)
    return int(np.argmin(errors))


@dataclass(frozen=True)
class _ChaosBasis(Basis):
    ranges: FloatArray
    n_inputs: int
    powers: NDArray[np.int_]
    location: float

    def known(
        self, X: FloatArray, omega: FloatArray, hyper: FloatArray | None = None
    ) -> FloatArray:
        return np.full(len(X), self.location)

    def features(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        _, of_inputs, of_parameters = self.factors(X, omega)
        return of_inputs * of_parameters

    def output(self, X: FloatArray, omega: FloatArray, c: FloatArray) -> FloatArray:
        # terms that share their polynomials of the inputs, or of the parameters, are added up first
        inputs, row = np.unique(self.powers[:, : self.n_inputs], axis=0, return_inverse=True)
        parameters, column = np.unique(self.powers[:, self.n_inputs :], axis=0, return_inverse=True)
        table = np.zeros((len(inputs), len(parameters)))
        table[row.ravel()[1:], column.ravel()[1:]] = c[1:]
        of_inputs = _products(X, self.ranges[: self.n_inputs], inputs)
        ranges = self.ranges[self.n_inputs :]
        of_parameters = _products(np.clip(omega, *ranges.T), ranges, parameters)
        interaction = np.einsum("nk,nk->n", of_inputs @ table, of_parameters)
        return interaction + c[0] + self.location

    def factors(self, X: FloatArray, omega: FloatArray) -> Factors:
        n, ranges = self.n_inputs, self.ranges[self.n_inputs :]
        of_inputs = _products(X, self.ranges[:n], self.powers[:, :n])
        of_parameters = _products(np.clip(omega, *ranges.T), ranges, self.powers[:, n:])
        # the intercept multiplies 1, not the product of the phi_0
        of_inputs[:, 0] = of_parameters[:, 0] = 1.0
        return Factors(np.full(len(X), self.location), of_inputs, of_parameters)


def _products(points: FloatArray, ranges: FloatArray, powers: NDArray[np.int_]) -> FloatArray:
    """Return the products of one-dimensional polynomials, (n, p)."""
    out = np.ones((len(points), len(powers)))
    for k, (low, high) in enumerate(ranges):
        scaled = (2 * points[:, k] - low - high) / (high - low)
        out *= legendre(scaled, powers[:, k].max(initial=0)).T[:, powers[:, k]]
    return out


def multi_indices(n_dimensions: int, degree: int) -> NDArray[np.int_]:
    """Return all exponents of total degree up to ``degree``, lexicographic, the intercept first.

    Examples
    --------
    >>> multi_indices(2, 1).tolist()
    [[0, 0], [0, 1], [1, 0]]
    """
    powers, left = np.zeros((1, 0), dtype=int), np.array([degree])
    for _ in range(n_dimensions):
        # each row is followed by all exponents that its total degree leaves
        counts = left + 1
        new = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        powers = np.column_stack([np.repeat(powers, counts, axis=0), new])
        left = np.repeat(left, counts) - new
    return powers


def legendre(x: FloatArray, degree: int) -> FloatArray:
    """Return the Legendre polynomials orthonormal on [-1, 1], shape (degree + 1, n).

    By the three-term recurrence (k + 1) P_{k+1} = (2 k + 1) x P_k - k P_{k-1}.
    """
    out = np.empty((degree + 1, len(x)))
    out[0] = 1.0
    if degree:
        out[1] = x
    for k in range(1, degree):
        out[k + 1] = ((2 * k + 1) * x * out[k] - k * out[k - 1]) / (k + 1)
    return out * np.sqrt(np.arange(degree + 1) + 0.5)[:, None]


register("polynomial-chaos", PolynomialChaos())
