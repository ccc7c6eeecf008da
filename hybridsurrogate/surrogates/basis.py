"""A surrogate on a domain, as everything that is fitted sees it.

A *basis* is a known part m0(x, omega) plus features phi(x, omega) whose coefficients c have a
Gaussian prior, ``eta(x, omega; c) = m0(x, omega) + phi(x, omega)' c``. Everything else, from the
collapsed likelihood to the diagnosis, is written on those two functions.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from sklearn.base import BaseEstimator

from hybridsurrogate.arguments import state_to_pickle
from hybridsurrogate.numerics.linear_algebra import blocks, each_with_each, in_turn
from hybridsurrogate.registration import add
from hybridsurrogate.simulation.modification import Modification
from hybridsurrogate.types import FloatArray, Prior


@dataclass(frozen=True)
class Domain:
    """The ranges on which a surrogate is defined, and the rows that it is trained on.

    Attributes
    ----------
    input_ranges : ndarray of shape (n_inputs, 2)
        Simulated range of each input.
    parameter_ranges : ndarray of shape (n_parameters, 2)
        Simulated range of each parameter, the assumed constants last.
    location, scale : float
        Mean and standard deviation of the outputs on the scale of eta, for default priors.
    simulate : callable or None
        ``simulate(X, omega) -> (n,)`` on the scale of eta; None when there are only runs.
    X, omega : ndarray of shape (n, n_inputs), (n, n_parameters)
        Inputs and parameters of the runs, or of the measured rows where there are no runs.
    eta : ndarray of shape (n,)
        Outputs of these rows on the scale of eta.
    input_names, parameter_names : tuple of str

    Examples
    --------
    >>> domain = Domain(np.array([[0, 4]]), np.array([[5, 15]]), location=0.0, scale=1.0)
    >>> domain.scaled(np.array([[3.0]]), np.array([[5.0]]))
    array([[ 0.5, -1. ]])
    """

    input_ranges: FloatArray
    parameter_ranges: FloatArray
    location: float
    scale: float
    simulate: Callable[[FloatArray, FloatArray], FloatArray] | None = None
    X: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    omega: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    eta: FloatArray = field(default_factory=lambda: np.empty(0))
    input_names: tuple[str, ...] = ()
    parameter_names: tuple[str, ...] = ()

    def scaled(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Map inputs and parameters to [-1, 1], (n, n_inputs + n_parameters).

        Parameters beyond the runs are fixed at the ends, where the runs stop.
        """
        low, high = self.parameter_ranges[:, 0], self.parameter_ranges[:, 1]
        points = np.hstack([X, np.clip(omega, low, high)])
        ranges = np.vstack([self.input_ranges, self.parameter_ranges])
        return (2 * points - ranges.sum(axis=1)) / (ranges[:, 1] - ranges[:, 0])


class Surrogate(BaseEstimator, ABC):
    """Base of the surrogates: constructor parameters only, no state.

    A user-defined surrogate implements ``build`` and returns a `Basis`.

    Examples
    --------
    >>> import numpy as np
    >>> from hybridsurrogate.surrogates import Basis, Surrogate
    >>> class LineBasis(Basis):
    ...     def known(self, X, omega, hyper=None):
    ...         return np.zeros(len(X))
    ...     def features(self, X, omega):
    ...         return np.column_stack([np.ones(len(X)), X, omega])
    >>> class Line(Surrogate):
    ...     def build(self, domain):
    ...         p = 1 + len(domain.input_ranges) + len(domain.parameter_ranges)
    ...         return LineBasis(np.zeros(p), np.full(p, 10 * domain.scale))
    """

    def __getstate__(self) -> dict[str, Any]:
        state: dict[str, Any] = super().__getstate__()
        return state_to_pickle(state, type(self).__name__)

    @abstractmethod
    def build(self, domain: Domain) -> Basis:
        """Return the basis on a domain."""

    def of_measured_data(self) -> Surrogate:
        """Return the surrogate of measured data alone with which predictive weighting mixes it.

        It is built where omega has no columns: a surrogate that needs parameters returns another.
        """
        return self


# an instance by name; property tests run over it
SURROGATES: dict[str, Surrogate] = {}


def register(name: str, surrogate: Surrogate) -> None:
    """Give a surrogate a name and make its class public; its file calls it at the end.

    Parameters
    ----------
    name : str
    surrogate : Surrogate
        One that can be built on any domain, for the tests of what all surrogates must hold.

    Examples
    --------
    >>> register("line", dict())
    Traceback (most recent call last):
        ...
    TypeError: register('line', ...) needs a Surrogate object, got {}.
    """
    if not isinstance(surrogate, Surrogate):
        raise TypeError(f"register({name!r}, ...) needs a Surrogate object, got {surrogate!r}.")
    add(SURROGATES, name, surrogate)


