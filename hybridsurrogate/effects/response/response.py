"""Causes that make something else of each simulated output: factor, sensor, limit, loss."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy import stats

from hybridsurrogate.effects.base import (
    Cause,
    Context,
    Declared,
    FloatArray,
    Forms,
    Rows,
    quantiles,
)
from hybridsurrogate.effects.context import UNKNOWN, UNMEASURED, Axis, OutputScale
from hybridsurrogate.effects.expressions import Code
from hybridsurrogate.effects.over_column import Located
from hybridsurrogate.effects.registry import Form, needs, register
from hybridsurrogate.priors import frozen
from hybridsurrogate.types import Prior

# of the prior of a factor's logarithm (`Gain`): a factor of two is ordinary, one of ten is not
_LAPLACE_SCALE = 1 / 3


@dataclass(eq=False, repr=False)
class Gain(Declared):
    """A factor on the simulation, such as a sensor that reads too high.

    ``gain * simulation``; the logarithm of the gain is Laplace with scale 1/3, or more where
    measured and simulated outputs are of another order, as if units were mistaken. On a
    logarithmic scale of the output a factor is an added constant, and is treated as one: its
    logarithm is normal with three times the spread of the logarithmic output. The estimate is the
    factor, which has no unit.

    Parameters
    ----------
    log_scale : bool, default=False
        Whether the output is logarithmic; the likelihood sets it.
    scale : float or None, default=None
        Scale of the prior of the gain's logarithm: Laplace's, or on a logarithmic scale the
        normal's standard deviation. None: as above. It is larger where measured
        and simulated outputs, at the medians of the priors, differ by a factor of more than 2: a
        third of its logarithm, or on a logarithmic scale a third of the distance of their means.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> hs.Gain().gain({"t": np.array([0.0, 1.0])}, {"gain": np.array([1.1, 1.1])}).tolist()
    [1.1, 1.1]
    """

    kind = "gain"

    log_scale: bool = False
    scale: float | None = None

    def priors_by_name(self) -> Mapping[str, Prior]:
        """Return the prior of the factor: log gain is Laplace."""
        scale = _LAPLACE_SCALE if self.scale is None else self.scale
        return {} if self.log_scale else {"gain": frozen(stats.loglaplace, 1 / scale)}

    @property
    def coefficient_sd(self) -> float | None:  # type: ignore[override]
        """Standard deviation of the logarithm of the factor where the output is logarithmic."""
        return self.scale

    @property
    def coefficients(self) -> tuple[str, ...]:  # type: ignore[override]
        """The logarithm of the factor where the output is logarithmic."""
        return ("log_gain",) if self.log_scale else ()

    def prepare(self, context: Context) -> Cause:
        """Choose the form that fits the scale of the output, and the prior its size."""
        scale = self.scale
        if scale is None and context.log_scale:
            scale = context.sd_of_shift
        elif scale is None:
            scale = context.scale_of_gain
        return self.filled(log_scale=context.log_scale, scale=scale)

    def gain(self, X: Rows, theta: Rows) -> FloatArray | float:
        """Return the factor."""
        return 1.0 if self.log_scale else theta["gain"]

    def columns(self, X: Rows, theta: Rows) -> FloatArray | None:
        """Return a column of ones on a logarithmic scale, else nothing."""
        return np.ones((len(next(iter(X.values()))), 1)) if self.log_scale else None

    def start(self) -> dict[str, float]:
        """Return a gain of one."""
        return {} if self.log_scale else {"gain": 1.0}

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return the factor in the units of the output."""
        if self.log_scale:
            return {"gain": np.exp(coefficients["log_gain"])}
        return {"gain": np.asarray(theta["gain"])}

    def code(self) -> Code:
        """Return the cause as Python."""
        return Code("np.log({gain})", {"gain": "1"}) if self.log_scale else self.shown()

    def shown(self) -> Code:
        """Return the factor on the output itself."""
        return Code("{gain} * {simulated}", {"gain": "1"}, does="responds")


register(
    Form(
        "gain",
        Gain,
        lambda context: [Gain()],
        meaning="measured {output} is a constant multiple of simulated {output}",
        headline="{output} is {gain} times what the simulation gives",
    )
)


