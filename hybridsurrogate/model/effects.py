"""What causes do to measured rows: whatever of it needs no surrogate, wired into arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.effects.base import (
    ERROR,
    MEASURED,
    MEASUREMENT,
    ROW,
    SIMULATED,
    SLOPE,
    Act,
    Cause,
    Rows,
)
from hybridsurrogate.effects.noise.known_errors import Jitter, RowErrors
from hybridsurrogate.effects.noise.noise import OutputCorrelation, OutputNoise
from hybridsurrogate.likelihoods import Censored, Contaminated, Likelihood, TransformedNormal
from hybridsurrogate.model.rows.stacking import Conditional, members_of
from hybridsurrogate.numerics.linear_algebra import in_blocks
from hybridsurrogate.simulation.outputs import OUTPUT
from hybridsurrogate.types import FloatArray, Prior

# the name under which rows carry their own noise factor
_ROW_NOISE = "noise of the row"


@dataclass(frozen=True)
class CausesOnRows:
    """Causes together with a simulation's inputs and parameters, before any data.

    Attributes
    ----------
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
    has_row_noise : bool
        Whether rows X carry, in a last column that has no name, a factor on their noise.
    errors : RowErrors or None
        How rows scatter that have known errors: in a column of X after the measured ones. Without
        that column rows have the typical error.
    carried : tuple of str
        What rows of several outputs with correlated errors carry after that: see `MEASUREMENT`.
        Rows without it are of no measurement.
    given_all : bool
        Whether each row is given all others of its measurement, not those before it.
    """

    columns: tuple[str, ...]
    n_inputs: int
    parameters: dict[str, Prior]
    constants: dict[str, float]
    effects: tuple[Cause, ...]
    default_sd: float
    has_row_noise: bool = field(default=False, kw_only=True)
    errors: RowErrors | None = field(default=None, kw_only=True)
    carried: tuple[str, ...] = field(default=(), kw_only=True)
    given_all: bool = field(default=False, kw_only=True)

    @cached_property
    def theta_names(self) -> tuple[tuple[int, str], ...]:
        """Position of the cause and name of each theta."""
        return tuple((k, name) for k, e in enumerate(self.effects) for name in e.parameters)

    @cached_property
    def priors(self) -> list[Prior]:
        """Priors of omega, then of theta."""
        own = [self.effects[k].parameters[name] for k, name in self.theta_names]
        return [*self.parameters.values(), *own]

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
    def noise_follows(self) -> bool:
        """Whether noise looks at the simulation's output or at its slope."""
        return any(effect.follows_mean or effect.follows_slope for effect in self.effects)

    def acts_on(self, *acts: Act) -> bool:
        """Whether a cause rewrites one of these: see `Cause.acts_on`."""
        return any(not effect.acts_on.isdisjoint(acts) for effect in self.effects)

    @property
    def touches_noise(self) -> bool:
        """Whether the noise differs between rows."""
        known = self.has_row_noise or self.errors is not None or bool(self.carried)
        return known or self.acts_on("noise")

    @property
    def names(self) -> list[str]:
        """Names of the columns that rows may have."""
        errors, noise = [ERROR] * (self.errors is not None), [_ROW_NOISE] * self.has_row_noise
        return [*self.columns, *errors, *self.carried, *noise]

    def _once(self, X: FloatArray) -> Rows:
        """Return the columns of rows by name."""
        return dict(zip(self.names, X.T, strict=False))

    @cached_property
    def output_correlation(self) -> OutputCorrelation | None:
        """The cause that is the correlation of several outputs' errors, None without one."""
        return next((e for e in self.effects if isinstance(e, OutputCorrelation)), None)

    @property
    def correlated(self) -> bool:
        """Whether the errors of several outputs are correlated."""
        return len(self.carried) > 2 or self.output_correlation is not None

    def conditional(
        self, X: FloatArray, values: FloatArray, measured: bool = True
    ) -> Conditional | None:
        """Return measured rows given others of their measurement, None where they are independent.

        Not ``measured``: rows of unit scale that are yet to be measured.
        """
        if not self.correlated or MEASURED not in (once := self._once(X)):
            return None
        number = once[MEASUREMENT]
        if measured:
            number = np.where(np.isfinite(once[MEASURED]), number, np.nan)
        found = self.output_correlation
        k = len(found.outputs) if found else len(self.carried) - 2
        members = members_of(number, once[OUTPUT], k)
        if not len(members):
            return None
        ratios = found.ratios if found else None
        if ratios is not None:
            scale, share = np.array(ratios)[once[OUTPUT].astype(np.intp)][None], None
        else:
            scale, share = self._scale(once, values)
        if found:
            theta = self.theta(values)[self.effects.index(found)]
            matrices = found.matrices(theta, len(values))[:, None]
        else:
            each = np.stack([once[name] for name in self.carried[2:]], axis=1)
            matrices = each[members][None]
            if share is not None:
                # noise in addition to known errors is independent
                share = share[:, members]
                both = share[..., :, None] * share[..., None, :]
                matrices = np.where(np.eye(k) > 0, 1.0, matrices * both)
        scale = scale if measured else np.ones((1, len(X)))
        return Conditional.of(members, matrices, scale, self.given_all)

    def whole(self, cuts: list[slice], X: FloatArray) -> list[slice]:
        """Return blocks of new rows that split no measurement, whose rows follow each other."""
        if not self.correlated or MEASUREMENT not in (once := self._once(X)):
            return cuts
        starts = np.append(0, np.flatnonzero(np.diff(once[MEASUREMENT])) + 1)
        ends = np.append(starts, len(X))
        at = np.unique([*ends[np.searchsorted(ends, [cut.start for cut in cuts])], len(X)])
        return [slice(first, last) for first, last in pairwise(at.tolist())]

    def _scale(self, once: Rows, values: FloatArray) -> tuple[FloatArray, FloatArray | None]:
        """Return standard deviations (J or 1, n) of rows, and which share of each is a known error.

        Those of the errors alone: what else changes noise keeps their correlation.
        """
        n, J = len(once[OUTPUT]), len(values)
        known = self.errors
        scale = np.ones((1, n)) if known is None else known.factor(once, n)[None]
        for effect, theta in zip(self.effects, self.theta(values), strict=True):
            if isinstance(effect, OutputNoise | Jitter):
                rows = {k: np.tile(once[k], J) for k in (OUTPUT, ERROR) if k in once}
                drawn = {name: np.repeat(value, n) for name, value in theta.items()}
                scale = scale * effect.noise(rows, drawn).reshape(J, n)
        if known is None or known.kind != "added":
            return scale, None
        return scale, known.of_rows(once, n) / known.unit / scale

    def rows(self, X: FloatArray, values: FloatArray) -> tuple[Rows, Rows, list[Rows]]:
        """Return columns, omega and each cause's theta, every row of every draw after another."""
        J, n = len(values), len(X)
        rows: Rows = dict(zip(self.names, np.tile(X.T, J), strict=False))
        if any(effect.concerns == "data" for effect in self.effects):
            rows = {**rows, ROW: np.tile(np.arange(n, dtype=float), J)}
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

    def known_noise(self, X: FloatArray) -> FloatArray:
        """Return the factors (n,) on sigma that known errors of rows X leave, ones without any."""
        if self.errors is None:
            return np.ones(len(X))
        return self.errors.factor(self._once(X), len(X))

    def rows_moved(self, X: FloatArray) -> NDArray[np.bool_] | None:
        """Return which rows each unknown may change, (n_unknowns, n); None: each of them all."""
        once = {name: X[:, k] for k, name in enumerate(self.columns)}
        own = [effect.rows_of(once) for effect in self.effects]
        if not any(own):
            return None
        moved = np.ones((self.n_unknowns, len(X)), dtype=bool)
        for position, (k, name) in enumerate(self.theta_names, start=self.n_parameters):
            if name in own[k]:
                moved[position] = own[k][name]
        return moved

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

    def _response(
        self, simulated: FloatArray, rows: Rows, theta: Sequence[Rows]
    ) -> tuple[FloatArray, FloatArray]:
        """Return what causes make of the simulated output (J n,), and its slope over that."""
        slope = np.ones_like(simulated)
        for effect, own in zip(self.effects, theta, strict=True):
            changed = effect.response(simulated, rows, own)
            if changed is not None:
                simulated, slope = changed[0], slope * changed[1]
        return simulated, slope

    def _omega(self, values: FloatArray) -> FloatArray:
        constants = np.tile(list(self.constants.values()), (len(values), 1))
        return np.hstack([values[:, : self.n_parameters], constants])

    def added(
        self, X: FloatArray, values: FloatArray, chosen: Sequence[int] | None = None
    ) -> FloatArray:
        """Return the columns that causes add, all or some by position, (J, n, q).

        The simulation is not run.
        """
        chosen = range(len(self.effects)) if chosen is None else chosen
        adding = [k for k in chosen if self.effects[k].coefficients]
        q = sum(len(self.effects[k].coefficients) for k in adding)
        if not q:
            return np.empty((len(values), len(X), 0))
        (added,) = in_blocks(lambda block: (self._added(adding, X, block),), values, len(X) * q)
        given = self.conditional(X, values)
        return added if given is None else given.residuals(added)

    def _added(self, adding: Sequence[int], X: FloatArray, values: FloatArray) -> FloatArray:
        shape = len(values), len(X), -1
        added: list[FloatArray] = []
        formed = [k for k in adding if not self.effects[k].factorises]
        rows, _, theta = self.rows(X, values) if formed else ({}, {}, [])
        for k in adding:
            if k in formed:
                columns = self.effects[k].columns(rows, theta[k])
                assert columns is not None
                added.append(np.reshape(columns, shape))
            else:
                of_rows, of_draws = self.added_factors(k, X, values)
                added.append(of_rows * of_draws[:, None])
        return added[0] if len(added) == 1 else np.concatenate(added, axis=2)

    def added_factors(
        self, k: int, X: FloatArray, values: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return `Cause.factors` of a cause that has some, (n, q) and (J, q)."""
        rows = {name: X[:, j] for j, name in enumerate(self.columns)}
        factors = self.effects[k].factors(rows, self.theta(values)[k])
        assert factors is not None
        # one without unknowns has the same for all draws
        return factors[0], np.broadcast_to(factors[1], (len(values), factors[0].shape[1]))

    def noise(
        self,
        X: FloatArray,
        values: FloatArray,
        simulated: FloatArray,
        slopes: Sequence[FloatArray | None],
    ) -> FloatArray:
        """Return noise factors (J, n), or (J, 1) when no cause changes it; nothing is simulated.

        ``simulated`` (n,) is the simulation's output, for noise that follows it; `slopes` (n,) are
        for each cause the one that it asks for, or None.
        """
        J = len(values)
        if not self.touches_noise:
            return np.ones((J, 1))
        rows, _, theta = self.rows(X, values)
        rows = {**rows, SIMULATED: np.tile(simulated, J)}
        tiled = [None if slope is None else np.tile(slope, J) for slope in slopes]
        noise = self._noise(rows, theta, tiled, J, len(X))
        given = self.conditional(X, values)
        return noise if given is None else given.noise(noise, len(X))

    def _noise(
        self,
        rows: Rows,
        theta: Sequence[Rows],
        slopes: Sequence[FloatArray | None],
        J: int,
        n: int,
    ) -> FloatArray:
        noise: FloatArray = np.ones((J, 1))
        if self.has_row_noise:
            noise = np.array(rows[_ROW_NOISE]).reshape(J, n)
        if self.errors is not None:
            noise = noise * self.errors.factor(rows, J * n).reshape(J, n)
        for effect, own, slope in zip(self.effects, theta, slopes, strict=True):
            here = rows if slope is None else {**rows, SLOPE: slope}
            factor = np.asarray(effect.noise(here, own))
            if factor.ndim or factor != 1.0:
                noise = noise * np.broadcast_to(factor, J * n).reshape(J, n)
        return noise

    def outlier_share(self, values: FloatArray) -> FloatArray | None:
        """Return the share of rows that are outliers for draws of `values`, (J,), or None."""
        if not self.acts_on("outliers"):
            return None
        rest = np.ones(len(values))
        for effect, own in zip(self.effects, self.theta(values), strict=True):
            rest = rest * (1 - np.asarray(effect.outliers(own)))
        return 1 - rest

    def likelihood_of(self, likelihood: Likelihood, values: FloatArray) -> Likelihood:
        """Return the likelihood of measured rows for draws of `values`.

        A cause may make some rows outliers, or increase the scatter of counts, within their limits.
        """
        if isinstance(likelihood, Censored):
            return replace(likelihood, base=self.likelihood_of(likelihood.plain, values))
        if self.acts_on("overdispersion"):
            squares = np.zeros(len(values))
            for effect, own in zip(self.effects, self.theta(values), strict=True):
                squares = squares + np.square(effect.overdispersion(own))
            wider = likelihood.overdispersed(np.sqrt(squares)[:, None])
            if wider is not None:
                return wider
        share = self.outlier_share(values)
        if share is None:
            return likelihood
        assert isinstance(likelihood, TransformedNormal)
        return Contaminated(likelihood, share[:, None])
