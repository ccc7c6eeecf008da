"""Counts that scatter more than their likelihood allows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import stats

from hybridsurrogate.effects.base import SIMULATED, Cause, Context, Declared, FloatArray, Rows
from hybridsurrogate.effects.context import UNMEASURED, OutputScale
from hybridsurrogate.effects.expressions import Code
from hybridsurrogate.effects.registry import Form, register
from hybridsurrogate.priors import frozen
from hybridsurrogate.types import Prior

# the second parameter of the wider distribution has this largest value, as in its prior
_LARGEST_SCATTER = 2.0
# trials of one row that are all alike: the largest correlation
_LARGEST_CORRELATION = 0.999


@dataclass(eq=False, repr=False)
class Overdispersion(Declared):
    """Counts that scatter more than their likelihood allows; the simulation is right.

    Of Poisson counts with mean mu the variance is ``mu + scatter^2 mu^2``, that of a negative
    binomial distribution (Cameron and Trivedi 2013, Regression Analysis of Count Data, section
    3.3), whose second parameter ``scatter`` is the relative scatter of the means. The unknown is
    ``ratio``: by how much the standard deviation of a count of usual size exceeds that of a Poisson
    distribution, ``ratio^2 = 1 + scatter^2 size``. It is log-uniform from 1 to the ratio at a
    scatter of 200 %.

    Of successes among n trials it is that of a beta-binomial distribution, ``n p (1 - p) ratio^2``
    with ``ratio^2 = 1 + (n - 1) correlation``. Trials of one row are correlated by
    ``scatter^2 / (1 + scatter^2)`` (Prentice 1986, J. Am. Stat. Assoc. 81:321).

    It is compared under ``likelihood="poisson"`` and ``Binomial(trials)``. A fit with this effect
    is one under ``"negative-binomial"`` or ``BetaBinomial(trials)``, with another prior.

    Parameters
    ----------
    ratio : frozen scipy.stats distribution or None, default=None
        Prior of the ratio of standard deviations, from 1 on.
    trials : int or None, default=None
        Of each row, where successes are counted.
    measured : OutputScale
        Where the measured output lies; `prepare` looks.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> from hybridsurrogate.effects.context import OutputScale
    >>> wide = hs.Overdispersion(measured=OutputScale(location=np.log(20.0)))
    >>> rows = {hs.SIMULATED: np.log([1.0, 20.0])}
    >>> wide.noise(rows, {"ratio": np.full(2, 3.0)}).round(2).tolist()
    [1.18, 3.0]
    """

    kind = "noise"
    unknowns = ("ratio",)
    meaning = "counts of {output} scatter more than independent events or trials do"
    follows_mean = True
    variant = "overdispersed"
    name = "noise(overdispersed)"

    ratio: Prior | None = None
    trials: int | None = None
    measured: OutputScale = UNMEASURED

    def prepare(self, context: Context) -> Cause:
        """Fill in the usual size of a count or the number of trials, and the prior."""
        measured = self.measured if self.measured.is_known else context.measured
        trials = context.trials if self.trials is None else self.trials
        ratio = self.ratio
        if ratio is None and trials is not None:
            correlation = _LARGEST_SCATTER**2 / (1 + _LARGEST_SCATTER**2)
            ratio = frozen(stats.loguniform, 1.0, float(np.sqrt(1 + (trials - 1) * correlation)))
        if ratio is None:
            largest = np.hypot(1.0, _LARGEST_SCATTER * np.exp(0.5 * measured.location))
            ratio = frozen(stats.loguniform, 1.0, max(float(largest), 2.0))
        return self.filled(ratio=ratio, trials=trials, measured=measured)

    def _scatter(self, theta: Rows) -> FloatArray:
        beyond = np.maximum(np.square(theta["ratio"]) - 1, 0.0)
        if self.trials is not None:
            correlation = np.minimum(beyond / (self.trials - 1), _LARGEST_CORRELATION)
            return np.asarray(np.sqrt(correlation / (1 - correlation)))
        return np.asarray(np.sqrt(beyond * np.exp(-self.measured.location)))

    def noise(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the factor on the noise of a row, around which a search expands."""
        if self.trials is not None:
            return np.maximum(theta["ratio"], 1.0)
        mean = np.exp(np.clip(X[SIMULATED], -50, 50))
        return np.sqrt(1 + np.square(self._scatter(theta)) * mean)

    def overdispersion(self, theta: Rows) -> FloatArray:
        """Return the second parameter of the wider distribution."""
        return self._scatter(theta)

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return the ratio of standard deviations, and the second parameter."""
        return {"ratio": np.asarray(theta["ratio"]), "scatter": self._scatter(theta)}

    def code(self) -> Code:
        """Return the cause as Python."""
        variance, mean = "{mean} + ({scatter} * {mean}) ** 2", "expected count"
        if self.trials is not None:
            n, share = self.trials, "{scatter} ** 2 / (1 + {scatter} ** 2)"
            variance = f"{{mean}} * (1 - {{mean}} / {n}) * (1 + {n - 1} * {share})"
            mean = "expected number of successes"
        arguments, name = {"mean": mean}, "noise_variance"
        return Code(variance, {"scatter": "1"}, arguments=arguments, does="scatters", name=name)

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        if self.trials is not None:
            return (
                f"simulation, with successes whose standard deviation is {values['ratio']:.3g} "
                f"times that of {self.trials} independent trials: beta-binomial"
            )
        usual = np.exp(self.measured.location)
        return (
            f"simulation, with counts whose standard deviation is {values['ratio']:.3g} times that "
            f"of a Poisson distribution at a count of {usual:.3g}: negative binomial"
        )


register(
    Form(
        "noise: overdispersed",
        Overdispersion,
        lambda context: [Overdispersion()] if context.overdisperses else [],
        least_rows=8,
        headline="The counts of {output} scatter more than independent events or trials do",
    )
)
