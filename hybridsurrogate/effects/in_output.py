"""A cause that concerns one of several outputs: a biased sensor, a noisy one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from hybridsurrogate.effects.base import Cause, Context, FloatArray, Rows
from hybridsurrogate.effects.code import Code
from hybridsurrogate.exceptions import did_you_mean
from hybridsurrogate.simulation.outputs import OUTPUT
from hybridsurrogate.types import Prior


class InOutput(Cause):
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
        self.cause = cause
        self.output = output
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
        if self.cause.moves_inputs:
            raise ValueError(
                f"The cause {self.cause.name!r} changes the simulation itself, and so all outputs: "
                "give it without InOutput."
            )
        position = context.outputs.index(self.output)
        own = self.cause.prepare(of_output(context, position))
        scale = context.of_outputs[position].scale if self.scale is None else self.scale
        return InOutput(own, self.output, position, scale)

    @property
    def kind(self) -> str:  # type: ignore[override]
        """That of the cause."""
        return self.cause.kind

    @property
    def target(self) -> str:  # type: ignore[override]
        """The output and, where there is one, the cause's target."""
        own = self.cause.target
        return f"{self.output}: {own}" if own else self.output

    @property
    def variant(self) -> str:
        """That of the cause."""
        return self.cause.variant

    @property
    def meaning(self) -> str | None:  # type: ignore[override]
        """That of the cause."""
        return self.cause.meaning

    @property
    def parameters(self) -> Mapping[str, Prior]:  # type: ignore[override]
        """Those of the cause."""
        return self.cause.parameters

    @property
    def coefficients(self) -> tuple[str, ...]:  # type: ignore[override]
        """Those of the cause."""
        return self.cause.coefficients

    @property
    def coefficient_sd(self) -> float | None:  # type: ignore[override]
        """That of the cause."""
        return self.cause.coefficient_sd

    @property
    def is_process(self) -> bool:  # type: ignore[override]
        """As the cause."""
        return self.cause.is_process

    @property
    def is_one_level(self) -> bool:  # type: ignore[override]
        """As the cause."""
        return self.cause.is_one_level

    @property
    def is_learned(self) -> bool:  # type: ignore[override]
        """As the cause."""
        return self.cause.is_learned

    @property
    def follows_mean(self) -> bool:  # type: ignore[override]
        """As the cause."""
        return self.cause.follows_mean

    def _here(self, X: Rows) -> FloatArray:
        here: FloatArray = (X[OUTPUT] == self.position).astype(float)
        return here

    def gain(self, X: Rows, theta: Rows) -> FloatArray | float:
        """Return the cause's factor at rows of its output, 1 at others."""
        gain = np.asarray(self.cause.gain(X, theta))
        return np.where(self._here(X) > 0, gain, 1.0) if gain.ndim or gain != 1.0 else 1.0

    def response(
        self, simulated: FloatArray, X: Rows, theta: Rows
    ) -> tuple[FloatArray, FloatArray] | None:
        """Return what the cause makes of its output, the others as they are."""
        changed = self.cause.response(simulated, X, theta)
        if changed is None:
            return None
        here = self._here(X) > 0
        return np.where(here, changed[0], simulated), np.where(here, changed[1], 1.0)

    def columns(self, X: Rows, theta: Rows) -> FloatArray | None:
        """Return the cause's columns at rows of its output, 0 at others."""
        columns = self.cause.columns(X, theta)
        return None if columns is None else columns * self._here(X)[:, None]

    def factors(self, X: Rows, theta: Rows) -> tuple[FloatArray, FloatArray] | None:
        """Return the cause's factors, those of rows at rows of its output alone."""
        factors = self.cause.factors(X, theta)
        return None if factors is None else (factors[0] * self._here(X)[:, None], factors[1])

    def noise(self, X: Rows, theta: Rows) -> FloatArray | float:
        """Return the cause's factor on the noise at rows of its output, 1 at others."""
        noise = np.asarray(self.cause.noise(X, theta))
        return np.where(self._here(X) > 0, noise, 1.0) if noise.ndim or noise != 1.0 else 1.0

    def outliers(self, theta: Rows) -> FloatArray | float:
        """Return that of the cause."""
        return self.cause.outliers(theta)

    def grid(self) -> dict[str, FloatArray]:
        """Return that of the cause."""
        return self.cause.grid()

    def start(self) -> dict[str, float]:
        """Return that of the cause."""
        return self.cause.start()

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return those of the cause, in the units of the output."""
        scale = 1.0 if self.scale is None else self.scale
        own = {name: scale * values for name, values in coefficients.items()}
        # an amplitude that is not linear is that of a process
        theta = {k: scale * v if k == "amplitude" else v for k, v in theta.items()}
        return self.cause.estimates(theta, own)

    def code(self) -> Code | None:
        """Return that of the cause, for this output."""
        code = self.cause.code()
        if code is None:
            return None
        tables, scale = code.tables, 1.0 if self.scale is None else self.scale

        def scaled(theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
            assert tables is not None
            found = tables(theta, coefficients)
            return {name: scale * values for name, values in found.items()}

        return replace(code, output=self.output, tables=scaled if tables else None)

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        return self.cause.formula(values)

    def latex(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in LaTeX."""
        return self.cause.latex(values)

    @property
    def reads(self) -> tuple[str, ...]:
        """Those of the cause."""
        return self.cause.reads

    @property
    def moves_inputs(self) -> bool:
        """None: it would move all outputs."""
        return False

    @property
    def touches_simulation(self) -> bool:
        """As the cause."""
        return self.cause.touches_simulation

    @property
    def responds(self) -> bool:
        """As the cause."""
        return self.cause.responds

    @property
    def bends(self) -> bool:
        """As the cause."""
        return self.cause.bends

    @property
    def factorises(self) -> bool:
        """As the cause."""
        return self.cause.factorises

    @property
    def concerns(self) -> str:
        """As the cause."""
        return self.cause.concerns

    @property
    def changes_output(self) -> bool:
        """As the cause."""
        return self.cause.changes_output

    @property
    def name(self) -> str:
        """That of the cause, and its output."""
        return f"{self.cause.name} in {self.output}"

    @property
    def touches_noise(self) -> bool:
        """As the cause."""
        return self.cause.touches_noise

    @property
    def has_outliers(self) -> bool:
        """As the cause."""
        return self.cause.has_outliers


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
    if isinstance(cause, InOutput) or not context.outputs:
        return cause.prepare(context)
    return cause.prepare(of_all_outputs(context))