class Factors(NamedTuple):
    """Parts of ``known + (of_inputs * of_parameters) @ c``: (n,), (n, p) and (J, p).

    Examples
    --------
    >>> parts = Factors(np.zeros(2), np.array([[1.0], [2.0]]), np.array([[3.0]]))
    >>> parts.known + (parts.of_inputs * parts.of_parameters) @ [10.0]
    array([30., 60.])
    """

    known: FloatArray
    of_inputs: FloatArray
    of_parameters: FloatArray


@dataclass(frozen=True)
class Basis(ABC):
    """A surrogate on a domain: known part, features, and the prior of the coefficients.

    Attributes
    ----------
    coefficient_mean, coefficient_sd : ndarray of shape (p,)
        Independent normal priors.

    Examples
    --------
    A line through the origin, ``eta = c x``:

    >>> class Slope(Basis):
    ...     def known(self, X, omega, hyper=None):
    ...         return np.zeros(len(X))
    ...     def features(self, X, omega):
    ...         return X
    >>> Slope(np.zeros(1), np.ones(1)).output(np.array([[1.0], [2.0]]), np.empty((2, 0)), [5.0])
    array([ 5., 10.])
    """

    coefficient_mean: FloatArray
    coefficient_sd: FloatArray

    @property
    def hyperpriors(self) -> dict[str, Prior]:
        """Priors of unknowns of the surrogate itself, such as length scales; by default none."""
        return {}

    def factor(self, hyper: FloatArray, truncated: bool = False) -> FloatArray | None:
        """Return F with ``coefficients = mean + F v``, v standard normal, for hyperparameters.

        Parameters
        ----------
        hyper : ndarray of shape (J, n_hyper)
        truncated : bool, default=False
            Leave out columns that are negligible for all J.

        Returns
        -------
        ndarray of shape (J, p, r), r <= p, or None
            None: the coefficients do not depend on hyperparameters, F = diag(coefficient_sd).
        """
        return None

    def given(self, hyper: FloatArray) -> Basis:
        """Return the basis with its hyperparameters fixed at values (n_hyper,)."""
        if not self.hyperpriors:
            return self
        return _GivenBasis(
            np.zeros(len(self.coefficient_mean)), np.ones(len(self.coefficient_sd)), self, hyper
        )

    @abstractmethod
    def known(
        self, X: FloatArray, omega: FloatArray, hyper: FloatArray | None = None
    ) -> FloatArray:
        """Return m0 for rows of inputs (n, n_inputs) and parameters (n, n_parameters): (n,).

        A surrogate that is not linear in its unknowns puts them into ``hyper`` (n, n_hyper), row by
        row; `known_depends_on_hyper` then is True.
        """

    def features(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Return phi for the same rows: (n, p); by default none."""
        return np.empty((len(X), 0))

    def known_and_features(
        self, X: FloatArray, omega: FloatArray, hyper: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Return both, for a basis that makes them from the same numbers."""
        return self.known(X, omega, hyper), self.features(X, omega)

    def error(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Return F (n, r): the error of the basis against the simulation has covariance F F'.

        By default there is none in addition to the uncertainty of the coefficients.
        """
        return np.empty((len(X), 0))

    def along(self, directions: FloatArray) -> Basis:
        """Return the basis with features along directions (p, r) of the coefficients."""
        r = directions.shape[1]
        return _BasisAlong(np.zeros(r), np.ones(r), self, directions)

    known_depends_on_hyper = False
    # whether the runs are in it already, and are not to train its coefficients
    holds_runs = False
    # whether the known part is the simulation itself, which may fail for some parameters
    is_simulation = False
    # whether it is estimated from runs, with an error between them: `error`
    leaves_open = False

    def of_runs(self, X: FloatArray) -> FloatArray:
        """Return those columns of inputs (n, n_inputs) of which a run has one value."""
        return X

    def open_at(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Return the covariance (m, m) of the error at m runs, inputs as from `of_runs`."""
        return np.zeros((len(X), len(X)))

    def between(self, X: FloatArray) -> FloatArray:
        """Return the part (n,) of `error` that lies between the places of runs that are curves.

        A standard deviation. More runs at the same places leave it as it is.
        """
        return np.zeros(len(X))

    def scatter(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Return the part (n,) of `error` by which runs of a stochastic simulation differ.

        A standard deviation. More runs leave it as it is, and a measured system is one run.
        """
        return np.zeros(len(X))

    def unrepeated(self, X: FloatArray) -> FloatArray:
        """Return the part (n,) of `error` by which runs differ from those of near parameters.

        A standard deviation; none where repeated runs show how much of that is noise.
        """
        return np.zeros(len(X))

    @property
    def with_features(self) -> Basis | None:
        """The same with the error in a few coefficients; None where these would be many."""
        return self if self.is_simulation else None

    @property
    def is_quick(self) -> bool:
        """Whether the known part is a simulation of which thousands of runs take no time."""
        return False

    def modified(self, modifications: Sequence[Modification]) -> Basis:
        """Return the basis of a simulation with changed dynamics.

        Their numbers follow the assumed constants in omega.
        """
        raise ValueError(
            "Causes inside the dynamics need surrogate=ExactSurrogate(): a surrogate that was "
            "trained on runs has no right-hand side."
        )

    def factors(self, X: FloatArray, omega: FloatArray) -> Factors | None:
        """Return the features' parts of n inputs and of J parameters; None: they have no such.

        A basis whose features factorise overrides this for speed; its known part does not depend
        on the parameters.

        Parameters
        ----------
        X : ndarray of shape (n, n_inputs)
        omega : ndarray of shape (J, n_parameters)
        """
        return None

    def outer(self, X: FloatArray, omega: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return known part (J, n) and features (J, n, p) of n inputs for each of J parameters."""
        J, n = len(omega), len(X)
        factors = self.factors(X, omega)
        if factors is not None:
            known, of_inputs, of_parameters = factors
            return np.broadcast_to(known, (J, n)), of_inputs * of_parameters[:, None]
        rows, points = each_with_each(X, omega)
        features = self.features(rows, points)
        return self.known(rows, points).reshape(J, n), features.reshape(J, n, features.shape[1])

    def output(self, X: FloatArray, omega: FloatArray, c: FloatArray) -> FloatArray:
        """Return the output for rows of inputs and parameters and one draw of c (p,): (n,)."""
        return self.known(X, omega) + self.features(X, omega) @ c

    def output_in_turn(self, X: FloatArray, omega: FloatArray, c: FloatArray) -> FloatArray:
        """Return the output (n,) for J draws of c (J, p), the first for the first n / J rows."""
        n, p = len(X) // len(c), len(self.coefficient_mean)
        added = np.empty(len(X))
        for some in blocks(len(c), n * p):
            rows = slice(some.start * n, some.stop * n)
            added[rows] = in_turn(self.features(X[rows], omega[rows]), c[some])
        return self.known(X, omega) + added

    def output_close_by(
        self, X: FloatArray, omega: FloatArray, c: FloatArray, shape: tuple[int, int, int]
    ) -> FloatArray:
        """Return the output of rows of ``shape``: nodes, moves that are short, measured rows.

        The first move of a node is none. A basis that knows its slopes may follow them from there.
        """
        return self.output(X, omega, c)

    def outer_output(self, X: FloatArray, omega: FloatArray, c: FloatArray) -> FloatArray:
        """Return the output (J, n) of n inputs for each of J parameters.

        For one draw of c (p,), or for one for each parameter (J, p).
        """
        factors = self.factors(X, omega)
        if factors is not None:
            known, of_inputs, of_parameters = factors
            return known + (of_parameters * c) @ of_inputs.T
        output = self.output if c.ndim == 1 else self.output_in_turn
        return output(*each_with_each(X, omega), c).reshape(len(omega), len(X))


@dataclass(frozen=True)
class _GivenBasis(Basis):
    """Another basis at fixed hyperparameters, its features in whitened coordinates."""

    basis: Basis
    hyper: FloatArray

    def known(
        self, X: FloatArray, omega: FloatArray, hyper: FloatArray | None = None
    ) -> FloatArray:
        rows = np.broadcast_to(self.hyper, (len(X), len(self.hyper)))
        known = self.basis.known(X, omega, rows)
        if not len(self.coefficient_mean):
            return known
        return known + self.basis.features(X, omega) @ self.basis.coefficient_mean

    def features(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        features = self.basis.features(X, omega)
        return features if self._factor is None else features @ self._factor[0]

    @cached_property
    def _factor(self) -> FloatArray | None:
        return self.basis.factor(self.hyper[None])


@dataclass(frozen=True)
class _BasisAlong(Basis):
    """Another basis along some directions of its coefficients; their prior is not asked for."""

    basis: Basis
    directions: FloatArray

    def known(
        self, X: FloatArray, omega: FloatArray, hyper: FloatArray | None = None
    ) -> FloatArray:
        return self.basis.known(X, omega, hyper)

    def features(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        return self.basis.features(X, omega) @ self.directions
