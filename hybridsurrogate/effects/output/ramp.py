"""A change that sets in at some place and then grows."""

from __future__ import annotations

import numpy as np

from hybridsurrogate.effects.base import FloatArray, Rows
from hybridsurrogate.effects.code import Code
from hybridsurrogate.effects.over_column import Located
from hybridsurrogate.effects.registry import Form, over_inputs, register


class Ramp(Located):
    """Nothing before an unknown location, a straight line after it: a sensor that starts to drift.

    ``simulation + slope max(x - location, 0)``, the hinge of piecewise linear regression (Friedman
    1991, Annals of Statistics 19:1). The slope is in units of the output per unit of the
    column; the location is uniform over the measured rows.

    Parameters
    ----------
    column : str
        Any measured column.
    location : frozen scipy.stats distribution or None, default=None
        Prior of the place where the change sets in; bounded.
    axis : Axis
        Where the measured rows lie; `prepare` looks.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> from hybridsurrogate.effects.axis import Axis
    >>> ramp = hs.Ramp("t", axis=Axis.of([0.0, 10.0]))
    >>> ramp.columns({"t": np.array([2.0, 4.0, 9.0])}, {"location": 4.0}).ravel().tolist()
    [0.0, 0.0, 0.5]
    """

    kind = "ramp"
    coefficients = ("slope",)
    unknowns = ("location",)

    def grid(self) -> dict[str, FloatArray]:
        """Return locations; a hinge needs fewer than a step does."""
        return {"location": self.locations(60)}

    def columns(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the distance beyond the location, in spans of the measured rows."""
        return (np.maximum(X[self.column] - theta["location"], 0.0) / self.axis.span)[:, None]

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return the location, and the slope per unit of the column after it."""
        return {
            "location": np.asarray(theta["location"]),
            "slope": coefficients["slope"] / self.axis.span,
        }

    def code(self) -> Code:
        """Return the cause as Python."""
        return Code(
            "{slope} * np.maximum({x} - {location}, 0)",
            {"location": "{x}", "slope": "{y} / {x}"},
            {"x": self.column},
        )


register(
    Form(
        "ramp",
        Ramp,
        over_inputs(Ramp),
        meaning="from one place of {column} on the gap grows steadily",
        least_distinct=6,
        like=("trend", "step"),
        headline=(
            "From {column} = {location:place} on {output} {slope:rises above|falls "
            "below} the simulation by {slope:size}"
        ),
        priors="location: uniform over the rows",
        estimates="location, slope",
        left_out="fewer than 6 distinct values",
    )
)
