"""A deviation that grows and levels off."""

from __future__ import annotations

from scipy import stats

from hybridsurrogate.effects.axis import UNKNOWN, Axis
from hybridsurrogate.effects.base import Cause, Context, FloatArray, Rows
from hybridsurrogate.effects.code import Code
from hybridsurrogate.effects.over_column import FromOrigin
from hybridsurrogate.effects.registry import Form, over_inputs, register
from hybridsurrogate.priors import frozen
from hybridsurrogate.types import Prior


class Saturation(FromOrigin):
    """A deviation that grows over a column and levels off, such as binding sites that fill up.

    ``simulation + amplitude u / (u + half - origin)`` with u = x - origin (zero before it): the
    rate law of Michaelis and Menten (1913, Biochemische Zeitschrift 49:333). The amplitude is what
    is reached in the end, in units of the output; ``half`` is the place in units of the column at
    which half of it is reached. Its distance from the origin is log-uniform between one distance
    of neighbouring rows and the measured span.

    Parameters
    ----------
    column : str
        Any measured column.
    half : frozen scipy.stats distribution or None, default=None
        Prior of the place where half is reached; above the origin.
    origin : float or None, default=None
        Where the deviation begins. None: the smallest measured value.
    axis : Axis
        Where the measured rows lie; `prepare` looks.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> filling = hs.Saturation("dose", origin=0.0)
    >>> filling.columns({"dose": np.array([0.0, 2.0, 6.0])}, {"half": 2.0}).ravel().tolist()
    [0.0, 0.5, 0.75]
    """

    kind = "saturation"
    coefficients = ("amplitude",)
    unknowns = ("half",)

    def __init__(
        self,
        column: str,
        half: Prior | None = None,
        origin: float | None = None,
        axis: Axis = UNKNOWN,
    ):
        super().__init__(column, origin, axis)
        self.half = half

    def prepare(self, context: Context) -> Cause:
        """Fill in origin and prior from the measured rows."""
        axis = self.along(context)
        begin = axis.origin if self.origin is None else self.origin
        shortest = min(axis.spacing, 0.5 * axis.span)
        half = self.half or frozen(stats.loguniform, shortest, axis.span, loc=begin)
        return self.filled(axis=axis, half=half)

    def columns(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the share that is reached."""
        u = self.distance(X)
        return (u / (u + (theta["half"] - self.pivot)))[:, None]

    def code(self) -> Code:
        """Return the cause as Python."""
        return Code(
            "{amplitude} * {beyond} / ({beyond} + ({half} - {origin}))",
            {"amplitude": "{y}", "half": "{x}"},
            {"x": self.column},
            {"origin": self.pivot},
            steps={"beyond": "np.maximum({x} - {origin}, 0)"},
        )


register(
    Form(
        "saturation",
        Saturation,
        over_inputs(Saturation),
        meaning="a gap grows over {column} and levels off",
        least_distinct=6,
        like=("trend", "decay"),
        headline=(
            "{output} {amplitude:rises above|falls below} the simulation over "
            "{column} and levels off"
        ),
        formula="eta + amplitude (x - origin) / ((x - origin) + (half - origin))",
        priors="half - origin: log-uniform, one spacing to the span",
        estimates="amplitude, half (where half of it is reached)",
        left_out="fewer than 6 distinct values",
    )
)
