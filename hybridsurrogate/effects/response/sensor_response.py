"""A sensor whose response is no straight line."""

from __future__ import annotations

from collections.abc import Mapping

from scipy import stats

from hybridsurrogate.effects.base import Cause, Context, FloatArray, Rows
from hybridsurrogate.effects.notation import SIMULATION, number, plus, signed
from hybridsurrogate.effects.registry import Form, register
from hybridsurrogate.priors import Prior, frozen

# a usual range of the output, in its standard deviations to either side of its mean
_REACH = 1.5


class SensorResponse(Cause):
    """A bent relation of measured to simulated output: a sensor that is not linear.

    ``simulation + half (level + slope u + curvature (3 u^2 - 1) / 2)`` with
    ``u = (simulation - center) / half``: a parabola, its terms Legendre's polynomials (DLMF 18.3)
    over a range of 1.5 standard deviations of the measured output to either side of its mean. All
    three are standard normal. Estimates are those of
    ``level + gain simulation + curvature simulation^2``, in units of the output, none, and one over
    those of the output. On a logarithmic scale of the output it is a parabola of the logarithm.

    Parameters
    ----------
    center, half : float or None, default=None
        Middle of that range and half its length, on the scale of eta.
    unit : float or None, default=None
        What one on the scale of eta is in the user's units.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> bent = hs.SensorResponse(center=5.0, half=5.0)
    >>> theta = {"level": 0.1, "slope": 0.0, "curvature": -0.1}
    >>> bent.response(np.array([0.0, 5.0, 10.0]), {}, theta)[0].tolist()
    [0.0, 5.75, 10.0]
    """

    kind = "response"
    parameters: Mapping[str, Prior] = dict.fromkeys(
        ("level", "slope", "curvature"), frozen(stats.norm)
    )

    def __init__(
        self,
        center: float | None = None,
        half: float | None = None,
        unit: float | None = None,
    ):
        self.center = center
        self.half = half
        self.unit = unit

    def prepare(self, context: Context) -> Cause:
        """Fill in the range from where the output is."""
        return self.filled(
            center=context.location if self.center is None else self.center,
            half=_REACH * context.scale if self.half is None else self.half,
            unit=context.unit if self.unit is None else self.unit,
        )

    def start(self) -> dict[str, float]:
        """Return a straight line through zero with slope one."""
        return dict.fromkeys(self.parameters, 0.0)

    def response(
        self, simulated: FloatArray, X: Rows, theta: Rows
    ) -> tuple[FloatArray, FloatArray]:
        """Return the bent output and its slope."""
        assert self.center is not None
        assert self.half is not None
        u = (simulated - self.center) / self.half
        bent = theta["level"] + theta["slope"] * u + theta["curvature"] * (1.5 * u**2 - 0.5)
        return simulated + self.half * bent, 1 + theta["slope"] + 3 * theta["curvature"] * u

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return the parabola's numbers in the units of the output."""
        assert self.center is not None
        assert self.half is not None
        assert self.unit is not None
        u = -self.center / self.half  # of an output of zero
        level = theta["level"] + theta["slope"] * u + theta["curvature"] * (1.5 * u**2 - 0.5)
        return {
            "level": self.unit * self.half * level,
            "gain": 1 + theta["slope"] + 3 * theta["curvature"] * u,
            "curvature": 1.5 * theta["curvature"] / (self.unit * self.half),
        }

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        return (
            f"{values['level']:.4g} {plus(values['gain'])} simulation "
            f"{plus(values['curvature'])} simulation^2"
        )

    def latex(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in LaTeX."""
        return (
            rf"{number(values['level'])} {signed(values['gain'])} \, {SIMULATION} "
            rf"{signed(values['curvature'])} \, {SIMULATION}^{{2}}"
        )


def _trouble(cause: Cause, context: Context) -> str | None:
    """Return what is wrong where outputs are far off: of another sign or unit, and not bent."""
    if abs(context.distance) > 2 * context.scale:
        return "the measured outputs lie far from the simulated ones"
    return None


register(
    Form(
        "response",
        SensorResponse,
        lambda context: [SensorResponse()],
        meaning="measured {output} is a bent function of simulated {output}, as of a sensor that "
        "is not linear",
        least_rows=8,
        trouble=_trouble,
        like=("gain", "limit"),
        call="`SensorResponse()`",
        formula="level + gain eta + curvature eta²",
        priors="of the change over 3 sd of the output: level, slope and curvature standard normal",
        estimates="level, gain, curvature",
        left_out="fewer than 8 rows; measured outputs far from simulated ones",
    )
)
