"""A transient that dies away."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import stats

from hybridsurrogate.effects.base import Cause, Context, FloatArray, Rows
from hybridsurrogate.effects.code import Code
from hybridsurrogate.effects.over_column import FromOrigin, span_and_spacing
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

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> decay = hs.Decay("t", origin=1.0)
    >>> decay.columns({"t": np.array([1.0, 3.0])}, {"scale": 2.0}).round(3).ravel().tolist()
    [1.0, 0.368]
    """

    kind = "decay"
    coefficients = ("amplitude",)

    def __init__(self, column: str, scale: Prior | None = None, origin: float | None = None):
        super().__init__(column, origin)
        self.scale = scale

    @property
    def parameters(self) -> Mapping[str, Prior]:  # type: ignore[override]
        """The prior of the scale."""
        return {"scale": self.scale}

    def prepare(self, context: Context) -> Cause:
        """Fill in origin and prior from the measured rows."""
        prepared = super().prepare(context)
        if self.scale is None:
            span, spacing = span_and_spacing(context.column(self.column))
            prepared.scale = frozen(stats.loguniform, min(2 * spacing, 0.5 * span), span)
        return prepared

    def columns(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the share that remains."""
        return np.exp(-self.distance(X) / theta["scale"])[:, None]

    @property
    def extents(self) -> Mapping[str, float]:
        """How far it reaches along the column."""
        return {} if self.scale is None else {self.column: float(self.scale.median())}

    def code(self) -> Code:
        """Return the cause as Python."""
        assert self.origin is not None
        return Code(
            "{amplitude} * np.exp(-np.maximum({x} - {origin}, 0) / {scale})",
            {"amplitude": "{y}", "scale": "{x}"},
            {"x": self.column},
            {"origin": self.origin},
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
        call="`Decay(x)`",
        formula="eta + amplitude exp(-(x - origin) / scale); origin: smallest measured x",
        priors="scale: log-uniform, 2 spacings to the span",
        estimates="amplitude, scale",
        left_out="fewer than 6 distinct values",
    )
)
