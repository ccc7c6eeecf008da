"""Constants, trends and products of columns that add to the output."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import ClassVar

import numpy as np

from hybridsurrogate.effects.base import Cause, Context, Declared, FloatArray, Forms, Rows
from hybridsurrogate.effects.context import UNKNOWN, Axis
from hybridsurrogate.effects.expressions import Code
from hybridsurrogate.effects.inputs import at_levels
from hybridsurrogate.effects.over_column import AtLevel, FromOrigin, OverColumn
from hybridsurrogate.effects.registry import Form, needs, over_inputs, register


@dataclass(eq=False, repr=False)
class Interaction(Declared):
    """A product of two columns that the simulation lacks: one changes what the other does.

    ``simulation + slope (x1 - center_1) (x2 - center_2)``, the slope in units of the output per
    unit of the product. The simulation describes the main effects: it is right where either column
    is in its middle, or at zero with ``centers=(0.0, 0.0)``.

    Parameters
    ----------
    first, second : str
        Two different measured columns.
    centers : (float, float) or None, default=None
        Where the simulation is right. None: in the middle of the measured rows.
    axes : (Axis, Axis)
        Where the measured rows lie; `prepare` looks.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> from hybridsurrogate.effects.context import Axis
    >>> both = hs.Interaction("t", "dose", axes=(Axis.of([0.0, 2.0]), Axis.of([-1.0, 3.0])))
    >>> rows = {"t": np.array([0.0, 2.0]), "dose": np.array([3.0, 3.0])}
    >>> both.columns(rows, {}).ravel().tolist()
    [-1.0, 1.0]
    """

    kind = "interaction"
    forms: ClassVar[Forms] = {("centers", (0.0, 0.0)): "from zero"}
    coefficients = ("slope",)

    first: str
    second: str
    centers: tuple[float, float] | None = None
    axes: tuple[Axis, Axis] = (UNKNOWN, UNKNOWN)

    @property
    def target(self) -> str:  # type: ignore[override]
        """Both columns."""
        return f"{self.first} * {self.second}"

    @property
    def reads(self) -> tuple[str, ...]:
        """Both columns."""
        return (self.first, self.second)

    @property
    def pivots(self) -> tuple[float, float]:
        """The places from which it counts."""
        first, second = self.axes
        return self.centers or (first.center, second.center)

    def prepare(self, context: Context) -> Cause:
        """Look where the measured rows lie along both columns."""
        if self.first == self.second:
            raise ValueError(
                f"An interaction needs two different columns, got {self.first!r} twice: a square "
                "is Trend(column, degree=2)."
            )
        known = all(axis.is_known for axis in self.axes)
        measured = (context.axis(self.first), context.axis(self.second))
        return self.filled(axes=self.axes if known else measured)

    def columns(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the product of the columns, each scaled to [-1, 1]."""
        u, v = (
            2 * (X[name] - pivot) / axis.span
            for name, pivot, axis in zip(self.reads, self.pivots, self.axes, strict=True)
        )
        return (u * v)[:, None]

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return the slope per unit of the product."""
        return {"slope": 4 * coefficients["slope"] / (self.axes[0].span * self.axes[1].span)}

    @property
    def extents(self) -> Mapping[str, float]:
        """How far the measured rows reach along both."""
        return {name: axis.span for name, axis in zip(self.reads, self.axes, strict=True)}

    def code(self) -> Code:
        """Return the cause as Python."""
        return Code(
            "{slope} * ({first} - {first_center}) * ({second} - {second_center})",
            {"slope": "{y} / ({first} {second})"},
            {"first": self.first, "second": self.second},
            dict(zip(("first_center", "second_center"), self.pivots, strict=True)),
        )


register(
    Form(
        "interaction",
        Interaction,
        lambda context: (Interaction(*pair) for pair in combinations(context.inputs, 2)),
        meaning="the columns {target} act together, which the simulation ignores",
        lacking=needs(
            lambda context: len(context.inputs) > 1,
            "a product needs two inputs, the simulation has one",
        ),
        headline="The simulation misses that {target} act together on {output}",
    ),
    Form(
        "interaction: from zero",
        Interaction,
        lambda context: (
            Interaction(*pair, centers=(0.0, 0.0))
            for pair in combinations(context.inputs, 2)
            if all(map(context.begins_at_zero, pair))
        ),
    ),
)


@dataclass(eq=False, repr=False)
class Offset(AtLevel):
    """A constant added to the simulation, such as a zero error of the instrument.

    - ``simulation + amplitude``, in the units of the output. On a logarithmic scale of the output a
      constant is a factor: `Gain`;
    - ``Offset("sensor", level=2)``: ``simulation + amplitude`` where an input of few values is 2,
      and the simulation as it is elsewhere: one of several sensors, or one standard of a
      calibration. Where the simulation ignores the column it is `MissingInput` with a level.

    Parameters
    ----------
    column : str or None, default=None
        An input of the simulation with few values.
    level : float or None, default=None
        The value at which the output is off; given with ``column``.
    sd : float or None, default=None
        Standard deviation of the amplitude's prior, which has mean zero. None: three times the
        spread of the measured output; everywhere, a third of the distance of its mean from the
        simulation's at the medians of the priors where that is more, as if units were mistaken.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> hs.Offset().columns({"t": np.array([0.0, 4.0])}, {}).tolist()
    [[1.0], [1.0]]
    >>> hs.Offset("sensor", level=2).columns({"sensor": np.array([1.0, 2.0])}, {}).tolist()
    [[0.0], [1.0]]
    """

    kind = "offset"
    coefficients = ("amplitude",)

    column: str | None = None
    level: float | None = None
    sd: float | None = None

    @property
    def coefficient_sd(self) -> float | None:  # type: ignore[override]
        """Standard deviation of the amplitude's prior."""
        return self.sd

    def prepare(self, context: Context) -> Cause:
        """Look for the level among the measured rows, or choose the size of the prior."""
        if (self.column is None) != (self.level is None):
            raise ValueError(
                f"column={self.column!r}, level={self.level!r}: an offset at one level needs both, "
                "one everywhere neither."
            )
        if self.level is None:
            return self if self.sd is not None else self.filled(sd=context.sd_of_shift)
        context.level(str(self.column), self.level)
        return self

    def columns(self, X: Rows, theta: Rows) -> FloatArray:
        """Return a column of ones, or one where the level is."""
        if self.level is None:
            return np.ones((len(next(iter(X.values()))), 1))
        return self.here(X).astype(float)[:, None]

    def code(self) -> Code:
        """Return the cause as Python."""
        if self.level is None:
            return Code("{amplitude}", {"amplitude": "{y}"})
        return self.code_at_level("{amplitude} * ({x} == {level})", {"amplitude": "{y}"})


