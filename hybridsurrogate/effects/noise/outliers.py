"""Single measurements that are far off."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import stats

from hybridsurrogate.effects.base import Cause, Context, Declared, FloatArray, Rows, quantiles
from hybridsurrogate.effects.code import Code
from hybridsurrogate.effects.registry import Form, register
from hybridsurrogate.likelihoods.contaminated import LARGEST, SMALLEST
from hybridsurrogate.priors import frozen
from hybridsurrogate.types import Prior


class Outliers(Declared):
    """Heavy tails: a share of the measurements scatters much more; the simulation is right.

    Each measurement is, with probability ``share``, an outlier, whose standard deviation is 3 to
    30 times that of the others (log-uniform, for each outlier separately): Tukey's contaminated
    normal (1960, in Contributions to Probability and Statistics) with any size of outlier. Between
    these ends the density falls like one over the distance. The share is log-uniform from 1 to 40
    %.

    Rows are no longer Gaussian given the rest, so an estimator with this effect is fitted as one
    with a likelihood that is not normal. ``sigma`` is the noise of measurements that are not
    outliers. Under a log-normal likelihood far outliers have no useful mean and variance: `predict`
    returns the mean of measurements that are none, and a standard deviation for which outliers are
    normal on the logarithm; intervals, draws and scores are those of the model itself.

    Parameters
    ----------
    share : frozen scipy.stats distribution or None, default=None
        Prior of the share of outliers, within (0, 1).

    Examples
    --------
    >>> import hybridsurrogate as hs
    >>> hs.Outliers().prepare(context=None).formula({"share": 0.05})
    'simulation, and 5 % of the measurements scatter 3 to 30 times as much as the others'
    """

    kind = "noise"
    unknowns = ("share",)
    meaning = "a few measurements of {output} are far off, and carry little information"

    def __init__(self, share: Prior | None = None):
        self.share = share

    @property
    def variant(self) -> str:
        """Heavy tails."""
        return "tails"

    @property
    def name(self) -> str:
        """The kind, and which."""
        return "noise(outliers)"

    def prepare(self, context: Context | None) -> Cause:
        """Fill in the prior."""
        share = frozen(stats.loguniform, 0.01, 0.4) if self.share is None else self.share
        return self.filled(share=share)

    def grid(self) -> dict[str, FloatArray]:
        """Return six quantiles: the share is known to a factor at best."""
        return {"share": quantiles(self.share, 6)}

    def outliers(self, theta: Rows) -> FloatArray:
        """Return the share of outliers."""
        return np.asarray(theta["share"])

    def code(self) -> Code:
        """Return the cause as Python."""
        ratio = LARGEST / SMALLEST
        wide = f"{SMALLEST:g} * {ratio:g} ** {{random}}.random({{n}})"
        return Code(
            "{sigma} * {factor} * {random}.standard_normal({n})",
            {"share": "1"},
            steps={"factor": f"np.where({{random}}.random({{n}}) < {{share}}, {wide}, 1)"},
            arguments={"random": "a numpy.random.Generator", "n": "how many rows"},
            does="scatters",
            name="noise_draws",
        )

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        return (
            f"simulation, and {100 * values['share']:.2g} % of the measurements scatter "
            f"{SMALLEST:g} to {LARGEST:g} times as much as the others"
        )


register(
    Form(
        "noise: tails",
        Outliers,
        lambda context: [Outliers()],
        least_rows=8,
        headline="Some measurements of {output} are outliers",
        formula="eta; each row with probability share an outlier, of 3 to 30 sigma (log-uniform)",
        priors="share: log-uniform, 1 to 40 %",
        estimates="share",
        left_out="fewer than 8 rows",
    )
)
