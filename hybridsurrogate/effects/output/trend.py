"""A trend over one column."""

from __future__ import annotations

import numpy as np

from hybridsurrogate.effects.axis import UNKNOWN, Axis
from hybridsurrogate.effects.base import Cause, Context, FloatArray, Rows
from hybridsurrogate.effects.code import Code
from hybridsurrogate.effects.over_column import FromOrigin, OverColumn
from hybridsurrogate.effects.registry import Form, over_inputs, register


class Trend(OverColumn):
    """A straight line or a parabola over a column, with a level.

    ``simulation + level + slope (x - center) + curvature (x - center)^2``, the last term only with
    ``degree=2``. Level, slope and curvature are in units of the output, of the output per unit of
    the column, and per squared unit. The coefficients belong to Legendre's polynomials 1, u and
    (3 u^2 - 1) / 2 of the column scaled to u in [-1, 1], which hardly overlap on evenly spread rows
    (DLMF 18.3).

    Parameters
    ----------
    column : str
        Any measured column.
    degree : {1, 2}, default=1
    axis : Axis
        Where the measured rows lie, which are scaled to [-1, 1]; `prepare` looks.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> from hybridsurrogate.effects.axis import Axis
    >>> line = hs.Trend("t", axis=Axis.of([0.0, 10.0]))
    >>> line.columns({"t": np.array([0.0, 5.0, 10.0])}, {}).tolist()
    [[1.0, -1.0], [1.0, 0.0], [1.0, 1.0]]
    """

    kind = "trend"

    def __init__(self, column: str, degree: int = 1, axis: Axis = UNKNOWN):
        super().__init__(column, axis)
        self.degree = degree

    @property
    def variant(self) -> str:
        """Quadratic, or plain."""
        return "quadratic" if self.degree == 2 else ""

    @property
    def coefficients(self) -> tuple[str, ...]:  # type: ignore[override]
        """Level and slope, and the curvature of a parabola."""
        return ("level", "slope", "curvature")[: self.degree + 1]

    def prepare(self, context: Context) -> Cause:
        """Fill in the middle and the span of the column from the measured rows."""
        if self.degree not in (1, 2):
            raise ValueError(f"The degree of a trend is 1 or 2, got {self.degree!r}.")
        return super().prepare(context)

    def columns(self, X: Rows, theta: Rows) -> FloatArray:
        """Return ones, the column scaled to [-1, 1], and Legendre's parabola of it."""
        scaled = self.scaled(X)
        terms = [np.ones_like(scaled), scaled, 1.5 * scaled**2 - 0.5]
        return np.stack(terms[: self.degree + 1], axis=-1)

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return the slope per unit of the column, and the level, both in the middle."""
        out = {
            "slope": 2 * coefficients["slope"] / self.axis.span,
            "level": np.asarray(coefficients["level"]),
        }
        if self.degree == 2:
            out["level"] = coefficients["level"] - 0.5 * coefficients["curvature"]
            out["curvature"] = 6 * coefficients["curvature"] / self.axis.span**2
        return out

    def code(self) -> Code:
        """Return the cause as Python."""
        line = "{level} + {slope} * ({x} - {center})"
        numbers = {"slope": "{y} / {x}", "level": "{y}"}
        if self.degree == 2:
            line += " + {curvature} * ({x} - {center}) ** 2"
            numbers["curvature"] = "{y} / {x}^2"
        return Code(line, numbers, {"x": self.column}, {"center": self.pivot})


class TrendSinceStart(FromOrigin):
    """A straight line that is zero where the measurements begin: a sensor set once, then adrift.

    ``simulation + slope max(x - origin, 0)``, the slope in units of the output per unit of the
    column.

    Parameters
    ----------
    column : str
        Any measured column.
    origin : float or None, default=None
        Where the simulation is right. None: at the first of the measured rows.
    axis : Axis
        Where the measured rows lie; `prepare` looks.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> from hybridsurrogate.effects.axis import Axis
    >>> line = hs.TrendSinceStart("t", origin=2.0, axis=Axis.of([2.0, 12.0]))
    >>> line.columns({"t": np.array([2.0, 7.0])}, {}).ravel().tolist()
    [0.0, 0.5]
    """

    kind = "trend"
    coefficients = ("slope",)

    @property
    def variant(self) -> str:
        """The name of this form, which has no level, unlike a trend."""
        return "since the start"

    def columns(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the distance from the start, in spans of the measured rows."""
        return (self.distance(X) / self.axis.span)[:, None]

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return the slope per unit of the column."""
        return {"slope": coefficients["slope"] / self.axis.span}

    def code(self) -> Code:
        """Return the cause as Python."""
        return Code(
            "{slope} * np.maximum({x} - {origin}, 0)",
            {"slope": "{y} / {x}"},
            {"x": self.column},
            {"origin": self.pivot},
        )


register(
    Form(
        "trend",
        Trend,
        over_inputs(Trend),
        meaning="the gap between measured and simulated {output} grows steadily over {column}",
        least_distinct=3,
        like=("ramp", "saturation", "parameter-drift"),
        headline="{output} {slope:rises|falls} against the simulation by {slope:size}",
        formula="eta + level + slope (x - center)",
        estimates="slope, level",
        left_out="x has fewer than 3 distinct values",
    )
)
register(
    Form(
        "trend: quadratic",
        Trend,
        over_inputs(lambda column: Trend(column, degree=2)),
        meaning="the gap between measured and simulated {output} is a parabola over {column}",
        least_distinct=4,
        like=("ramp", "bump"),
        headline="The gap between {output} and the simulation is a parabola over {column}",
        call="`Trend(x, degree=2)`",
        formula="... + curvature (x - center)²",
        estimates="slope, level, curvature",
        left_out="fewer than 4 distinct values",
    )
)
register(
    Form(
        "trend: since the start",
        TrendSinceStart,
        over_inputs(TrendSinceStart),
        meaning="the gap between measured and simulated {output} is nothing at the first {column} "
        "and grows steadily from there",
        least_distinct=3,
        formula="eta + slope (x - first)",
        estimates="slope",
        left_out="x has fewer than 3 distinct values",
    )
)
