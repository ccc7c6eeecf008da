"""A sudden change of level."""

from __future__ import annotations

from hybridsurrogate.effects.axis import MOST_GAPS, UNKNOWN, Axis
from hybridsurrogate.effects.base import FloatArray, Rows
from hybridsurrogate.effects.code import Code
from hybridsurrogate.effects.over_column import Located
from hybridsurrogate.effects.registry import Form, over_columns, register
from hybridsurrogate.types import Prior


class Step(Located):
    """A sudden change of level at an unknown location over one column.

    ``simulation + amplitude`` from x = location on; with ``before=True`` ``simulation - amplitude``
    up to there instead, and the simulation as it is from there on. Either way the amplitude is the
    change of level at the location. Where the simulation has a parameter that sets its level the
    two are the same curve. Amplitude in units of the output,
    location in those of the column and uniform over the measured rows. The jump has no width: no
    row lies on it, and between two rows every location is equally probable.

    Parameters
    ----------
    column : str
        Any measured column.
    location : frozen scipy.stats distribution or None, default=None
        Prior of the place of the jump; bounded.
    before : bool, default=False
    axis : Axis
        Where the measured rows lie; `prepare` looks.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> step = hs.Step("t")
    >>> step.columns({"t": np.array([1.0, 4.0])}, {"location": 2.5}).ravel().tolist()
    [0.0, 1.0]
    """

    kind = "step"
    coefficients = ("amplitude",)
    unknowns = ("location",)

    def __init__(
        self,
        column: str,
        location: Prior | None = None,
        before: bool = False,
        axis: Axis = UNKNOWN,
    ):
        super().__init__(column, location, axis)
        self.before = before

    @property
    def variant(self) -> str:
        """On which side the level is off, where it is not the usual one."""
        return "before" if self.before else ""

    def grid(self) -> dict[str, FloatArray]:
        """Return the gaps between neighbouring rows; of many rows two locations a distance."""
        many = len(self.axis.rows) > MOST_GAPS
        return {"location": self.locations(200) if many else self.axis.gaps(self.location)}

    def columns(self, X: Rows, theta: Rows) -> FloatArray:
        """Return 0 before and 1 from the location on, or -1 before and 0 from there on."""
        after = (X[self.column] >= theta["location"]).astype(float)
        return (after - self.before)[:, None]

    def code(self) -> Code:
        """Return the cause as Python."""
        return Code(
            "-{amplitude} * ({x} < {location})"
            if self.before
            else "{amplitude} * ({x} >= {location})",
            {"location": "{x}", "amplitude": "{y}"},
            {"x": self.column},
        )


register(
    Form(
        "step",
        Step,
        over_columns(Step),
        meaning="{output} changes level at one place of {column}, and the simulation does not",
        least_distinct=6,
        like=("ramp", "parameter-drift"),
        headline=(
            "At {column} = {location:place} {output} {amplitude:rises|falls} by "
            "{amplitude:size}, and the simulation does not"
        ),
        formula="eta, + amplitude from location on",
        priors="location: uniform over the rows",
        estimates="location, amplitude",
        left_out="fewer than 6 distinct values",
    )
)
register(
    Form(
        "step: before",
        Step,
        over_columns(lambda column: Step(column, before=True)),
        least_distinct=6,
        call="`Step(x, before=True)`",
        formula="eta, - amplitude before location",
        priors="the same",
        estimates="location, amplitude",
        left_out="the same",
    )
)
