"""Noise that grows with the output."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import stats

from hybridsurrogate.effects.axis import UNMEASURED, OutputScale
from hybridsurrogate.effects.base import (
    SIMULATED,
    Cause,
    Context,
    Declared,
    FloatArray,
    Rows,
    quantiles,
)
from hybridsurrogate.effects.code import Code
from hybridsurrogate.effects.registry import Form, register
from hybridsurrogate.priors import frozen
from hybridsurrogate.types import Prior

# an output near zero still has this share of its usual size
_FLOOR = 0.05
# an even spread over the output reaches about this many standard deviations to either side
_REACH = 2.0


class NoiseOfMean(Declared):
    """Noise whose standard deviation is a power of the output's size; the simulation is right.

    The standard deviation is ``sigma (m / size)^exponent`` with
    ``m = sqrt(eta^2 + (size / 20)^2)``: the power-of-the-mean model (Carroll and Ruppert 1988,
    Transformation and Weighting in Regression, chapter 2), kept from zero where eta passes it. eta
    is the simulation at the row, without what other causes add; ``size`` is the root mean square of
    the measured output, so sigma is the noise of an output of that size. Exponent 1 is a relative
    error, 1/2 that of counts, 0 the same noise everywhere. On a logarithmic scale m is the output
    itself, ``exp(eta - center)``.

    The exponent is normal around 0, with standard deviation 1, or more where the output moves by a
    small share of its size only: there the noise at the ends still may differ by a factor.

    An emulator's coefficients are fixed at their estimate from the runs wherever eta sets the
    noise, so that everything else stays conditionally Gaussian (pseudo-likelihood; Davidian and
    Carroll 1987, Journal of the American Statistical Association 82:1079).

    Parameters
    ----------
    exponent : frozen scipy.stats distribution or None, default=None
        Prior of the exponent.
    measured : OutputScale
        Where the measured output lies; `prepare` looks.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> from hybridsurrogate.effects.axis import OutputScale
    >>> relative = hs.NoiseOfMean(measured=OutputScale(location=0.0, spread=2.0))
    >>> rows = {hs.SIMULATED: np.array([0.0, 2.0, 20.0])}
    >>> relative.noise(rows, {"exponent": 1.0}).round(2).tolist()
    [0.05, 1.0, 10.0]
    """

    kind = "noise"
    unknowns = ("exponent",)
    meaning = "the scatter of the measurements changes with the size of {output}"
    follows_mean = True

    def __init__(self, exponent: Prior | None = None, measured: OutputScale = UNMEASURED):
        self.exponent = exponent
        self.measured = measured

    @property
    def variant(self) -> str:
        """Over the simulated output."""
        return "mean"

    @property
    def name(self) -> str:
        """The kind, and what it follows."""
        return "noise(output)"

    def prepare(self, context: Context) -> Cause:
        """Fill in the usual size of the output and the prior."""
        measured = self.measured if self.measured.is_known else context.measured
        relative = measured.spread if measured.is_log else measured.spread / measured.size
        prior = self.exponent or frozen(stats.norm, scale=max(1.0, 1 / (_REACH * relative)))
        return self.filled(exponent=prior, measured=measured)

    def grid(self) -> dict[str, FloatArray]:
        """Return nine quantiles of the exponent."""
        return {"exponent": quantiles(self.exponent, 9)}

    def noise(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the factor on the noise scale."""
        # an exponent far out would overflow where the simulation is far off: no data are there
        return np.exp(np.clip(theta["exponent"] * self._log_size(X[SIMULATED]), -50, 50))

    def _log_size(self, eta: FloatArray) -> FloatArray:
        if self.measured.is_log:
            return eta - self.measured.location
        return 0.5 * np.log((eta / self.measured.size) ** 2 + _FLOOR**2)

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return the exponent, and the factor between a usual large output and a small one.

        They are one standard deviation of the output above and below its mean.
        """
        middle, spread = self.measured.location, self.measured.spread
        ends = np.array([middle - spread, middle + spread])
        if not self.measured.is_log:
            # of an output of both signs the small sizes are near zero
            ends = np.maximum(abs(middle) + np.array([-1.0, 1.0]) * spread, 0.0)
        low, high = np.sort(self._log_size(ends))
        exponent = np.asarray(theta["exponent"])
        return {"exponent": exponent, "ratio": np.exp(exponent * (high - low))}

    def code(self) -> Code:
        """Return the cause as Python."""
        factor = "(({simulated} / {size}) ** 2 + {floor}**2) ** ({exponent} / 2)"
        constants = {"size": self.measured.size, "floor": _FLOOR}
        if self.measured.is_log:
            factor = "np.exp({exponent} * ({simulated} - {center}))"
            constants = {"center": self.measured.location}
        return Code(
            f"{{sigma}} * {factor}",
            {"exponent": "1"},
            constants=constants,
            does="scatters",
            name="noise_sd",
        )

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        return (
            "simulation, with noise proportional to the size of the output to the power of "
            f"{values['exponent']:.3g}"
        )


register(
    Form(
        "noise: mean",
        NoiseOfMean,
        lambda context: [NoiseOfMean()],
        least_rows=8,
        headline="The scatter of {output} depends on its size",
        formula="eta; noise sigma (m / size)^exponent, m = √(eta² + (size / 20)²), size: root mean "
        "square of the output",
        priors="exponent: normal, sd 1, or size / (2 spread of the output) where that is more",
        estimates="exponent, ratio (output one spread above its mean against one below)",
        left_out="fewer than 8 rows",
    )
)
