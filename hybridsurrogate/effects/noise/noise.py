"""Noise that is not the same everywhere."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import stats

from hybridsurrogate.effects.axis import UNKNOWN, Axis
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
    axis : Axis
        Where the measured rows lie; `prepare` looks.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> from hybridsurrogate.effects.axis import Axis
    >>> growing = hs.Noise("t", axis=Axis.of([0.0, 1.0, 2.0]))
    >>> growing.noise({"t": np.array([0.0, 1.0, 2.0])}, {"slope": np.log(2)}).round(3).tolist()
    [0.5, 1.0, 2.0]
    """

    kind = "noise"
    unknowns = ("slope",)

    def __init__(self, column: str, slope: Prior | None = None, axis: Axis = UNKNOWN):
        super().__init__(column, axis)
        self.slope = slope

    @property
    def pivot(self) -> float:
        """The mean of the measured rows."""
        return self.axis.mean

    def prepare(self, context: Context) -> Cause:
        """Fill in the axis and the prior."""
        return self.filled(axis=self.along(context), slope=self.slope or frozen(stats.norm))

    def noise(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the factor on the noise scale."""
        return np.exp(theta["slope"] * self.scaled(X))

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return growth of log sigma per unit of the column, and the factor over the whole span."""
        return {"slope": 2 * theta["slope"] / self.axis.span, "ratio": np.exp(2 * theta["slope"])}

    def code(self) -> Code:
        """Return the cause as Python."""
        return Code(
            "{sigma} * np.exp({slope} * ({x} - {center}))",
            {"slope": "1 / {x}"},
            {"x": self.column},
            {"center": self.pivot},
            does="scatters",
            name="noise_sd",
        )

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        return (
            f"simulation, with noise that changes by a factor of {values['ratio']:.4g} over "
            f"{self.axis.span:.4g} units of {self.column}"
        )


register(
    Form(
        "noise",
        Noise,
        over_columns(Noise),
        meaning="the scatter of the measurements changes over {column}",
        least_rows=8,
        headline="The scatter of {output} changes over {column}",
        formula="eta; noise sigma exp(slope u), centred at the mean of x",
        priors="slope of u: standard normal",
        estimates="slope (of log sigma, per unit of x), ratio (last end against first)",
        left_out="fewer than 8 rows",
    )
)
