"""A sensor whose response is no straight line."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import stats

from hybridsurrogate.effects.base import Cause, Context, FloatArray, Rows
from hybridsurrogate.effects.code import Code
from hybridsurrogate.effects.registry import Form, register
from hybridsurrogate.priors import frozen
from hybridsurrogate.types import Prior


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
    center, scale : float or None, default=None
        Middle and usual deviation of the output, on the scale of eta.
    unit : float or None, default=None
        What one on the scale of eta is in the user's units.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> bent = hs.SensorResponse(center=5.0, scale=5.0)
    >>> theta = {"level": 0.0, "gain": 1.0, "curvature": -0.1}
    >>> bent.response(np.array([0.0, 5.0, 10.0]), {}, theta)[0].tolist()
    [0.0, 5.5, 10.0]
    """

    kind = "response"
    parameters: Mapping[str, Prior] = {
        "level": frozen(stats.norm),
        "gain": frozen(stats.loglaplace, 3.0),
        "curvature": frozen(stats.norm),
    }

    def __init__(
        self,
        center: float | None = None,
        scale: float | None = None,
        unit: float | None = None,
    ):
        self.center = center
        self.scale = scale
        self.unit = unit

    def prepare(self, context: Context) -> Cause:
        """Fill in middle and deviation from where the output is."""
        return self.filled(
            center=context.location - context.distance if self.center is None else self.center,
            scale=context.scale if self.scale is None else self.scale,
            unit=context.unit if self.unit is None else self.unit,
        )

    def start(self) -> dict[str, float]:
        """Return a straight line through zero with slope one."""
        return {"level": 0.0, "gain": 1.0, "curvature": 0.0}

    def response(
        self, simulated: FloatArray, X: Rows, theta: Rows
    ) -> tuple[FloatArray, FloatArray]:
        """Return the bent output and its slope."""
        assert self.center is not None
        assert self.scale is not None
        away = simulated - self.center
        u = away / self.scale
        bent = self.scale * (theta["level"] + theta["curvature"] * (u**2 - 1))
        return self.center + theta["gain"] * away + bent, theta["gain"] + 2 * theta["curvature"] * u

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return the parabola's numbers in the units of the output."""
        assert self.scale is not None
        assert self.unit is not None
        at_zero, slope = self.response(np.zeros_like(theta["gain"]), {}, theta)
        return {
            "level": self.unit * at_zero,
            "gain": slope,
            "curvature": theta["curvature"] / (self.unit * self.scale),
        }

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
        meaning="measured {output} is a bent function of simulated {output}, as of a sensor that "
        "is not linear",
        least_rows=8,
        like=("gain", "limit"),
        headline="{output} is not in proportion to what is simulated: its scale is bent",
        call="`SensorResponse()`",
        formula="level + gain eta + curvature eta²",
        priors="in sd of the output, around its middle: level, curvature standard normal; log "
        "gain: Laplace, scale 1/3",
        estimates="level, gain, curvature",
        left_out="fewer than 8 rows",
    )
)
