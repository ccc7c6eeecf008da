"""A cause around a cause: in one of several outputs, or with the size of a search."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from hybridsurrogate.effects.base import UNIT_SD, Act, Cause, Context, FloatArray, Rows, Wrapped
from hybridsurrogate.effects.expressions import Code, Tables
from hybridsurrogate.exceptions import did_you_mean
from hybridsurrogate.priors import from_normal, frozen, to_normal
from hybridsurrogate.simulation.outputs import OUTPUT
from hybridsurrogate.types import Prior


@dataclass(eq=False, repr=False)
class InOutput(Wrapped):
    """A cause in one of several outputs; the others are as simulated.

    Parameters
    ----------
    cause : Cause
        One that does not move the simulation's inputs or parameters, of which all outputs follow.
    output : str
        The output concerned.
    position : int or None, default=None
        Which of the outputs it is; None: by its name.
    scale : float or None, default=None
        Its unit: that by which coefficients are multiplied in reports. None: its measured standard
        deviation.

    Raises
    ------
    ValueError
        When a model is fitted: for a cause that moves inputs or parameters, or an output that there
        is not.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> jump = hs.InOutput(hs.Step("t"), "flow", position=1)
    >>> rows = {"t": np.array([2.0, 2.0]), "output_of_row": np.array([0.0, 1.0])}
    >>> jump.columns(rows, {"location": np.ones(2)}).ravel().tolist()
    [0.0, 1.0]
    """

    cause: Cause
    output: str
    position: int | None = None
    scale: float | None = None

    def prepare(self, context: Context) -> Cause:
        """Prepare the cause for the rows of its output alone."""
        if self.output not in context.outputs:
            raise ValueError(
                f"There is no output {self.output!r} for the cause {self.cause.name!r}; there are "
                f"{', '.join(context.outputs) or 'none but one'}."
                f"{did_you_mean(self.output, context.outputs)}"
            )
        if "inputs" in self.cause.acts_on:
            raise ValueError(
                f"The cause {self.cause.name!r} changes the simulation itself, and so all outputs: "
                "give it without InOutput."
            )
        if self.cause.by_output:
            raise ValueError(
                f"{self.cause.name} goes by output itself: give it without InOutput, and its "
                f"numbers as {{{self.output!r}: ...}}."
            )
        position = context.outputs.index(self.output)
        own = self.cause.prepare(of_output(context, position))
        scale = context.of_outputs[position].scale if self.scale is None else self.scale
        return InOutput(own, self.output, position, scale)

    @property
    def target(self) -> str:  # type: ignore[override]
        """The output and, where there is one, the cause's target."""
        own = self.cause.target
        return f"{self.output}: {own}" if own else self.output

    @property
    def name(self) -> str:
        """That of the cause, and its output."""
        return f"{self.cause.name} in {self.output}"

    @property
    def inner(self) -> Cause:
        """The cause without its output."""
        return self.cause

    @property
    def unit_of_output(self) -> float:  # type: ignore[override]
        """The unit of the output."""
        return 1.0 if self.scale is None else self.scale

    def _here(self, X: Rows) -> NDArray[np.bool_]:
        return np.asarray(X[OUTPUT] == self.position)

    def gain(self, X: Rows, theta: Rows) -> FloatArray | float:
        """Return the cause's factor at rows of its output, 1 at others."""
        gain = np.asarray(self.cause.gain(X, theta))
        return np.where(self._here(X), gain, 1.0) if gain.ndim or gain != 1.0 else 1.0

    def response(
        self, simulated: FloatArray, X: Rows, theta: Rows
    ) -> tuple[FloatArray, FloatArray] | None:
        """Return what the cause makes of its output, the others as they are."""
        changed = self.cause.response(simulated, X, theta)
        if changed is None:
            return None
        here = self._here(X)
        return np.where(here, changed[0], simulated), np.where(here, changed[1], 1.0)

    def columns(self, X: Rows, theta: Rows) -> FloatArray | None:
        """Return the cause's columns at rows of its output, 0 at others."""
        columns = self.cause.columns(X, theta)
        return None if columns is None else columns * self._here(X)[:, None].astype(float)

    def factors(self, X: Rows, theta: Rows) -> tuple[FloatArray, FloatArray] | None:
        """Return the cause's factors, those of rows at rows of its output alone."""
        factors = self.cause.factors(X, theta)
        here = self._here(X)[:, None].astype(float)
        return None if factors is None else (factors[0] * here, factors[1])

    def noise(self, X: Rows, theta: Rows) -> FloatArray | float:
        """Return the cause's factor on the noise at rows of its output, 1 at others."""
        noise = np.asarray(self.cause.noise(X, theta))
        return np.where(self._here(X), noise, 1.0) if noise.ndim or noise != 1.0 else 1.0

    def leaves_out(self, X: Rows, y: FloatArray) -> None:
        """Return None: a row has other outputs, too."""

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return those of the cause, in the units of the output."""
        unit = self.unit_of_output
        own = {name: unit * values for name, values in coefficients.items()}
        # an amplitude that is not linear is that of a process
        theta = {k: unit * v if k == "amplitude" else v for k, v in theta.items()}
        return self.cause.estimates(theta, own)

    def code(self) -> Code | None:
        """Return that of the cause, for this output."""
        code = self.cause.code()
        if code is None:
            return None
        return replace(code, output=self.output, tables=code.tables and self._scaled(code.tables))

    def _scaled(self, tables: Tables) -> Tables:
        def scaled(theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
            found = tables(theta, coefficients)
            return {name: self.unit_of_output * values for name, values in found.items()}

        return scaled

    @property
    def acts_on(self) -> frozenset[Act]:
        """What the cause does to one output alone: not inputs, nor the scatter of all counts."""
        return self.cause.acts_on - {"inputs", "overdispersion"}


def of_output(context: Context, position: int) -> Context:
    """Return what a cause in one output may know: of its rows alone."""
    here = context.X[OUTPUT] == position
    own = context.of_outputs[position]
    return replace(
        of_all_outputs(context),
        X={name: values[here] for name, values in context.X.items() if name != OUTPUT},
        location=own.location,
        distance=own.distance,
        ratio=own.ratio,
        unit=own.scale,
    )


def of_all_outputs(context: Context) -> Context:
    """Return the context of a cause in all outputs: without the column that numbers the outputs."""
    rows = {name: values for name, values in context.X.items() if name != OUTPUT}
    return replace(context, X=rows, n_inputs=context.n_inputs - 1, outputs=(), of_outputs=())


def prepared_for(cause: Cause, context: Context) -> Cause:
    """Return a cause prepared for rows of one output or of several."""
    if cause.output is not None or cause.by_output or not context.outputs:
        return cause.prepare(context)
    return cause.prepare(of_all_outputs(context))


@dataclass(eq=False, repr=False)
class Sized(Wrapped):
    """A prepared cause, its coefficients and slopes in units of one unknown size.

    The size, the root mean square of what the cause changes over the measured rows, is log-uniform
    between two ends. Given the size, coefficients of columns are normal. So is the displacement of
    a parameter such as a gain from its neutral value, in standard normal coordinates and to first
    order, up to the width of the parameter's prior.

    Parameters
    ----------
    cause : Cause
        Prepared.
    low, high : float
        Ends of the size, on the scale of eta.
    rows : dict of name to ndarray of shape (n,)
        Measured rows.
    slopes : sequence of float
        Root mean square of the output's slope along each of ``cause.start()``, in standard normal
        coordinates.
    """

    factorises = False

    cause: Cause
    low: float
    high: float
    rows: Rows
    slopes: tuple[float, ...] = ()

    coefficient_sd = UNIT_SD
    hierarchy = None

    @property
    def parameters(self) -> Mapping[str, Prior]:  # type: ignore[override]
        """Those of the cause, displacements in units of the size, and the size."""
        normal = frozen(stats.norm)
        own = {k: normal if k in self._neutral else p for k, p in self.cause.parameters.items()}
        return {**own, "size": frozen(stats.loguniform, self.low, self.high)}

    @property
    def _neutral(self) -> dict[str, float]:
        """Standard normal coordinates at which the cause changes nothing."""
        start = self.cause.start()
        return {k: float(to_normal([self.cause.parameters[k]], [v])[0]) for k, v in start.items()}

    def _own(self, theta: Rows) -> dict[str, FloatArray]:
        own = {name: theta[name] for name in self.cause.parameters}
        for slope, (name, neutral) in zip(self.slopes, self._neutral.items(), strict=True):
            reach = np.minimum(theta["size"] / slope, 1.0)
            z = neutral + reach * theta[name]
            own[name] = from_normal([self.cause.parameters[name]], z[:, None])[:, 0]
        return own

    def inputs(self, X: Rows, omega: Rows, theta: Rows) -> tuple[Rows, Rows]:
        """Return those of the cause."""
        return self.cause.inputs(X, omega, self._own(theta))

    def gain(self, X: Rows, theta: Rows) -> FloatArray | float:
        """Return that of the cause."""
        return self.cause.gain(X, self._own(theta))

    def response(
        self, simulated: FloatArray, X: Rows, theta: Rows
    ) -> tuple[FloatArray, FloatArray] | None:
        """Return what the cause makes of the output."""
        return self.cause.response(simulated, X, self._own(theta))

    def noise(self, X: Rows, theta: Rows) -> FloatArray | float:
        """Return that of the cause."""
        return self.cause.noise(X, self._own(theta))

    def start(self) -> dict[str, float]:
        """Return nothing: displacements are in units of the size."""
        return {}

    def grid(self) -> dict[str, FloatArray]:
        """Return quantiles of the priors in these units."""
        return Cause.grid(self)

    def rows_of(self, X: Rows) -> dict[str, NDArray[np.bool_]]:
        """Return nothing: the size concerns all rows."""
        return {}

    def columns(self, X: Rows, theta: Rows) -> FloatArray | None:
        """Return the cause's columns in units of the size."""
        own = self._own(theta)
        columns = self.cause.columns(X, own)
        if columns is None:
            return None
        # theta is the same in all rows of a draw, and draws come one after the other
        size, m = theta["size"], len(next(iter(self.rows.values())))
        first = np.concatenate([[True], np.any([v[1:] != v[:-1] for v in theta.values()], axis=0)])
        draw = np.cumsum(first) - 1
        J = int(draw[-1]) + 1
        rows = {name: np.tile(values, J) for name, values in self.rows.items()}
        once = {name: np.repeat(np.asarray(values)[first], m) for name, values in own.items()}
        measured = self.cause.columns(rows, once)
        assert measured is not None
        mean_square = np.mean(measured.reshape(J, m, -1) ** 2, axis=1)
        if self.cause.is_process:
            mean_square = np.sum(mean_square, axis=1, keepdims=True)
        rms = np.sqrt(np.maximum(mean_square, np.finfo(float).tiny))
        return columns * (size[:, None] / rms[draw])
