"""A share of the simulated output that is lost, more of it from some place on."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy import stats

from hybridsurrogate.effects.axis import UNKNOWN, Axis
from hybridsurrogate.effects.base import Cause, Context, FloatArray, Rows, quantiles
from hybridsurrogate.effects.code import Code
from hybridsurrogate.effects.over_column import Located
from hybridsurrogate.effects.registry import Form, register
from hybridsurrogate.priors import frozen
from hybridsurrogate.types import Prior

# longest scale, in spans of the measured rows: a tenth is lost over a span of twice the mean place
_LONGEST = 5.0


class Loss(Located):
    """From some place on ever less of the simulation remains: a vaccine, bleaching, wear.

    ``simulation exp(-max(x - location, 0) / scale)``: attenuation at a constant rate. Location and
    scale (after which 37 % remains) are in units of the column; the location is uniform over the
    measured rows, the scale log-uniform between the distance of neighbouring rows and five spans.
    Where the output is logarithmic the same is a `Ramp`.

    Parameters
    ----------
    column : str
        An input of the simulation.
    location : frozen scipy.stats distribution or None, default=None
        Prior of the place where the loss sets in; bounded.
    scale : frozen scipy.stats distribution or None, default=None
        Prior of the scale; positive.
    axis : Axis
        Where the measured rows lie; `prepare` looks.

    Raises
    ------
    ValueError
        When prepared for a logarithmic output.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> theta = {"location": 2.0, "scale": 5.0}
    >>> hs.Loss("t").gain({"t": np.array([1.0, 2.0, 7.0])}, theta).round(2).tolist()
    [1.0, 1.0, 0.37]
    """

    kind = "ramp"
    unknowns = ("location", "scale")

    def __init__(
        self,
        column: str,
        location: Prior | None = None,
        scale: Prior | None = None,
        axis: Axis = UNKNOWN,
    ):
        super().__init__(column, location, axis)
        self.scale = scale

    @property
    def variant(self) -> str:
        """The name of this form, which is no straight line that is added."""
        return "loss"

    def prepare(self, context: Context) -> Cause:
        """Fill in the priors from the measured rows."""
        if context.log_scale:
            raise ValueError(
                f"Loss({self.column!r}) is for an output itself; where its logarithm is measured, "
                f"use Ramp({self.column!r}), which is the same."
            )
        axis = self.along(context)
        scale = self.scale or frozen(stats.loguniform, axis.spacing, _LONGEST * axis.span)
        return self.filled(axis=axis, location=self.location or axis.location_prior, scale=scale)

    def grid(self) -> dict[str, FloatArray]:
        """Return locations, and scales evenly spaced on a logarithmic scale."""
        return {"location": self.locations(40), "scale": quantiles(self.scale, 12)}

    def gain(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the share that remains."""
        return np.exp(-np.maximum(X[self.column] - theta["location"], 0.0) / theta["scale"])

    def code(self) -> Code:
        """Return the cause as Python."""
        return Code(
            "{simulated} * np.exp(-np.maximum({x} - {location}, 0) / {scale})",
            {"location": "{x}", "scale": "{x}"},
            {"x": self.column},
            does="responds",
        )


def _over_inputs(context: Context) -> Iterator[Cause]:
    return (Loss(name) for name in context.inputs if not context.log_scale)


def _lacking(context: Context) -> Iterator[tuple[str | None, str]]:
    if context.log_scale:
        yield None, "the logarithm of the output is measured: ramp is the same"


register(
    Form(
        "ramp: loss",
        Loss,
        _over_inputs,
        meaning="from one place of {column} on ever less of simulated {output} remains, as where "
        "something is worn, bleached or prevented",
        least_distinct=8,
        lacking=_lacking,
        headline="From {column} = {location:place} on {output} is lost, and the simulation has all",
        priors="location: uniform over the rows; scale: log-uniform, a spacing to five spans",
        estimates="location, scale",
        left_out="fewer than 8 distinct values; the output is logarithmic",
    )
)
