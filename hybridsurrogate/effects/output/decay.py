"""A transient that dies away."""

from __future__ import annotations

import numpy as np
from scipy import stats

from hybridsurrogate.effects.axis import UNKNOWN, Axis
from hybridsurrogate.effects.base import Cause, Context, FloatArray, Rows
from hybridsurrogate.effects.code import Code
from hybridsurrogate.effects.over_column import FromOrigin
from hybridsurrogate.effects.registry import Form, over_inputs, register
from hybridsurrogate.priors import frozen
from hybridsurrogate.types import Prior


class Decay(FromOrigin):
    """A deviation at the beginning that dies away, such as an instrument that warms up.

    ``simulation + amplitude exp(-(x - origin) / scale)``: first-order relaxation from the first
    measured row on, and the full amplitude before it. The amplitude is in units of the output, the
    scale (after which 37 % remains) in units of the column. The scale is log-uniform between two
    distances of neighbouring rows and the measured span.

    Parameters
    ----------
    column : str
        Any measured column.
    scale : frozen scipy.stats distribution or None, default=None
        Prior of the scale; positive.
    origin : float or None, default=None
        Where the amplitude is meant. None: the smallest measured value.
    axis : Axis
        Where the measured rows lie; `prepare` looks.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> decay = hs.Decay("t", origin=1.0)
    >>> decay.columns({"t": np.array([1.0, 3.0])}, {"scale": 2.0}).round(3).ravel().tolist()
    [1.0, 0.368]
    """

    kind = "decay"
    coefficients = ("amplitude",)
    unknowns = ("scale",)

    def __init__(
        self,
        column: str,
        scale: Prior | None = None,
        origin: float | None = None,
        axis: Axis = UNKNOWN,
    ):
        super().__init__(column, origin, axis)
        self.scale = scale

    def prepare(self, context: Context) -> Cause:
        """Fill in origin and prior from the measured rows."""
        axis = self.along(context)
        shortest = min(2 * axis.spacing, 0.5 * axis.span)
        scale = self.scale or frozen(stats.loguniform, shortest, axis.span)
        return self.filled(axis=axis, scale=scale)

    def columns(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the share that remains."""
        return np.exp(-self.distance(X) / theta["scale"])[:, None]

    def code(self) -> Code:
        """Return the cause as Python."""
        return Code(
            "{amplitude} * np.exp(-np.maximum({x} - {origin}, 0) / {scale})",
            {"amplitude": "{y}", "scale": "{x}"},
            {"x": self.column},
            {"origin": self.pivot},
        )


register(
    Form(
        "decay",
        Decay,
        over_inputs(Decay),
        meaning="a gap at the start of {column} dies away",
        least_distinct=6,
        like=("saturation", "bump"),
        headline=(
            "{output} starts {amplitude:size} {amplitude:above|below} the "
            "simulation, and the gap dies away over {scale}"
        ),
        formula="eta + amplitude exp(-(x - origin) / scale); origin: smallest measured x",
        priors="scale: log-uniform, 2 spacings to the span",
        estimates="amplitude, scale",
        left_out="fewer than 6 distinct values",
    )
)
