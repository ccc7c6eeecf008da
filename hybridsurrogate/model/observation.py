"""The model of measured rows: surrogate, causes and priors wired into arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.effects.base import MEASURED, SIMULATED, Cause, Rows
from hybridsurrogate.likelihoods import Likelihood
from hybridsurrogate.model.effects import CausesOnRows
from hybridsurrogate.model.rows.stacking import Conditional
from hybridsurrogate.numerics.digits import number
from hybridsurrogate.numerics.linear_algebra import blocks, in_blocks
from hybridsurrogate.priors import from_normal
from hybridsurrogate.simulation.modification import Modification
from hybridsurrogate.simulation.outputs import OneOutput
from hybridsurrogate.simulation.simulator import Simulator
from hybridsurrogate.surrogates.basis import Basis, Factors
from hybridsurrogate.types import FloatArray, Prior

# places of which runs or slopes are kept at a time, and the numbers in the rows of one run
MAX_KEPT_PLACES, _MAX_KEPT_NUMBERS = 64, 20_000


class TransformedSimulation:
    """The simulation on the scale of eta; a class so that it can be pickled.

    A search climbs from one place once for every cause, so that a third of its runs are repeats:
    the latest are kept.
    """

    def __init__(self, simulator: Simulator, likelihood: Likelihood):
        self.simulator, self.likelihood = simulator, likelihood
        self._kept = lru_cache(MAX_KEPT_PLACES)(self._run_of_bytes)
        # inputs and parameters (1, k) of the first row without an output
        self._failed: tuple[FloatArray, FloatArray] | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        return TransformedSimulation, (self.simulator, self.likelihood)

    def modified(self, modifications: Sequence[Modification]) -> TransformedSimulation:
        """Return the simulation with changed dynamics."""
        return TransformedSimulation(self.simulator.modified(modifications), self.likelihood)

    def __call__(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Return the output (n,) for rows of inputs and parameters."""
        if not 0 < X.size + omega.size <= _MAX_KEPT_NUMBERS:
            return self._run(X, omega)
        return self._kept(X.T.tobytes(), omega.T.tobytes(), len(X)).copy()

    def _run_of_bytes(self, inputs: bytes, parameters: bytes, n: int) -> FloatArray:
        # column by column, as simulations take them
        X, omega = (np.frombuffer(b).reshape(-1, n).T for b in (inputs, parameters))
        return self._run(X, omega)

    def _run(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        # parameters far in the tails may break a simulation: NaN there means impossible
        inputs = self.simulator.held(X)
        with np.errstate(all="ignore"):
            outputs = self.simulator.cached(inputs, omega)
            if self._failed is None and not np.isfinite(outputs).all():
                row = int(np.argmin(np.isfinite(outputs)))
                self._failed = inputs[row : row + 1].copy(), omega[row : row + 1].copy()
            return self.likelihood.link(outputs)

    def failure(self, X: FloatArray) -> str:
        """Return where the simulation failed, and what it raised; "" if it did not.

        At measured rows in the middle of the priors, or where a run failed first.

        Parameters
        ----------
        X : ndarray of shape (n, n_columns)
            Measured rows, the simulation's inputs first.
        """
        simulator = self.simulator
        if isinstance(simulator.function, OneOutput):
            # it hides what the simulation of all outputs raised, and has a row for each of them
            simulator = simulator.function.simulator
            places = X[:, : len(simulator.input_names)]
            X = X[np.sort(np.unique(places, axis=0, return_index=True)[1])]
        k = len(simulator.input_names)
        inputs = X[:, :k]
        middle = [np.mean(ends) for ends in simulator.parameter_ranges.values()]
        failed, said = _failed(simulator, inputs, np.tile(middle, (len(inputs), 1)))
        if failed.any():
            first = int(np.argmax(failed))
            return (
                f"At the middle of the priors the simulation fails at {int(failed.sum())} of "
                f"{len(inputs)} measured rows, first in row {first + 1} (index {first}): {said}."
            )
        if self._failed is None:
            return ""
        at, omega = self._failed[0][:, :k], self._failed[1]
        names = (*simulator.input_names, *simulator.parameter_ranges)
        values = zip(names, np.hstack([at, omega])[0], strict=False)
        place = ", ".join(f"{name} = {number(value)}" for name, value in values)
        return f"At {place} the simulation fails: {_failed(simulator, at, omega)[1]}."


def _failed(
    simulator: Simulator, X: FloatArray, omega: FloatArray
) -> tuple[NDArray[np.bool_], str]:
    """Return which rows (n,) have no output, and what the first run that raised said."""
    with np.errstate(all="ignore"):
        outputs, said = simulator.tried(X, omega)
    failed = np.asarray(~np.isfinite(outputs.reshape(len(X), -1)).all(axis=1))
    return failed, said or "the output is NaN or infinite"


@dataclass(frozen=True)
class WorkingPoint:
    """Where the likelihood of measured rows is expanded.

    Attributes
    ----------
    likelihood : Likelihood
    eta : ndarray of shape (n,)
        Output without a cause, on the scale of eta.
    sigma : float
        The likelihood's second parameter there.
    draws : ndarray of shape (S,)
        Draws of that parameter, for replicates.
    factor : ndarray of shape (n,)
        On that parameter in each row.
    """

    likelihood: Likelihood
    eta: FloatArray
    sigma: float
    draws: FloatArray
    factor: FloatArray

    def response(self, y: FloatArray) -> FloatArray:
        """Return the working response of measured values (..., n)."""
        eta = np.broadcast_to(self.eta, np.shape(y))
        return self.likelihood.working_rows(y, eta, np.array(self.sigma * self.factor))[0]

    def replicates(self, eta: FloatArray, random_state: np.random.RandomState) -> FloatArray:
        """Draw working responses of new data at outputs eta (R, n)."""
        sigma = random_state.choice(self.draws, size=len(eta))[:, None] * self.factor
        return self.response(self.likelihood.sample(eta, sigma, random_state))

    def noise(self) -> FloatArray:
        """Return the noise of each row, (n,); in units of sigma there where that is its scale."""
        sigma = np.array(self.sigma * self.factor)
        _, noise = self.likelihood.working_rows(self.eta, self.eta, sigma)
        return noise / sigma if self.likelihood.scales_noise else noise


# differences along a parameter of a smooth simulation, in standard deviations of its prior
SHORTEST_STEP = 1e-3


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
class MeasuredModel(CausesOnRows):
    """How measured rows follow from the simulation, before any data.

    Unknowns are the simulation's parameters omega and the causes' own parameters theta, both also
    as standard normal coordinates ``z = [z_omega, z_theta]``.

    Attributes
    ----------
    basis : Basis
        The surrogate on its domain.
    reference : ndarray of shape (p,) or None
        Coefficients of the surrogate with which noise follows the simulation's output. None: their
        prior means.
    least_step : float
        Differences over less, in standard deviations of the priors, mean nothing: how rough the
        simulation is, see `finite_differences.py`. Zero for a smooth one.
    unchanged : tuple of Basis and dict, or None
        Basis and constants before causes changed the right-hand side; None where none did.
    """

    basis: Basis
    reference: FloatArray | None = None
    least_step: float = 0.0
    unchanged: tuple[Basis, dict[str, float]] | None = None

    def __repr__(self) -> str:
        causes = ", ".join(effect.kind for effect in self.effects) or "none"
        return (
            f"MeasuredModel({type(self.basis).__name__}; columns: {', '.join(self.columns)}; "
            f"unknowns: {', '.join([*self.parameters, *(n for _, n in self.theta_names)])}; "
            f"causes: {causes})"
        )

    def with_effects(self, effects: Sequence[Cause]) -> MeasuredModel:
        """Return the model with these causes instead; some may change an ODE's right-hand side."""
        basis, constants = self.unchanged or (self.basis, self.constants)
        changes = [e.modification for e in effects if e.modification is not None]
        if not changes:
            return replace(
                self, basis=basis, constants=constants, effects=tuple(effects), unchanged=None
            )
        numbers = {name: value for change in changes for name, value in change.constants.items()}
        return replace(
            self,
            basis=basis.modified(changes),
            constants={**constants, **numbers},
            effects=tuple(effects),
            unchanged=(basis, constants),
        )

    def reordered(self, effects: Sequence[Cause]) -> tuple[MeasuredModel, list[int]]:
        """Return the model with some of its causes, in any order, and where its unknowns were."""
        model, d = self.with_effects(effects), self.n_parameters
        old = [(id(self.effects[owner]), name) for owner, name in self.theta_names]
        new = [(id(effects[owner]), name) for owner, name in model.theta_names]
        return model, [*range(d), *(d + old.index(key) for key in new)]

    @cached_property
    def all_priors(self) -> list[Prior]:
        """Priors of omega, of theta, then of the surrogate's hyperparameters."""
        return [*self.priors, *self.basis.hyperpriors.values()]

    @property
    def step(self) -> float:
        """Length of a difference along a parameter, in standard deviations of the priors."""
        return max(SHORTEST_STEP, self.least_step)

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

    def outputs(
        self, X: FloatArray, values: FloatArray, c: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the output (J, n) and noise (J, n) or (J, 1), each draw with its own c (J, p)."""
        # such noise follows the reference, whatever the draw
        if not self.noise_follows and not self.basis.known_depends_on_hyper:
            output, _, noise = self._simulated(X, values, c)
            return output, noise
        output, noise = np.empty((2, len(values), len(X)))
        for some in blocks(len(values), len(X) * (1 + c.shape[1])):
            known, features, noise[some] = self.simulated(X, values[some])
            output[some] = known + (features @ c[some, :, None])[..., 0]
        return output, noise

    def _simulated(
        self, X: FloatArray, values: FloatArray, c: FloatArray | None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return what `simulated` does; c may be one draw (p,) or one for each of values (J, p)."""
        known, features = self._output(X, values, c)
        if not self.touches_noise:
            return known, features, np.ones((len(values), 1))
        rows, _, theta = self.rows(X, values)
        slopes: Sequence[FloatArray | None] = [None] * len(self.effects)
        if self.noise_follows:
            output = known if c is not None else known + features @ self._reference
            rows = {**rows, SIMULATED: output.ravel()}
            slopes = [None if s is None else s.ravel() for s in self.slopes(X, values, c, output)]
        noise = self._noise(rows, theta, slopes, len(values), len(X))
        given = self.conditional(X, values)
        if given is None:
            return known, features, noise
        return *self._given(given, X, known, features), given.noise(noise, len(X))

    def _given(
        self, given: Conditional, X: FloatArray, known: FloatArray, features: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return known and features of rows given others of their measurement."""
        y = X[:, self.names.index(MEASURED)]
        left = given.residuals((y - known)[..., None])[..., 0]
        # rows that were not measured are given none
        return np.where(np.isfinite(y), y - left, known), given.residuals(features)

    def output(
        self, X: FloatArray, values: FloatArray, c: FloatArray | None, moves: int = 1
    ) -> tuple[FloatArray, FloatArray]:
        """Return known and features of the simulated output with what causes make of it.

        Of draws of which ``moves`` at a time are close to the first. Rows of several outputs with
        correlated errors are given others of their measurement.
        """
        known, features = self._output(X, values, c, moves)
        given = self.conditional(X, values)
        return (known, features) if given is None else self._given(given, X, known, features)

    def _output(
        self, X: FloatArray, values: FloatArray, c: FloatArray | None, moves: int = 1
    ) -> tuple[FloatArray, FloatArray]:
        """Return `output` of rows by themselves."""
        by_row = self.basis.known_depends_on_hyper
        if not by_row and not self.acts_on("inputs", "gain", "response"):
            return self._unchanged(X, values, c, moves)
        rows, omega, theta = self.rows(X, values)
        known, features = self._moved(X, values, c, rows, omega, theta, moves)
        if not self.acts_on("gain", "response"):
            return known, features
        # where there are features, to first order around the output of the reference
        output = known + features @ self._reference if features.shape[2] else known
        changed, slope = self._response(output.ravel(), rows, theta)
        changed, slope = changed.reshape(known.shape), slope.reshape(known.shape)
        if not features.shape[2]:
            return changed, features
        return changed + slope * (known - output), slope[..., None] * features

    def slopes(
        self, X: FloatArray, values: FloatArray, c: FloatArray | None, output: FloatArray
    ) -> list[FloatArray | None]:
        """Return for each cause the slope (J, n) of the output (J, n) that its noise needs."""
        return [
            None
            if effect.follows_slope is None
            else self.slope(*effect.follows_slope, X, values, c, output)
            for effect in self.effects
        ]

    def slope(
        self,
        name: str,
        usual: float,
        X: FloatArray,
        values: FloatArray,
        c: FloatArray | None,
        output: FloatArray,
    ) -> FloatArray:
        """Return the slope (J, n) of the output over an input, a parameter or a constant.

        A difference over a small share of a usual change. Without coefficients ``c`` (p,) the
        output is that of the reference, estimated from the runs.
        """
        step, model = self.step * usual, self
        if not step > 0:
            return np.zeros_like(output)
        if name in self.constants:
            model = replace(self, constants={**self.constants, name: self.constants[name] + step})
        elif name in self.parameters:
            at = list(self.parameters).index(name)
            values = values.copy()
            values[:, at] += step
        else:
            X = X.copy()
            X[:, self.columns.index(name)] += step
        known, features = model._output(X, values, c)
        if c is None:
            known = known + features @ self._reference
        return (known - output) / step

    def _unchanged(
        self, X: FloatArray, values: FloatArray, c: FloatArray | None, moves: int
    ) -> tuple[FloatArray, FloatArray]:
        """Return known and features of all rows at the parameters of each draw."""
        inputs, omega = X[:, : self.n_inputs], self._omega(values)
        if c is None:
            return self.basis.outer(inputs, omega)
        # nodes of a cause that leaves parameters alone ask for the same moves again and again
        times = len(omega) // moves
        if c.ndim == 1 and np.array_equal(omega, np.tile(omega[:moves], (times, 1))):
            output = np.tile(self.basis.outer_output(inputs, omega[:moves], c), (times, 1))
        else:
            output = self.basis.outer_output(inputs, omega, c)
        return output, np.empty((len(omega), len(X), 0))

    def _moved(
        self,
        X: FloatArray,
        values: FloatArray,
        c: FloatArray | None,
        rows: Rows,
        omega: Rows,
        theta: Sequence[Rows],
        moves: int,
    ) -> tuple[FloatArray, FloatArray]:
        """Return known and features at the inputs and parameters that causes may have moved."""
        J, n, by_row = len(values), len(X), self.basis.known_depends_on_hyper
        if not by_row and not self.acts_on("inputs"):
            return self._unchanged(X, values, c, moves)
        inputs, points = self._places(rows, omega, theta)
        if c is not None and not by_row:
            if c.ndim == 2:
                output = self.basis.output_in_turn(inputs, points, c)
            else:
                output = self.basis.output_close_by(inputs, points, c, (J // moves, moves, n))
            return output.reshape(J, n), np.empty((J, n, 0))
        hyper = np.repeat(values[:, self.n_unknowns :], n, axis=0) if by_row else None
        known, features = self.basis.known_and_features(inputs, points, hyper)
        if c is not None:
            known, features = known + features @ c, features[:, :0]
        return known.reshape(J, n), features.reshape(J, n, features.shape[1])

    def places(self, X: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return inputs and parameters (J n, ...) at which the simulation is evaluated."""
        return self._places(*self.rows(X, values))

    def emulator_error(self, X: FloatArray, values: FloatArray, factor: FloatArray) -> FloatArray:
        """Return U (n, r): the emulator's error at one draw has covariance U U'.

        ``factor`` (p, p) is that of the covariance of its coefficients.
        """
        if self.basis.is_simulation:
            return np.empty((len(X), 0))
        rows, omega, theta = self.rows(X, values)
        inputs, points = self._places(rows, omega, theta)
        output = np.zeros(len(X))  # the slope of a factor is the same everywhere
        if self.acts_on("response"):
            known, many = self._moved(X, values, None, rows, omega, theta, 1)
            features, output = many[0], (known + many @ self._reference)[0]
        else:
            features = self.basis.features(inputs, points)
        U = np.hstack([features @ factor, self.basis.error(inputs, points)])
        if self.acts_on("gain", "response"):
            U = U * self._response(output, rows, theta)[1][:, None]
        given = self.conditional(X, values)
        return U if given is None else given.residuals(U[None])[0]

    @property
    def factorises(self) -> bool:
        """Whether `factors` are to be had: causes may only add to the simulation."""
        return (
            type(self.basis).factors is not Basis.factors
            and not self.basis.known_depends_on_hyper
            and not self.acts_on("inputs", "gain", "response")
            and not self.touches_noise
        )

    def factors(self, X: FloatArray, values: FloatArray) -> Factors | None:
        """Return the surrogate's `Factors` of rows X and draws of `values`."""
        if not self.factorises:
            return None
        return self.basis.factors(X[:, : self.n_inputs], self._omega(values))

    @property
    def _reference(self) -> FloatArray:
        return self.basis.coefficient_mean if self.reference is None else self.reference
