"""A deviation that grows and levels off."""

from __future__ import annotations

from collections.abc import Mapping

from scipy import stats

from hybridsurrogate.effects.base import Cause, Context, FloatArray, Rows
from hybridsurrogate.effects.code import Code
from hybridsurrogate.effects.over_column import FromOrigin, span_and_spacing
from hybridsurrogate.effects.registry import Form, over_inputs, register
from hybridsurrogate.priors import frozen, prior_sd
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

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> filling = hs.Saturation("dose", origin=0.0)
    >>> filling.columns({"dose": np.array([0.0, 2.0, 6.0])}, {"half": 2.0}).ravel().tolist()
    [0.0, 0.5, 0.75]
    """

    kind = "saturation"
    coefficients = ("amplitude",)

    def __init__(self, column: str, half: Prior | None = None, origin: float | None = None):
        super().__init__(column, origin)
        self.half = half

    @property
    def parameters(self) -> Mapping[str, Prior]:  # type: ignore[override]
        """The prior of the place where half is reached."""
        return {"half": self.half}

    def prepare(self, context: Context) -> Cause:
        """Fill in origin and prior from the measured rows."""
        prepared = super().prepare(context)
        if self.half is None:
            span, spacing = span_and_spacing(context.column(self.column))
            prepared.half = frozen(
                stats.loguniform, min(spacing, 0.5 * span), span, loc=prepared.origin
            )
        return prepared

    def columns(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the share that is reached."""
        assert self.origin is not None
        u = self.distance(X)
        return (u / (u + (theta["half"] - self.origin)))[:, None]

    @property
    def extents(self) -> Mapping[str, float]:
        """How far it reaches along the column."""
        return {} if self.half is None else {self.column: prior_sd(self.half)}

    def code(self) -> Code:
        """Return the cause as Python."""
        assert self.origin is not None
        return Code(
            "{amplitude} * {beyond} / ({beyond} + ({half} - {origin}))",
            {"amplitude": "{y}", "half": "{x}"},
            {"x": self.column},
            {"origin": self.origin},
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
        call="`Saturation(x)`",
        formula="eta + amplitude (x - origin) / ((x - origin) + (half - origin))",
        priors="half - origin: log-uniform, one spacing to the span",
        estimates="amplitude, half (where half of it is reached)",
        left_out="fewer than 6 distinct values",
    )
)
