"""Counts that scatter more than their likelihood allows."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import stats

from hybridsurrogate.effects.base import SIMULATED, Cause, Context, FloatArray, Rows
from hybridsurrogate.effects.code import Code
from hybridsurrogate.effects.notation import SIMULATION, number
from hybridsurrogate.effects.registry import Form, register
from hybridsurrogate.priors import frozen
from hybridsurrogate.types import Prior

# the relative scatter beyond Poisson's has this largest value, as in a negative binomial's prior
_LARGEST_SCATTER = 2.0


class Overdispersion(Cause):
    """Counts that scatter more than a Poisson distribution allows; the simulation is right.

    With mean mu the variance is ``mu + scatter^2 mu^2``, that of a negative binomial distribution
    (Cameron and Trivedi 2013, Regression Analysis of Count Data, section 3.3), whose second
    parameter ``scatter`` is the relative scatter of the means. The unknown is ``ratio``: by how
    much the standard deviation of a count of usual size exceeds that of a Poisson distribution,
    ``ratio^2 = 1 + scatter^2 size``. It is log-uniform from 1 to the ratio at a scatter of 200 %.

    It is compared under ``likelihood="poisson"``. A fit with this effect is one under
    ``likelihood="negative-binomial"``, with another prior.

    Parameters
    ----------
    ratio : frozen scipy.stats distribution or None, default=None
        Prior of the ratio of standard deviations, from 1 on.
    center : float or None, default=None
        Logarithm of the usual size of a count.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> wide = hs.Overdispersion(center=np.log(20.0))
    >>> rows = {hs.SIMULATED: np.log([1.0, 20.0])}
    >>> wide.noise(rows, {"ratio": np.full(2, 3.0)}).round(2).tolist()
    [1.18, 3.0]
    """

    kind = "noise"
    meaning = "counts of {output} scatter more than a Poisson distribution allows"
    follows_mean = True

    def __init__(self, ratio: Prior | None = None, center: float | None = None):
        self.ratio = ratio
        self.center = center

    @property
    def variant(self) -> str:
        """Which of the forms of noise it is."""
        return "overdispersed"

    @property
    def name(self) -> str:
        """The kind, and which."""
        return "noise(overdispersed)"

    @property
    def parameters(self) -> Mapping[str, Prior]:  # type: ignore[override]
        """The prior of the ratio."""
        return {"ratio": self.ratio}

    def prepare(self, context: Context) -> Cause:
        """Fill in the usual size of a count and the prior."""
        center = context.location if self.center is None else self.center
        ratio = self.ratio
        if ratio is None:
            largest = np.hypot(1.0, _LARGEST_SCATTER * np.exp(0.5 * center))
            ratio = frozen(stats.loguniform, 1.0, max(float(largest), 2.0))
        return self.filled(ratio=ratio, center=center)

    def _scatter(self, theta: Rows) -> FloatArray:
        assert self.center is not None
        beyond = np.maximum(np.square(theta["ratio"]) - 1, 0.0)
        return np.asarray(np.sqrt(beyond * np.exp(-self.center)))

    def noise(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the factor on the noise of a row, around which a search expands."""
        mean = np.exp(np.clip(X[SIMULATED], -50, 50))
        return np.sqrt(1 + np.square(self._scatter(theta)) * mean)

    def overdispersion(self, theta: Rows) -> FloatArray:
        """Return the relative scatter of the means."""
        return self._scatter(theta)

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return the ratio of standard deviations, and the relative scatter."""
        return {"ratio": np.asarray(theta["ratio"]), "scatter": self._scatter(theta)}

    def code(self) -> Code:
        """Return the cause as Python."""
        return Code(
            "{mean} + ({scatter} * {mean}) ** 2",
            {"scatter": "1"},
            arguments={"mean": "expected count"},
            does="scatters",
            name="noise_variance",
        )

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        assert self.center is not None
        return (
            f"simulation, with counts whose standard deviation is {values['ratio']:.3g} times that "
            f"of a Poisson distribution at a count of {np.exp(self.center):.3g}: negative binomial"
        )

    def latex(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in LaTeX."""
        scatter = number(values["scatter"], 3)
        return rf"{SIMULATION}, \quad \text{{variance }} \mu + {scatter}^2 \mu^2"


register(
    Form(
        "noise: overdispersed",
        Overdispersion,
        lambda context: [Overdispersion()] if context.overdisperses else [],
        least_rows=8,
        headline="The counts of {output} scatter more than a Poisson distribution has it",
        call="`Overdispersion()`",
        formula="counts of mean mu with variance mu + scatter² mu²",
        priors="ratio of standard deviations at a usual count: log-uniform from 1 on",
        estimates="ratio, scatter",
        left_out="a likelihood other than Poisson; fewer than 8 rows",
    )
)
