"""Noise that grows with the output."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import stats

from hybridsurrogate.effects.base import SIMULATED, Cause, Context, FloatArray, Rows
from hybridsurrogate.effects.code import Code
from hybridsurrogate.effects.registry import Form, register
from hybridsurrogate.priors import frozen
from hybridsurrogate.types import Prior

# an output near zero still has this share of its usual size
_FLOOR = 0.05
# an even spread over the output reaches about this many standard deviations to either side
_REACH = 2.0


class NoiseOfMean(Cause):
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
    center, size, spread : float or None, default=None
        Mean, root mean square and standard deviation of the measured output on the scale of eta.
    log_scale : bool or None, default=None
        Whether eta is the logarithm of the output.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> relative = hs.NoiseOfMean(center=0.0, size=2.0, spread=2.0, log_scale=False)
    >>> rows = {hs.SIMULATED: np.array([0.0, 2.0, 20.0])}
    >>> relative.noise(rows, {"exponent": 1.0}).round(2).tolist()
    [0.05, 1.0, 10.0]
    """

    kind = "noise"
    meaning = "the scatter of the measurements changes with the size of {output}"
    follows_mean = True

    def __init__(
        self,
        exponent: Prior | None = None,
        center: float | None = None,
        size: float | None = None,
        spread: float | None = None,
        log_scale: bool | None = None,
    ):
        self.exponent = exponent
        self.center = center
        self.size = size
        self.spread = spread
        self.log_scale = log_scale

    @property
    def variant(self) -> str:
        """Over the simulated output."""
        return "mean"

    @property
    def name(self) -> str:
        """The kind, and what it follows."""
        return "noise(output)"

    @property
    def parameters(self) -> Mapping[str, Prior]:  # type: ignore[override]
        """The prior of the exponent."""
        return {"exponent": self.exponent}

    def prepare(self, context: Context) -> Cause:
        """Fill in the usual size of the output and the prior."""
        center = context.location if self.center is None else self.center
        spread = context.scale if self.spread is None else self.spread
        size = float(np.hypot(center, spread)) if self.size is None else self.size
        log_scale = context.log_scale if self.log_scale is None else self.log_scale
        relative = spread if log_scale else spread / size
        prior = self.exponent
        if prior is None:
            prior = frozen(stats.norm, scale=max(1.0, 1 / (_REACH * relative)))
        return self.filled(
            exponent=prior, center=center, size=size, spread=spread, log_scale=log_scale
        )

    def grid(self) -> dict[str, FloatArray]:
        """Return nine quantiles of the exponent."""
        assert self.exponent is not None
        return {"exponent": np.asarray(self.exponent.ppf((np.arange(9) + 0.5) / 9))}

    def noise(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the factor on the noise scale."""
        # an exponent far out would overflow where the simulation is far off: no data are there
        return np.exp(np.clip(theta["exponent"] * self._log_size(X[SIMULATED]), -50, 50))

    def _log_size(self, eta: FloatArray) -> FloatArray:
        assert self.center is not None
        assert self.size is not None
        if self.log_scale:
            return eta - self.center
        return 0.5 * np.log((eta / self.size) ** 2 + _FLOOR**2)

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return the exponent, and the factor between a usual large output and a small one.

        They are one standard deviation of the output above and below its mean.
        """
        assert self.center is not None
        assert self.spread is not None
        ends = np.array([self.center - self.spread, self.center + self.spread])
        if not self.log_scale:
            # of an output of both signs the small sizes are near zero
            ends = np.maximum(abs(self.center) + np.array([-1.0, 1.0]) * self.spread, 0.0)
        low, high = np.sort(self._log_size(ends))
        exponent = np.asarray(theta["exponent"])
        return {"exponent": exponent, "ratio": np.exp(exponent * (high - low))}

    def code(self) -> Code:
        """Return the cause as Python."""
        assert self.center is not None
        assert self.size is not None
        if self.log_scale:
            factor, constants = (
                "np.exp({exponent} * ({simulated} - {center}))",
                {"center": self.center},
            )
        else:
            factor = "(({simulated} / {size}) ** 2 + {floor}**2) ** ({exponent} / 2)"
            constants = {"size": self.size, "floor": _FLOOR}
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
        call="`NoiseOfMean()`",
        formula="eta; noise sigma (m / size)^exponent, m = √(eta² + (size / 20)²), size: root mean "
        "square of the output",
        priors="exponent: normal, sd 1, or size / (2 spread of the output) where that is more",
        estimates="exponent, ratio (output one spread above its mean against one below)",
        left_out="fewer than 8 rows",
    )
)
