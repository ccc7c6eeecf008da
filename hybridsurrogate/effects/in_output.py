"""A cause that concerns one of several outputs: a biased sensor, a noisy one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.effects.base import Act, Cause, Context, FloatArray, Rows, Wrapped
from hybridsurrogate.effects.code import Code, Tables
from hybridsurrogate.exceptions import did_you_mean
from hybridsurrogate.simulation.outputs import OUTPUT


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

    def __init__(
        self,
        cause: Cause,
        output: str,
        position: int | None = None,
        scale: float | None = None,
    ):
        super().__init__(cause)
        self.output: str = output
        self.position = position
        self.scale = scale

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
    def unit_of_output(self) -> float:
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
    rows = {name: values[here] for name, values in context.X.items() if name != OUTPUT}
    own = context.of_outputs[position]
    return replace(
        context,
        X=rows,
        n_inputs=context.n_inputs - 1,
        outputs=(),
        of_outputs=(),
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
    if cause.output is not None or not context.outputs:
        return cause.prepare(context)
    return cause.prepare(of_all_outputs(context))
