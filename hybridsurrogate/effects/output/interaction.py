"""Two columns that act together."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import combinations

from hybridsurrogate.effects.base import Cause, Context, FloatArray, Rows
from hybridsurrogate.effects.code import Code
from hybridsurrogate.effects.registry import Form, register


class Interaction(Cause):
    """A product of two columns that the simulation lacks: one changes what the other does.

    ``simulation + slope (x1 - center_1) (x2 - center_2)``, the slope in units of the output per
    unit of the product. The simulation describes the main effects: it is right where either column
    is in its middle, or at zero with ``centers=(0.0, 0.0)``.

    Parameters
    ----------
    first, second : str
        Two different measured columns.
    centers, spans : (float, float) or None, default=None
        Middle and length of what is scaled to [-1, 1] in each. None: of the measured rows.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> both = hs.Interaction("t", "dose", centers=(1.0, 1.0), spans=(2.0, 4.0))
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
        spans: tuple[float, float] | None = None,
    ):
        self.first = first
        self.second = second
        self.centers = centers
        self.spans = spans

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

    def prepare(self, context: Context) -> Cause:
        """Fill in middles and spans of the columns from the measured rows."""
        if self.first == self.second:
            raise ValueError(
                f"An interaction needs two different columns, got {self.first!r} twice: a square "
                "is Trend(column, degree=2)."
            )
        (low, high), (bottom, top) = (
            (float(v.min()), float(v.max())) for v in map(context.column, self.reads)
        )
        centers = ((low + high) / 2, (bottom + top) / 2)
        spans = ((high - low) or 1.0, (top - bottom) or 1.0)
        return self.filled(centers=self.centers or centers, spans=self.spans or spans)

    def columns(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the product of the columns, each scaled to [-1, 1]."""
        assert self.centers is not None
        assert self.spans is not None
        u, v = (
            2 * (X[name] - center) / span
            for name, center, span in zip(self.reads, self.centers, self.spans, strict=True)
        )
        return (u * v)[:, None]

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return the slope per unit of the product."""
        assert self.spans is not None
        return {"slope": 4 * coefficients["slope"] / (self.spans[0] * self.spans[1])}

    @property
    def extents(self) -> Mapping[str, float]:
        """How far the measured rows reach along both."""
        return dict(zip(self.reads, self.spans or (), strict=False))

    def code(self) -> Code:
        """Return the cause as Python."""
        assert self.centers is not None
        return Code(
            "{slope} * ({first} - {first_center}) * ({second} - {second_center})",
            {"slope": "{y} / ({first} {second})"},
            {"first": self.first, "second": self.second},
            dict(zip(("first_center", "second_center"), self.centers, strict=True)),
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
        call="`Interaction(x1, x2)`",
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