_PARABOLA = {
    "level": frozen(stats.norm),
    "gain": frozen(stats.loglaplace, 1 / _LAPLACE_SCALE),
    "curvature": frozen(stats.norm),
}


@dataclass(eq=False, repr=False)
class SensorResponse(Cause):
    """A bent relation of measured to simulated output: a sensor that is not linear.

    ``simulation + scale (level + (gain - 1) u + curvature (u^2 - 1))`` with
    ``u = (simulation - center) / scale``: a parabola in Hermite's polynomials (DLMF 18.3), which
    hardly overlap where u is spread as normal. ``center`` is the mean of what is simulated for the
    measured rows, at the medians of the priors, ``scale`` the standard deviation of the measured
    output. Level and curvature are standard normal; the gain is positive, a sensor that turns signs
    around is another fault, its logarithm Laplace with scale 1/3, as that of `Gain`. Estimates are
    those of ``level + gain simulation + curvature simulation^2``, in units of the output, none, and
    one over those of the output. On a logarithmic scale of the output it is a parabola of the
    logarithm.

    Parameters
    ----------
    measured : OutputScale
        Where the measured output lies; `prepare` looks.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> from hybridsurrogate.effects.context import OutputScale
    >>> bent = hs.SensorResponse(OutputScale(spread=5.0, simulated=5.0))
    >>> theta = {"level": 0.0, "gain": 1.0, "curvature": -0.1}
    >>> bent.response(np.array([0.0, 5.0, 10.0]), {}, theta)[0].tolist()
    [0.0, 5.5, 10.0]
    """

    kind = "response"
    parameters = _PARABOLA

    measured: OutputScale = UNMEASURED

    def prepare(self, context: Context) -> Cause:
        """Fill in middle and deviation from where the output is."""
        return self.filled(measured=self.measured if self.measured.is_known else context.measured)

    def start(self) -> dict[str, float]:
        """Return a straight line through zero with slope one."""
        return {"level": 0.0, "gain": 1.0, "curvature": 0.0}

    def response(
        self, simulated: FloatArray, X: Rows, theta: Rows
    ) -> tuple[FloatArray, FloatArray]:
        """Return the bent output and its slope."""
        center, scale = self.measured.simulated, self.measured.spread
        away = simulated - center
        u = away / scale
        # a simulation that fails is far off
        with np.errstate(over="ignore", invalid="ignore"):
            bent = scale * (theta["level"] + theta["curvature"] * (u**2 - 1))
            return center + theta["gain"] * away + bent, theta["gain"] + 2 * theta["curvature"] * u

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return the parabola's numbers in the units of the output."""
        at_zero, slope = self.response(np.zeros_like(theta["gain"]), {}, theta)
        unit = self.measured.unit
        curvature = theta["curvature"] / (unit * self.measured.spread)
        return {"level": unit * at_zero, "gain": slope, "curvature": curvature}

    def code(self) -> Code:
        """Return the cause as Python."""
        return Code(
            "{level} + {gain} * {simulated} + {curvature} * {simulated}**2",
            {"level": "{y}", "gain": "1", "curvature": "1 / {y}"},
            does="responds",
        )


register(
    Form(
        "response",
        SensorResponse,
        lambda context: [SensorResponse()],
        meaning=(
            "measured {output} is a bent function of simulated {output}, as of a sensor that "
            "is not linear"
        ),
        least_rows=8,
        headline="{output} is not in proportion to what is simulated: its scale is bent",
    )
)


