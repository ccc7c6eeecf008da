"""Gaussian process, carried by Legendre polynomials so that it never grows with the runs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from numbers import Integral

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from sklearn.utils import check_scalar

from hybridsurrogate.arguments import as_real, check_choice
from hybridsurrogate.numerics.linear_algebra import NEGLIGIBLE
from hybridsurrogate.priors import check_prior
from hybridsurrogate.surrogates.basis import Basis, Domain, Factors, Surrogate, register
from hybridsurrogate.surrogates.families.polynomial_chaos import legendre, multi_indices
from hybridsurrogate.types import FloatArray, Prior

KERNELS = ("squared-exponential", "matern-5/2", "matern-3/2")

# total degree by number of dimensions: accuracy against a matrix of a few hundred rows
_DEGREE = {1: 30, 2: 10, 3: 7, 4: 5}
# kernels with kinks need more
_ROUGH_DEGREE = {1: 60, 2: 16, 3: 8, 4: 6}
# the polynomials live on a range this much wider, beyond which the process is held constant
_RANGE_MARGIN = 1.15
# share of the prior variance that stands for rounding
_JITTER = 1e-10


class GaussianProcess(Surrogate):
    """Gaussian process in inputs and parameters, one length scale each.

    The kernel is projected on Legendre polynomials, ``k(x, x') = P(x)' C P(x')`` with C from
    Gauss-Legendre quadrature. For a total degree the coefficients' prior covariance is a product of
    one-dimensional ones, and its Cholesky factor the product of theirs, so hyperparameters change a
    small matrix and the statistics of the runs are computed once. A function draw is a vector of
    coefficients: it stays the same function in both steps. A power alpha on the likelihood is a
    noise variance sigma^2 / alpha and a constant, as everywhere in the package.

    Parameters
    ----------
    kernel : {"squared-exponential", "matern-5/2", "matern-3/2"}, default="squared-exponential"
        On inputs and parameters scaled to [-1, 1]; kernels of several dimensions are products.
    length_scale_prior : frozen scipy.stats distribution, default=None
        Of each length scale. None: inverse gamma (5, 5) (arXiv 2412.11875, appendix).
    amplitude_prior : frozen scipy.stats distribution, default=None
        Of the standard deviation of the process. None: half-normal with the spread of the outputs
        as scale (the paper: half-normal(1), for outputs with a spread of one).
    mean : float or None, default=None
        Fixed mean of the process on the scale of eta. None: the mean of the outputs.
    degree : int or None, default=None
        Total degree of the polynomials. None: 30 in one dimension (inputs and parameters
        together), 10 in two, 7 in three, 5 beyond: enough for length scales from 0.5 on in two
        dimensions. Matern kernels get 60, 16, 8, 6: accurate in one dimension; in several they
        are smoothed (in two, at noise of 10 %, predictions differ from the exact process's by a
        fifth of their standard deviation for 5/2 and by half of it for 3/2).

    Notes
    -----
    Inputs farther outside the simulated range than 15 % of its half-width are fixed there: the
    process does not extrapolate further.

    Examples
    --------
    >>> import hybridsurrogate as hs
    >>> from hybridsurrogate.datasets import make_log_sin
    >>> case = make_log_sin(random_state=0)
    >>> model = hs.PowerScaledSurrogate(
    ...     case.simulation, surrogate=hs.GaussianProcess(degree=5), beta=0.5,
    ...     n_draws=200, random_state=0)
    >>> model.fit(case.X, case.y).predict(case.X_in).shape
    (100,)
    """

    def __init__(
        self,
        kernel: str = "squared-exponential",
        length_scale_prior: Prior | None = None,
        amplitude_prior: Prior | None = None,
        mean: float | None = None,
        degree: int | None = None,
    ):
        self.kernel = kernel
        self.length_scale_prior = length_scale_prior
        self.amplitude_prior = amplitude_prior
        self.mean = mean
        self.degree = degree

    def build(self, domain: Domain) -> Basis:
        """Return the basis on a domain."""
        check_choice(self.kernel, "kernel", KERNELS)
        names = (*domain.input_names, *domain.parameter_names)
        degree = self.degree
        if degree is None:
            table = _DEGREE if self.kernel == KERNELS[0] else _ROUGH_DEGREE
            degree = table[min(len(names), max(table))]
        check_scalar(degree, "degree", Integral, min_val=1)
        powers = multi_indices(len(names), int(degree))
        length = stats.invgamma(5, scale=5)
        if self.length_scale_prior is not None:
            length = check_prior(self.length_scale_prior, "length_scale_prior")
        amplitude = stats.halfnorm(scale=domain.scale)
        if self.amplitude_prior is not None:
            amplitude = check_prior(self.amplitude_prior, "amplitude_prior")
        return _ProcessBasis(
            np.zeros(len(powers)),
            np.full(len(powers), domain.scale),
            domain,
            powers,
            self.kernel,
            domain.location if self.mean is None else as_real(self.mean, "mean"),
            {**{f"length_scale_{name}": length for name in names}, "amplitude": amplitude},
        )


@dataclass(frozen=True)
class _ProcessBasis(Basis):
    domain: Domain
    powers: NDArray[np.int_]
    kernel: str
    mean: float
    priors: dict[str, Prior]

    @property
    def hyperpriors(self) -> dict[str, Prior]:
        return self.priors

    def factor(self, hyper: FloatArray, truncated: bool = False) -> FloatArray:
        J, d, m = len(hyper), self.powers.shape[1], int(self.powers.max()) + 1
        ones = [_one_dimensional_factor(self.kernel, hyper[:, k], m - 1) for k in range(d)]
        kept = self.powers
        if truncated:
            # the size of a column is the product of the sizes of its one-dimensional parts
            sizes = [np.sqrt(np.sum(one**2, axis=1)) for one in ones]
            size = np.prod([s[:, kept[:, k]] for k, s in enumerate(sizes)], axis=0)
            kept = kept[(size > NEGLIGIBLE * size[:, :1]).any(axis=0)]
        ones[0] = ones[0] * hyper[:, -1, None, None]
        out = np.ones((1, 1))
        for k, one in enumerate(ones):
            index = (self.powers[:, None, k] * m + kept[None, :, k]).ravel()
            out = out * np.take(one.reshape(J, m * m), index, axis=1)
        return out.reshape(J, len(self.powers), len(kept))

    def known(
        self, X: FloatArray, omega: FloatArray, hyper: FloatArray | None = None
    ) -> FloatArray:
        return np.full(len(X), self.mean)

    def features(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        return self._products(self.domain.scaled(X, omega), np.arange(self.powers.shape[1]))

    def factors(self, X: FloatArray, omega: FloatArray) -> Factors:
        n_inputs = X.shape[1]
        inputs = self.domain.scaled(X, np.tile(self.domain.parameter_ranges[:, 0], (len(X), 1)))
        points = self.domain.scaled(np.tile(X[:1], (len(omega), 1)), omega)
        return Factors(
            np.full(len(X), self.mean),
            self._products(inputs, np.arange(n_inputs)),
            self._products(points, np.arange(n_inputs, self.powers.shape[1])),
        )

    def _products(self, points: FloatArray, dimensions: NDArray[np.int_]) -> FloatArray:
        out = np.ones((len(points), len(self.powers)))
        for k in dimensions:
            inside = np.clip(points[:, k] / _RANGE_MARGIN, -1.0, 1.0)
            out *= legendre(inside, int(self.powers.max())).T[:, self.powers[:, k]]
        return out


def _one_dimensional_factor(kernel: str, length_scale: FloatArray, degree: int) -> FloatArray:
    """Return the Cholesky factor of the kernel projected on Legendre polynomials, (J, m, m).

    ``C_ab = integral P_a(s) k(s, t) P_b(t) ds dt`` over [-1, 1] in both, where one unit of s is
    `_RANGE_MARGIN` scaled units.
    """
    weighted, distance = _quadrature(degree)
    correlation = _correlation(kernel, distance / length_scale[:, None, None])
    projected = weighted @ correlation @ weighted.T
    # the eigenvalues fall below rounding: a jitter of a share of the first keeps the factor real
    projected += _JITTER * np.eye(degree + 1)
    return np.linalg.cholesky(projected)


@lru_cache(maxsize=64)
def _quadrature(degree: int) -> tuple[FloatArray, FloatArray]:
    """Return weighted polynomials at Gauss-Legendre nodes, (m, N), and distances, (N, N)."""
    node, weight = np.polynomial.legendre.leggauss(2 * degree + 10)
    return legendre(node, degree) * weight, _RANGE_MARGIN * np.abs(node[:, None] - node)


def _correlation(kernel: str, distance: FloatArray) -> FloatArray:
    if kernel == "squared-exponential":
        return np.exp(-0.5 * distance**2)
    if kernel == "matern-5/2":
        r = np.sqrt(5) * distance
        return (1 + r + r**2 / 3) * np.exp(-r)
    r = np.sqrt(3) * distance
    return (1 + r) * np.exp(-r)


register("gaussian-process", GaussianProcess())
