"""Two columns that act together."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import combinations

from hybridsurrogate.effects.axis import UNKNOWN, Axis
from hybridsurrogate.effects.base import Cause, Context, Declared, FloatArray, Rows
from hybridsurrogate.effects.code import Code
from hybridsurrogate.effects.registry import Form, register


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
    >>> from hybridsurrogate.effects.axis import Axis
    >>> both = hs.Interaction("t", "dose", axes=(Axis.of([0.0, 2.0]), Axis.of([-1.0, 3.0])))
    >>> rows = {"t": np.array([0.0, 2.0]), "dose": np.array([3.0, 3.0])}
    >>> both.columns(rows, {}).ravel().tolist()
    [-1.0, 1.0]
    """

    kind = "interaction"
    coefficients = ("slope",)

    def __init__(
        self,
        first: str,
        second: str,
        centers: tuple[float, float] | None = None,
        axes: tuple[Axis, Axis] = (UNKNOWN, UNKNOWN),
    ):
        self.first = first
        self.second = second
        self.centers = centers
        self.axes = axes

    @property
    def variant(self) -> str:
        """Whether the product is one of the columns as they are."""
        return "from zero" if self.centers == (0.0, 0.0) else ""

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


def _of_pairs(context: Context) -> Iterator[Cause]:
    return (Interaction(*pair) for pair in combinations(context.inputs, 2))


def _from_zero(context: Context) -> Iterator[Cause]:
    for pair in combinations(context.inputs, 2):
        if all(map(context.begins_at_zero, pair)):
            yield Interaction(*pair, centers=(0.0, 0.0))


def _lacking(context: Context) -> list[tuple[None, str]]:
    reason = "a product needs two inputs, the simulation has one"
    return [] if len(context.inputs) > 1 else [(None, reason)]


register(
    Form(
        "interaction",
        Interaction,
        _of_pairs,
        meaning="the columns {target} act together, which the simulation ignores",
        lacking=_lacking,
        like=("gain",),
        headline="The simulation misses that {target} act together on {output}",
        formula="eta + slope (x1 - center1) (x2 - center2)",
        estimates="slope",
        left_out="the simulation has one input",
    )
)
register(
    Form(
        "interaction: from zero",
        Interaction,
        _from_zero,
        call="`Interaction(x1, x2, centers=(0, 0))`",
        formula="eta + slope x1 x2: right where either is zero",
        estimates="slope",
        left_out="one of them does not begin within a quarter of its span from zero",
    )
)
