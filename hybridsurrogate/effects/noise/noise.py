"""Noise that is not the same everywhere."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import stats

from hybridsurrogate.effects.base import Cause, Context, FloatArray, Rows
from hybridsurrogate.effects.code import Code
from hybridsurrogate.effects.over_column import OverColumn
from hybridsurrogate.effects.registry import Form, over_columns, register
from hybridsurrogate.priors import frozen
from hybridsurrogate.types import Prior


class Noise(OverColumn):
    """Noise whose standard deviation grows or shrinks over a column; the simulation is right.

    The standard deviation is ``sigma exp(slope u)`` with u the column centred at its mean over the
    measured rows and divided by half its span: the log-linear dispersion model of Cook and Weisberg
    (1983, Biometrika 70:1). The factor has geometric mean one over the measured rows, so sigma
    keeps its meaning. The slope is standard normal: between the ends of the measured rows the noise
    changes by a factor of exp(2 slope), mostly less than 50. On a logarithmic scale of the output
    the noise is relative.

    Parameters
    ----------
    column : str
        Any measured column.
    slope : frozen scipy.stats distribution or None, default=None
        Prior of the slope.
    center, span : float or None, default=None
        Mean and span of the measured rows.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> growing = hs.Noise("t", center=1.0, span=2.0)
    >>> growing.noise({"t": np.array([0.0, 1.0, 2.0])}, {"slope": np.log(2)}).round(3).tolist()
    [0.5, 1.0, 2.0]
    """

    kind = "noise"

    def __init__(
        self,
        column: str,
        slope: Prior | None = None,
        center: float | None = None,
        span: float | None = None,
    ):
        super().__init__(column, center, span)
        self.slope = slope

    @property
    def parameters(self) -> Mapping[str, Prior]:  # type: ignore[override]
        """The prior of the slope."""
        return {"slope": self.slope}

    def prepare(self, context: Context) -> Cause:
        """Fill in the mean of the column, its span and the prior."""
        prepared = super().prepare(context)
        if self.center is None:
            prepared.center = float(np.mean(context.column(self.column)))
        if self.slope is None:
            prepared.slope = frozen(stats.norm)
        return prepared

    def noise(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the factor on the noise scale."""
        return np.exp(theta["slope"] * self.scaled(X))

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return growth of log sigma per unit of the column, and the factor over the whole span."""
        assert self.span is not None
        return {"slope": 2 * theta["slope"] / self.span, "ratio": np.exp(2 * theta["slope"])}

    def code(self) -> Code:
        """Return the cause as Python."""
        assert self.center is not None
        return Code(
            "{sigma} * np.exp({slope} * ({x} - {center}))",
            {"slope": "1 / {x}"},
            {"x": self.column},
            {"center": self.center},
            does="scatters",
            name="noise_sd",
        )

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        return (
            f"simulation, with noise that changes by a factor of {values['ratio']:.4g} over "
            f"{self.span:.4g} units of {self.column}"
        )


register(
    Form(
        "noise",
        Noise,
        over_columns(Noise),
        meaning="the scatter of the measurements changes over {column}",
        least_rows=8,
        headline="The scatter of {output} changes over {column}",
        call="`Noise(x)`",
        formula="eta; noise sigma exp(slope u), centred at the mean of x",
        priors="slope of u: standard normal",
        estimates="slope (of log sigma, per unit of x), ratio (last end against first)",
        left_out="fewer than 8 rows",
    )
)
