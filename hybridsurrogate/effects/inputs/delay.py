"""A simulation that is ahead of the measurements, or behind them."""

from __future__ import annotations

from scipy import stats

from hybridsurrogate.effects.base import Cause, Context, Declared, Rows
from hybridsurrogate.effects.code import Code
from hybridsurrogate.effects.context import trouble_with_labels
from hybridsurrogate.effects.registry import Form, over_inputs, register
from hybridsurrogate.exceptions import did_you_mean
from hybridsurrogate.priors import frozen
from hybridsurrogate.types import Prior


class Delay(Declared):
    """The simulation run at a shifted input: a response that is late, a clock set wrongly.

    ``simulation(x - lag)``, the lag in units of the column; positive when the measurements come
    later than in the simulation. Its prior is Student-t with one degree of freedom (Cauchy), its
    scale a tenth of the measured span: most lags are short, none is ruled out. The shifted input is
    not cut off at the simulated range: near its ends the simulation, or its surrogate, extrapolates
    as far as the lag.

    Parameters
    ----------
    column : str
        An input of the simulation.
    lag : frozen scipy.stats distribution or None, default=None
        Prior of the lag.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> rows, _ = hs.Delay("t").inputs({"t": np.array([3.0, 4.0])}, {}, {"lag": 0.5})
    >>> rows["t"].tolist()
    [2.5, 3.5]
    """

    kind = "delay"
    about = "column"
    unknowns = ("lag",)

    def __init__(self, column: str, lag: Prior | None = None):
        self.column = column
        self.lag = lag

    def prepare(self, context: Context) -> Cause:
        """Fill in the prior from the measured rows."""
        context.column(self.column)
        if self.column not in context.inputs:
            raise ValueError(
                f"A delay shifts an input of the simulation, and {self.column!r} is none: these "
                f"are {list(context.inputs)}.{did_you_mean(self.column, context.inputs)}"
            )
        scale = context.axis(self.column).span / 10
        return self.filled(lag=self.lag or frozen(stats.t, 1, scale=scale))

    def inputs(self, X: Rows, omega: Rows, theta: Rows) -> tuple[Rows, Rows]:
        """Run the simulation where the input was one lag ago."""
        return {**X, self.column: X[self.column] - theta["lag"]}, omega

    def start(self) -> dict[str, float]:
        """Return a lag of zero."""
        return {"lag": 0.0}

    def code(self) -> Code:
        """Return the cause as Python."""
        return Code("{x} - {lag}", {"lag": "{x}"}, {"x": self.column}, does="moves", of=self.column)


def _trouble(cause: Cause, context: Context) -> str | None:
    # a shift is one number and no shape, but one from label to label means nothing
    return trouble_with_labels(cause.target or "", context)


register(
    Form(
        "delay",
        Delay,
        over_inputs(Delay),
        meaning="the measurements lag behind the simulation, or run ahead of it, in {column}, as "
        "where its clock or its sensor is off",
        trouble=_trouble,
        like=("periodic", "wrong-constant"),
        headline="The measurements come {lag:size} {lag:later|earlier} than in the simulation",
        formula="eta(x - lag), x an input, of which the clock or the sensor is off; not cut off at "
        "the simulated range",
        priors="lag: Cauchy, scale a tenth of the span",
        estimates="lag",
        left_out="one distinct value, or fewer than 5 whole numbers one apart, which may be labels",
    )
)
