"""A wrong factor on the simulation."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import stats

from hybridsurrogate.effects.base import Cause, Context, Declared, FloatArray, Rows
from hybridsurrogate.effects.code import Code
from hybridsurrogate.effects.registry import Form, register
from hybridsurrogate.priors import frozen
from hybridsurrogate.types import Prior

_LAPLACE_SCALE = 1 / 3


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

    def __init__(self, log_scale: bool = False, scale: float | None = None):
        self.log_scale = log_scale
        self.scale = scale

    def priors_by_name(self) -> Mapping[str, Prior]:
        """Return the prior of the factor: log gain is Laplace."""
        return {} if self.log_scale else {"gain": frozen(stats.loglaplace, 1 / self._scale)}

    @property
    def coefficient_sd(self) -> float | None:  # type: ignore[override]
        """Standard deviation of the logarithm of the factor where the output is logarithmic."""
        return self.scale

    @property
    def _scale(self) -> float:
        return _LAPLACE_SCALE if self.scale is None else self.scale

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
        like=("offset", "wrong-constant"),
        headline="{output} is {gain} times what the simulation gives",
        priors="log gain: Laplace, scale 1/3, or a third of the log ratio of measured to simulated "
        "outputs where that exceeds 2",
        estimates="gain",
        left_out="never",
    )
)
