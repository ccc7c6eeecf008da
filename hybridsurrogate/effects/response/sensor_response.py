"""A sensor whose response is no straight line."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import stats

from hybridsurrogate.effects.axis import UNMEASURED, OutputScale
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
    measured : OutputScale
        Where the measured output lies; `prepare` looks.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> from hybridsurrogate.effects.axis import OutputScale
    >>> bent = hs.SensorResponse(OutputScale(spread=5.0, simulated=5.0))
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

    def __init__(self, measured: OutputScale = UNMEASURED):
        self.measured = measured

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
        meaning="measured {output} is a bent function of simulated {output}, as of a sensor that "
        "is not linear",
        least_rows=8,
        like=("gain", "limit"),
        headline="{output} is not in proportion to what is simulated: its scale is bent",
        formula="level + gain eta + curvature eta²",
        priors="in sd of the output, around its middle: level, curvature standard normal; log "
        "gain: Laplace, scale 1/3",
        estimates="level, gain, curvature",
        left_out="fewer than 8 rows",
    )
)
