"""A constant added to the simulation."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from hybridsurrogate.effects.base import Cause, Context, Declared, FloatArray, Rows
from hybridsurrogate.effects.code import Code
from hybridsurrogate.effects.ignored.missing_input import trouble_with_levels
from hybridsurrogate.effects.registry import Form, register


class Offset(Declared):
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
    about = "column"
    coefficients = ("amplitude",)

    def __init__(
        self, column: str | None = None, level: float | None = None, sd: float | None = None
    ):
        self.column = column
        self.level = level
        self.sd = sd

    @property
    def coefficient_sd(self) -> float | None:  # type: ignore[override]
        """Standard deviation of the amplitude's prior."""
        return self.sd

    @property
    def variant(self) -> str:
        """The one level; everywhere is the plain form."""
        return "" if self.level is None else f"level {self.level:.12g}"

    @property
    def is_one_level(self) -> bool:  # type: ignore[override]
        """Whether a level is meant."""
        return self.level is not None

    @property
    def name(self) -> str:
        """The kind, and the level where one is meant."""
        return (
            self.kind if self.level is None else f"{self.kind}({self.column} = {self.level:.12g})"
        )

    def prepare(self, context: Context) -> Cause:
        """Look for the level among the measured rows, or choose the size of the prior."""
        if (self.column is None) != (self.level is None):
            raise ValueError(
                f"column={self.column!r}, level={self.level!r}: an offset at one level needs both, "
                "one everywhere neither."
            )
        if self.column is None:
            return self if self.sd is not None else self.filled(sd=context.sd_of_shift)
        found = np.unique(context.column(self.column))
        if self.level not in found:
            raise ValueError(f"{self.column!r} is never {self.level!r}; it is {list(found)}.")
        return self

    def columns(self, X: Rows, theta: Rows) -> FloatArray:
        """Return a column of ones, or one where the level is."""
        if self.column is None:
            return np.ones((len(next(iter(X.values()))), 1))
        return (np.asarray(X[self.column]) == self.level).astype(float)[:, None]

    def code(self) -> Code:
        """Return the cause as Python."""
        if self.column is None or self.level is None:
            return Code("{amplitude}", {"amplitude": "{y}"})
        return Code(
            "{amplitude} * ({x} == {level})",
            {"amplitude": "{y}"},
            {"x": self.column},
            levels={"level": (self.column, self.level)},
        )


def _at_levels(context: Context) -> Iterator[Cause]:
    # sensors side by side, or the standards of a calibration
    for column in context.inputs:
        if trouble_with_levels(context, column) is None:
            for level in np.unique(context.X[column]):
                yield Offset(column, float(level))


def _trouble_on_log_scale(cause: Cause, context: Context) -> str | None:
    if cause.target is None and context.log_scale:
        return "on a logarithmic scale a constant is a factor, compared as gain"
    return None


register(
    Form(
        "offset",
        Offset,
        lambda context: [Offset()],
        meaning="{output} is measured higher or lower than simulated by the same amount everywhere",
        trouble=_trouble_on_log_scale,
        like=("trend", "gain"),
        headline=("{output} is {amplitude:size} {amplitude:above|below} the simulation everywhere"),
        priors="sd of the amplitude: as above, or a third of the mean distance of measured from "
        "simulated outputs where that is more",
        estimates="amplitude",
        left_out="the output is logarithmic: it is a gain",
    )
)
register(
    Form(
        "offset: level",
        Offset,
        _at_levels,
        meaning="{output} is off where {target} has one of its values",
        headline=(
            "{output} is {amplitude:size} {amplitude:above|below} the simulation "
            "at one value of {target}"
        ),
        call="`Offset(x, level=2)`",
        formula="eta, + amplitude where the input x is 2",
        estimates="amplitude",
        left_out="fewer than 2 or more than 6 values of x, or one with fewer than 3 rows",
    )
)
