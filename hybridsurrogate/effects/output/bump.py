"""A Gaussian bump over one column."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import stats

from hybridsurrogate.effects.base import FloatArray, Rows
from hybridsurrogate.effects.code import Code
from hybridsurrogate.effects.over_column import Located
from hybridsurrogate.effects.registry import Form, over_inputs, register
from hybridsurrogate.priors import frozen
from hybridsurrogate.types import Prior


class Bump(Located):
    """A bump of unknown location and width over one column, such as a passing disturbance.

    ``simulation + amplitude exp(-(x - location)^2 / (2 width^2))``: amplitude in units of the
    output, location and width in those of the column. The location is uniform over the measured
    rows, the width log-uniform from half the distance of neighbouring rows (at most a twentieth of
    the span) to a quarter of the span.

    Parameters
    ----------
    column : str
        Any measured column.
    location : frozen scipy.stats distribution or None, default=None
        Prior of the middle of the bump; bounded.
    axis : Axis
        Where the measured rows lie; `prepare` looks.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> theta = {"location": 2.0, "width": 1.0}
    >>> hs.Bump("t").columns({"t": np.array([2.0, 3.0])}, theta).round(3).ravel().tolist()
    [1.0, 0.607]
    """

    kind = "bump"
    coefficients = ("amplitude",)

    def priors_by_name(self) -> Mapping[str, Prior]:
        """Return the priors of location and width."""
        low, span = min(self.axis.spacing, 0.1 * self.axis.span), self.axis.span
        width = frozen(stats.loguniform, 0.5 * low, 0.25 * span)
        return {"location": self.location, "width": width}

    def grid(self) -> dict[str, FloatArray]:
        """Return locations and widths."""
        low, high = self.parameters["width"].support()
        return {"location": self.locations(80), "width": np.geomspace(low * 1.1, high / 1.1, 7)}

    def columns(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the bump with height one."""
        z = (X[self.column] - theta["location"]) / theta["width"]
        return np.exp(-0.5 * z**2)[:, None]

    def code(self) -> Code:
        """Return the cause as Python."""
        return Code(
            "{amplitude} * np.exp(-0.5 * (({x} - {location}) / {width}) ** 2)",
            {"amplitude": "{y}", "location": "{x}", "width": "{x}"},
            {"x": self.column},
        )


register(
    Form(
        "bump",
        Bump,
        over_inputs(Bump),
        meaning="around one place of {column} the data rise or dip, and the simulation does not",
        least_distinct=8,
        like=("step", "periodic"),
        headline=(
            "The simulation misses a {amplitude:rise|dip} of {output} by "
            "{amplitude:size} around {column} = {location:place}"
        ),
        priors="location: uniform; width: log-uniform, half a spacing (at most a twentieth of the "
        "span) to a quarter of the span",
        estimates="location, width, amplitude",
        left_out="fewer than 8 distinct values",
    )
)