@dataclass(eq=False, repr=False)
class Limit(Declared):
    """The output stops at a limit that the simulation exceeds: an overflow, the end of a scale.

    ``min(simulation, limit)``, or with ``below=True`` ``max(simulation, limit)``, as in censored
    regression (Tobin 1958, Econometrica 26:24), but with noise on what is read at the limit. The
    limit is in units of the output. On its scale, the logarithm where the likelihood takes it, the
    prior is normal, with mean and standard deviation of the measured output.

    Parameters
    ----------
    below : bool, default=False
        Whether nothing is below the limit, as under a detection limit, instead of above.
    limit : frozen scipy.stats distribution or None, default=None
        Prior of the limit, on the scale of eta.
    measured : OutputScale
        Where the measured output lies; `prepare` looks.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> values, slopes = hs.Limit().response(np.array([1.0, 5.0]), {}, {"limit": 3.0})
    >>> values.tolist(), slopes.tolist()
    ([1.0, 3.0], [1.0, 0.0])
    """

    kind = "limit"
    forms: ClassVar[Forms] = {("below", True): "below"}
    unknowns = ("limit",)

    below: bool = False
    limit: Prior | None = None
    measured: OutputScale = UNMEASURED

    def prepare(self, context: Context) -> Cause:
        """Fill in the prior from where the output is."""
        measured = self.measured if self.measured.is_known else context.measured
        limit = self.limit or frozen(stats.norm, loc=context.location, scale=context.scale)
        return self.filled(limit=limit, measured=measured)

    def grid(self) -> dict[str, FloatArray]:
        """Return quantiles of the limit."""
        return {"limit": quantiles(self.limit, 50)}

    def response(
        self, simulated: FloatArray, X: Rows, theta: Rows
    ) -> tuple[FloatArray, FloatArray]:
        """Return the output as far as the limit, with slope one there and zero beyond."""
        beyond = simulated < theta["limit"] if self.below else simulated > theta["limit"]
        return np.where(beyond, theta["limit"], simulated), np.where(beyond, 0.0, 1.0)

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return the limit in units of the output."""
        limit = self.measured.unit * np.asarray(theta["limit"])
        return {"limit": np.exp(limit) if self.measured.is_log else limit}

    def code(self) -> Code:
        """Return the cause as Python."""
        if not self.measured.is_log:
            return self.shown()
        return Code(self._end("np.log({limit})"), {"limit": "{plain}"}, does="responds")

    def shown(self) -> Code:
        """Return the limit of the output itself."""
        return Code(self._end("{limit}"), {"limit": "{y}"}, does="responds")

    def _end(self, limit: str) -> str:
        return f"np.{'maximum' if self.below else 'minimum'}({{simulated}}, {limit})"


register(
    Form(
        "limit",
        Limit,
        lambda context: [Limit()],
        meaning=(
            "measured {output} stays at a limit where the simulation goes beyond, as where "
            "something overflows or a sensor is at the end of its scale"
        ),
        least_rows=8,
        headline="{output} stops at {limit}, and the simulation goes beyond",
    ),
    Form(
        "limit: below",
        Limit,
        lambda context: [Limit(below=True)],
        meaning=(
            "measured {output} stays at a limit where the simulation goes below, as at the "
            "least that a sensor can read"
        ),
        least_rows=8,
        headline="{output} does not fall below {limit}, and the simulation does",
    ),
)


@dataclass(eq=False, repr=False)
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
    variant = "loss"
    expression = "{simulated} * np.exp(-np.maximum({x} - {location}, 0) / {scale})"
    units: ClassVar[Mapping[str, str]] = {"location": "{x}", "scale": "{x}"}
    does = "responds"

    column: str
    location: Prior | None = None
    scale: Prior | None = None
    axis: Axis = UNKNOWN

    def prepare(self, context: Context) -> Cause:
        """Fill in the priors from the measured rows."""
        if context.log_scale:
            raise ValueError(
                f"Loss({self.column!r}) is for an output itself; where its logarithm is measured, "
                f"use Ramp({self.column!r}), which is the same."
            )
        axis = self.along(context)
        # at the longest scale a tenth is lost from the middle of the rows to their end
        scale = self.scale or frozen(stats.loguniform, axis.spacing, 5 * axis.span)
        return self.filled(axis=axis, location=self.location or axis.location_prior, scale=scale)

    def grid(self) -> dict[str, FloatArray]:
        """Return locations, and scales evenly spaced on a logarithmic scale."""
        return {"location": self.locations(40), "scale": quantiles(self.scale, 12)}

    def gain(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the share that remains."""
        return np.exp(-np.maximum(X[self.column] - theta["location"], 0.0) / theta["scale"])


register(
    Form(
        "ramp: loss",
        Loss,
        lambda context: (Loss(name) for name in context.inputs if not context.log_scale),
        meaning=(
            "from one place of {column} on ever less of simulated {output} remains, as where "
            "something is worn, bleached or prevented"
        ),
        least_distinct=8,
        lacking=needs(
            lambda context: not context.log_scale,
            "the logarithm of the output is measured: ramp is the same",
        ),
        headline="From {column} = {location:place} on {output} is lost, and the simulation has all",
    )
)