register(
    Form(
        "offset",
        Offset,
        lambda context: [Offset()],
        meaning="{output} is measured higher or lower than simulated by the same amount everywhere",
        trouble=lambda cause, context: (
            "on a logarithmic scale a constant is a factor, compared as gain"
            if cause.target is None and context.log_scale
            else None
        ),
        headline="{output} is {amplitude:size} {amplitude:above|below} the simulation everywhere",
    ),
    Form(
        "offset: level",
        Offset,
        # sensors side by side, or the standards of a calibration
        lambda context: at_levels(Offset, context, context.inputs),
        meaning="{output} is off where {target} has one of its values",
        headline=(
            "{output} is {amplitude:size} {amplitude:above|below} the simulation "
            "where {target} is {level}"
        ),
    ),
)


@dataclass(eq=False, repr=False)
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
    >>> from hybridsurrogate.effects.context import Axis
    >>> line = hs.Trend("t", axis=Axis.of([0.0, 10.0]))
    >>> line.columns({"t": np.array([0.0, 5.0, 10.0])}, {}).tolist()
    [[1.0, -1.0], [1.0, 0.0], [1.0, 1.0]]
    """

    kind = "trend"
    forms: ClassVar[Forms] = {("degree", 2): "quadratic"}

    column: str
    degree: int = 1
    axis: Axis = UNKNOWN

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
    >>> from hybridsurrogate.effects.context import Axis
    >>> line = hs.TrendSinceStart("t", origin=2.0, axis=Axis.of([2.0, 12.0]))
    >>> line.columns({"t": np.array([2.0, 7.0])}, {}).ravel().tolist()
    [0.0, 0.5]
    """

    kind = "trend"
    coefficients = ("slope",)
    variant = "since the start"
    expression = "{slope} * np.maximum({x} - {origin}, 0)"
    units: ClassVar[Mapping[str, str]] = {"slope": "{y} / {x}"}

    def columns(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the distance from the start, in spans of the measured rows."""
        return (self.distance(X) / self.axis.span)[:, None]

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return the slope per unit of the column."""
        return {"slope": coefficients["slope"] / self.axis.span}


register(
    Form(
        "trend",
        Trend,
        over_inputs(Trend),
        meaning="the gap between measured and simulated {output} grows steadily over {column}",
        least_distinct=3,
        headline="{output} {slope:rises|falls} against the simulation by {slope:size}",
    ),
    Form(
        "trend: quadratic",
        Trend,
        over_inputs(lambda column: Trend(column, degree=2)),
        meaning="the gap between measured and simulated {output} is a parabola over {column}",
        least_distinct=4,
        headline="The gap between {output} and the simulation is a parabola over {column}",
    ),
    Form(
        "trend: since the start",
        TrendSinceStart,
        over_inputs(TrendSinceStart),
        meaning=(
            "the gap between measured and simulated {output} is nothing at the first {column} "
            "and grows steadily from there"
        ),
        least_distinct=3,
    ),
)
