"""The model of measured rows: surrogate, causes and priors wired into arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from typing import NamedTuple

import numpy as np

from hybridsurrogate.effects.base import SIMULATED, Cause, Rows
from hybridsurrogate.inference.blocks import in_blocks
from hybridsurrogate.likelihoods import Contaminated, Likelihood, TransformedNormal
from hybridsurrogate.priors import FloatArray, Prior, from_normal
from hybridsurrogate.surrogates.base import Basis, Factors


class Parts(NamedTuple):
    """What measured rows are made of, for J draws and n rows.

    ``eta = known + features @ c + columns @ a``, noise scale ``noise * sigma``.

    Attributes
    ----------
    known : ndarray of shape (J, n)
    features : ndarray of shape (J, n, p)
    noise : ndarray of shape (J, n), or (J, 1) when no cause changes it
    columns : ndarray of shape (J, n, q)
    """

    known: FloatArray
    features: FloatArray
    noise: FloatArray
    columns: FloatArray


@dataclass(frozen=True)
class MeasuredModel:
    """How measured rows follow from the simulation, before any data.

    Unknowns are the simulation's parameters omega and the causes' own parameters theta, both also
    as standard normal coordinates ``z = [z_omega, z_theta]``.

    Attributes
    ----------
    basis : Basis
        The surrogate on its domain.
    columns : tuple of str
        Names of the measured columns, inputs of the simulation first.
    n_inputs : int
    parameters : dict of name to prior
    constants : dict of name to float
        Assumed constants at their assumed values; they follow the parameters in omega.
    effects : tuple of Cause
        Prepared causes.
    default_sd : float
        Prior sd of column coefficients for causes that name none.
    reference : ndarray of shape (p,) or None
        Coefficients of the surrogate with which noise follows the simulation's output. None: their
        prior means.
    """

    basis: Basis
    columns: tuple[str, ...]
    n_inputs: int
    parameters: dict[str, Prior]
    constants: dict[str, float]
    effects: tuple[Cause, ...]
    default_sd: float
    reference: FloatArray | None = None

    def with_effects(self, effects: Sequence[Cause]) -> MeasuredModel:
        """Return a model without causes with these; some may change an ODE's right-hand side."""
        changes = [e.modification for e in effects if e.modification is not None]
        if not changes:
            return replace(self, effects=tuple(effects))
        numbers = {name: value for change in changes for name, value in change.constants.items()}
        return replace(
            self,
            basis=self.basis.modified(changes),
            constants={**self.constants, **numbers},
            effects=tuple(effects),
        )

    @cached_property
    def theta_names(self) -> tuple[tuple[int, str], ...]:
        """Position of the cause and name of each theta."""
        return tuple((k, name) for k, e in enumerate(self.effects) for name in e.parameters)

    @cached_property
    def priors(self) -> list[Prior]:
        """Priors of omega, then of theta."""
        own = [self.effects[k].parameters[name] for k, name in self.theta_names]
        return [*self.parameters.values(), *own]

    @cached_property
    def all_priors(self) -> list[Prior]:
        """Priors of omega, of theta, then of the surrogate's hyperparameters."""
        return [*self.priors, *self.basis.hyperpriors.values()]

    @property
    def n_parameters(self) -> int:
        """Number of unknown parameters of the simulation."""
        return len(self.parameters)

    @property
    def n_unknowns(self) -> int:
        """Number of omega and theta."""
        return len(self.priors)

    @cached_property
    def column_names(self) -> tuple[tuple[int, str], ...]:
        """Position of the cause and name of each added column."""
        return tuple((k, name) for k, e in enumerate(self.effects) for name in e.coefficients)

    @cached_property
    def column_sd(self) -> FloatArray:
        """Prior sd of the coefficients of the added columns, (q,)."""
        own = [self.effects[k].coefficient_sd for k, _ in self.column_names]
        return np.array([self.default_sd if sd is None else sd for sd in own], dtype=float)

    @property
    def n_hyper(self) -> int:
        """Number of hyperparameters of the surrogate."""
        return len(self.basis.hyperpriors)

    def values(self, z: FloatArray) -> FloatArray:
        """Map standard normal coordinates to [omega, theta], and hyperparameters if z has them."""
        return from_normal(self.all_priors[: z.shape[-1]], z)

    def parts(self, X: FloatArray, values: FloatArray) -> Parts:
        """Return the parts for measured rows X (n, n_columns) and draws of `values`.

        Hyperparameters (the last columns) are needed where the surrogate's known part has some.
        """
        return Parts(*self.simulated(X, values), self.added(X, values))

    def simulated(
        self, X: FloatArray, values: FloatArray, c: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return known (J, n), features (J, n, p) and noise (J, n) or (J, 1).

        With one draw ``c`` (p,) of the surrogate's coefficients known is the whole output, and
        there are no features.
        """
        numbers = len(X) * (1 + (len(self.basis.coefficient_mean) if c is None else 0))
        known, features, noise = in_blocks(
            lambda block: self._simulated(X, block, c), values, numbers
        )
        return known, features, noise

    def _simulated(
        self, X: FloatArray, values: FloatArray, c: FloatArray | None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        if not self.effects and not self.basis.known_depends_on_hyper:
            return *self._unmoved(X, values, c), np.ones((len(values), 1))
        rows, omega, theta = self.rows(X, values)
        known, features = self._moved(X, values, c, rows, omega, theta)
        gain = self._gain(rows, theta)
        if gain is not None:
            gain = np.broadcast_to(gain, known.size).reshape(known.shape)
            known, features = known * gain, features * gain[..., None]
        if any(effect.follows_mean for effect in self.effects):
            output = known if c is not None else known + features @ self._reference
            rows = {**rows, SIMULATED: output.ravel()}
        return known, features, self._noise(rows, theta, len(values), len(X))

    def _unmoved(
        self, X: FloatArray, values: FloatArray, c: FloatArray | None
    ) -> tuple[FloatArray, FloatArray]:
        """Return known and features of all rows at the parameters of each draw."""
        inputs, omega = X[:, : self.n_inputs], self._omega(values)
        if c is None:
            return self.basis.outer(inputs, omega)
        return self.basis.outer_output(inputs, omega, c), np.empty((len(omega), len(X), 0))

    def _moved(
        self,
        X: FloatArray,
        values: FloatArray,
        c: FloatArray | None,
        rows: Rows,
        omega: Rows,
        theta: Sequence[Rows],
    ) -> tuple[FloatArray, FloatArray]:
        """Return known and features at the inputs and parameters that causes may have moved."""
        J, n, by_row = len(values), len(X), self.basis.known_depends_on_hyper
        if not by_row and not any(effect.moves_inputs for effect in self.effects):
            return self._unmoved(X, values, c)
        inputs, points = self._places(rows, omega, theta)
        if c is not None and not by_row:
            return self.basis.output(inputs, points, c).reshape(J, n), np.empty((J, n, 0))
        hyper = np.repeat(values[:, self.n_unknowns :], n, axis=0) if by_row else None
        known = self.basis.known(inputs, points, hyper)
        features = self.basis.features(inputs, points)
        if c is not None:
            known, features = known + features @ c, features[:, :0]
        return known.reshape(J, n), features.reshape(J, n, features.shape[1])

    def _places(
        self, rows: Rows, omega: Rows, theta: Sequence[Rows]
    ) -> tuple[FloatArray, FloatArray]:
        """Return inputs and parameters of every row of every draw as causes move them."""
        n = len(rows[self.columns[0]])
        for effect, own in zip(self.effects, theta, strict=True):
            rows, omega = effect.inputs(rows, omega, own)
        # column by column, as simulations take them
        inputs = np.stack([rows[name] for name in self.columns[: self.n_inputs]]).T
        points: FloatArray = np.empty((n, 0))
        if omega:
            points = np.stack([omega[k] for k in (*self.parameters, *self.constants)]).T
        return inputs, points

    def _gain(self, rows: Rows, theta: Sequence[Rows]) -> FloatArray | None:
        """Return the factor on the simulation, None where no cause has one."""
        gains = [np.asarray(e.gain(rows, own)) for e, own in zip(self.effects, theta, strict=True)]
        gains = [gain for gain in gains if gain.ndim or gain != 1.0]
        return np.asarray(reduce(np.multiply, gains)) if gains else None

    def emulator_error(self, X: FloatArray, values: FloatArray, factor: FloatArray) -> FloatArray:
        """Return U (n, r): what the emulator leaves open at one draw has covariance U U'.

        ``factor`` (p, p) is that of the covariance of its coefficients.
        """
        rows, omega, theta = self.rows(X, values)
        inputs, points = self._places(rows, omega, theta)
        U = np.hstack(
            [self.basis.features(inputs, points) @ factor, self.basis.error(inputs, points)]
        )
        gain = self._gain(rows, theta)
        return U if gain is None else U * np.broadcast_to(gain, len(U))[:, None]

    @property
    def factorises(self) -> bool:
        """Whether `factors` are to be had: causes may only add to the simulation."""
        return (
            type(self.basis).factors is not Basis.factors
            and not self.basis.known_depends_on_hyper
            and not any(effect.touches_simulation for effect in self.effects)
            and not self.touches_noise
        )

    @property
    def touches_noise(self) -> bool:
        """Whether a cause changes the noise of single rows."""
        return any(effect.touches_noise for effect in self.effects)

    def factors(self, X: FloatArray, values: FloatArray) -> Factors | None:
        """Return the surrogate's `Factors` of rows X and draws of `values`."""
        if not self.factorises:
            return None
        return self.basis.factors(X[:, : self.n_inputs], self._omega(values))

    def _omega(self, values: FloatArray) -> FloatArray:
        constants = np.tile(list(self.constants.values()), (len(values), 1))
        return np.hstack([values[:, : self.n_parameters], constants])

    @property
    def _reference(self) -> FloatArray:
        return self.basis.coefficient_mean if self.reference is None else self.reference

    def noise(self, X: FloatArray, values: FloatArray, simulated: FloatArray) -> FloatArray:
        """Return noise factors (J, n), or (J, 1) when no cause changes it; nothing is simulated.

        ``simulated`` (n,) is the simulation's output, for noise that follows it.
        """
        J = len(values)
        if not self.touches_noise:
            return np.ones((J, 1))
        rows, _, theta = self.rows(X, values)
        return self._noise({**rows, SIMULATED: np.tile(simulated, J)}, theta, J, len(X))

    def likelihood_of(self, likelihood: Likelihood, values: FloatArray) -> Likelihood:
        """Return the likelihood of measured rows for draws of `values`: some rows are outliers."""
        share = self.outlier_share(values)
        if share is None:
            return likelihood
        assert isinstance(likelihood, TransformedNormal)
        return Contaminated(likelihood, share[:, None])

    def outlier_share(self, values: FloatArray) -> FloatArray | None:
        """Return the share of rows that are outliers for draws of `values`, (J,), or None."""
        if not any(effect.has_outliers for effect in self.effects):
            return None
        rest = np.ones(len(values))
        for effect, own in zip(self.effects, self.theta(values), strict=True):
            rest = rest * (1 - np.asarray(effect.outliers(own)))
        return 1 - rest

    def _noise(self, rows: Rows, theta: Sequence[Rows], J: int, n: int) -> FloatArray:
        noise: FloatArray = np.ones((J, 1))
        for effect, own in zip(self.effects, theta, strict=True):
            factor = np.asarray(effect.noise(rows, own))
            if factor.ndim or factor != 1.0:
                noise = noise * np.broadcast_to(factor, J * n).reshape(J, n)
        return noise

    def added(self, X: FloatArray, values: FloatArray) -> FloatArray:
        """Return the columns that causes add, (J, n, q); the simulation is not run."""
        return self.added_by(range(len(self.effects)), X, values)

    def added_by(self, chosen: Sequence[int], X: FloatArray, values: FloatArray) -> FloatArray:
        """As `added`, of some of the causes, by position."""
        adding = [k for k in chosen if self.effects[k].coefficients]
        q = sum(len(self.effects[k].coefficients) for k in adding)
        if not q:
            return np.empty((len(values), len(X), 0))
        (added,) = in_blocks(lambda block: (self._added(adding, X, block),), values, len(X) * q)
        return added

    def _added(self, adding: Sequence[int], X: FloatArray, values: FloatArray) -> FloatArray:
        shape = len(values), len(X), -1
        added: list[FloatArray] = []
        formed = [k for k in adding if not self.effects[k].factorises]
        rows, _, theta = self.rows(X, values) if formed else ({}, {}, [])
        once = {name: X[:, k] for k, name in enumerate(self.columns)}
        for k in adding:
            if k in formed:
                columns = self.effects[k].columns(rows, theta[k])
                assert columns is not None
                added.append(np.reshape(columns, shape))
            else:
                factors = self.effects[k].factors(once, self.theta(values)[k])
                assert factors is not None
                added.append(factors[0] * factors[1][:, None])
        return added[0] if len(added) == 1 else np.concatenate(added, axis=2)

    def rows(self, X: FloatArray, values: FloatArray) -> tuple[Rows, Rows, list[Rows]]:
        """Return columns, omega and each cause's theta, every row of every draw after another."""
        J, n = len(values), len(X)
        rows: Rows = {name: np.tile(X[:, k], J) for k, name in enumerate(self.columns)}
        repeated = np.repeat(values.T, n, axis=1).T  # columns in one piece
        omega: Rows = {
            **{name: repeated[:, k] for k, name in enumerate(self.parameters)},
            **{name: np.full(J * n, value) for name, value in self.constants.items()},
        }
        return rows, omega, self.theta(repeated)

    def theta(self, values: FloatArray) -> list[Rows]:
        """Return each cause's own parameters by name, for draws of `values`."""
        theta: list[Rows] = [{} for _ in self.effects]
        for column, (k, name) in enumerate(self.theta_names, start=self.n_parameters):
            theta[k] = {**theta[k], name: values[:, column]}
        return theta
