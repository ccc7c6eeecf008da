"""A smooth curve for each experiment, batch, subject or sensor."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from scipy import stats

from hybridsurrogate.effects.axis import UNKNOWN, Axis
from hybridsurrogate.effects.base import Cause, Context, FloatArray, Rows, quantiles
from hybridsurrogate.effects.code import Code
from hybridsurrogate.effects.output.discrepancy_process import GaussianProcessDiscrepancy
from hybridsurrogate.effects.over_column import OverColumn
from hybridsurrogate.effects.registry import Form, register
from hybridsurrogate.priors import frozen
from hybridsurrogate.simulation.calendar import is_of_calendar
from hybridsurrogate.types import Prior

# an experiment with fewer places along the column has an offset, and no curve
_LEAST_PLACES = 4
# waves of each curve: enough for the shortest length, 0.3 of half the span (Riutort-Mayol et al.
# 2023, Statistics and Computing 33:17, eq. 17: 1.75 * 1.5 / 0.3)
_N_WAVES, _SHORTEST = 10, 0.15
# places of the table of a curve
_PLACES = 61


class CurveByExperiment(OverColumn):
    """A smooth curve of unknown shape over one input, which differs between experiments.

    ``simulation + u_e(x)`` with independent Gaussian processes u_e of one standard deviation
    ``amplitude`` and one ``length``: the errors of an experiment's measurements are alike (a
    picture that is distorted, a sensor that was mounted anew), or experiments differ in something
    that the simulation ignores. `GaussianProcessDiscrepancy` over one input gives the curves:
    squared exponential, by a Hilbert-space basis, constant beyond a quarter of the measured range
    outside it. The curves are independent, and the mean of a few is not zero: it may describe what
    few experiments share. An experiment that was not measured has an unknown curve: its prediction
    is the simulation's, with that much more spread.

    Parameters
    ----------
    column : str
        An input of the simulation.
    by : str
        The column with the experiment of each row.
    length, amplitude : frozen scipy.stats distribution or None, default=None
        Priors, in units of the column and of the output: log-uniform from 15 % to 100 % of the
        measured span, and from 0.3 % to 100 % of the spread of the output.
    levels : tuple of float, default=()
        The experiments; none: those of the measured rows.
    axis : Axis
        Where the measured rows lie; `prepare` looks.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> from hybridsurrogate.effects.axis import Axis
    >>> axis = Axis.of([0.0, 10.0])
    >>> own = hs.CurveByExperiment("t", "run", levels=(1.0, 2.0), axis=axis)
    >>> rows = {"t": np.array([4.0, 4.0, 4.5]), "run": np.array([1.0, 2.0, 2.0])}
    >>> columns = own.columns(rows, {"length": np.full(3, 2.0), "amplitude": np.full(3, 0.1)})
    >>> (columns @ columns.T)[1].round(4).tolist()
    [0.0, 0.01, 0.0097]
    """

    kind = "curve-by-experiment"
    unknowns = ("length", "amplitude")
    is_process = True
    coefficient_sd = 1.0

    def __init__(
        self,
        column: str,
        by: str,
        length: Prior | None = None,
        amplitude: Prior | None = None,
        levels: tuple[float, ...] = (),
        axis: Axis = UNKNOWN,
    ):
        super().__init__(column, axis)
        self.by = by
        self.length = length
        self.amplitude = amplitude
        self.levels = levels

    @property
    def reads(self) -> tuple[str, ...]:
        """The input, and the column of the experiments."""
        return (self.column, self.by)

    @property
    def variant(self) -> str:
        """Over which column of experiments."""
        return f"by {self.by}"

    @property
    def name(self) -> str:
        """The kind, the input and the column of the experiments."""
        return f"{self.kind}({self.column} by {self.by})"

    @property
    def coefficients(self) -> tuple[str, ...]:  # type: ignore[override]
        """One name a basis function and experiment, one not measured included."""
        experiments = [*(f"{level:.12g}" for level in self.levels), "another"]
        return tuple(f"{e}: wave_{k}" for e in experiments for k in range(_N_WAVES))

    def prepare(self, context: Context) -> Cause:
        """Fill in the experiments, the axis and the priors."""
        axis, scale = self.along(context), context.scale
        experiments = tuple(context.axis(self.by).rows.tolist())
        return self.filled(
            axis=axis,
            levels=self.levels or experiments,
            length=self.length or frozen(stats.loguniform, _SHORTEST * axis.span, axis.span),
            amplitude=self.amplitude or frozen(stats.loguniform, 0.003 * scale, scale),
        )

    def grid(self) -> dict[str, FloatArray]:
        """Return six lengths; the amplitude only scales the columns, as their size does."""
        return {"length": quantiles(self.length, 6)}

    def factors(self, X: Rows, theta: Rows) -> tuple[FloatArray, FloatArray]:
        """Return the basis functions of each experiment's rows, and the heights of all."""
        scaled = 2 * np.asarray(theta["length"]) / self.axis.span
        parts = self._curve.factors(X, {"length_scale": scaled})
        of_rows, heights = (part[:, :_N_WAVES] for part in parts)
        levels = np.asarray(self.levels)
        is_of = X[self.by][:, None] == levels
        is_of = np.column_stack([is_of, ~is_of.any(axis=1)])
        own = np.einsum("ne,nk->nek", is_of, of_rows).reshape(len(of_rows), -1)
        heights = heights * np.reshape(theta["amplitude"], (-1, 1))
        return own, np.tile(heights, (1, is_of.shape[1]))

    @property
    def _curve(self) -> GaussianProcessDiscrepancy:
        half, middle = self.axis.span / 2, self.pivot
        return GaussianProcessDiscrepancy({self.column: (middle - half, middle + half)})

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return length and standard deviation of the curves."""
        return {name: np.asarray(values) for name, values in theta.items()}

    def code(self) -> Code:
        """Return the cause as Python."""
        x = {"x": self.column, "by": self.by}
        grid = {"grid": (*self._ends, _PLACES)}
        levels = {f"level{k}": (self.by, level) for k, level in enumerate(self.levels)}
        known = ", ".join(f"{{level{k}}}" for k in range(len(self.levels)))
        return Code(
            f"curve_of_level({{x}}, {{by}}, [{known}], {{grid}}, {{curves}})",
            columns=x,
            levels=levels,
            grids=grid,
            tables=self._tables,
        )

    @property
    def _ends(self) -> tuple[float, float]:
        """The places beyond which curves are constant."""
        reach = 0.75 * self.axis.span
        return self.pivot - reach, self.pivot + reach

    def _tables(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return the mean curve of each experiment on a grid."""
        grid, curves = np.linspace(*self._ends, _PLACES), []
        drawn = np.column_stack(list(coefficients.values()))
        for level in self.levels:
            of_rows, of_draws = self.factors(
                {self.column: grid, self.by: np.full(_PLACES, level)}, theta
            )
            curves.append(of_rows @ np.mean(of_draws * drawn, axis=0))
        return {"curves": np.array(curves)}

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        return (
            f"simulation + a smooth curve over {self.column} for each {self.by}, of "
            f"{values['amplitude']:.4g} (standard deviation)"
        )


def _own_curves(context: Context) -> Iterator[Cause]:
    for by in context.labels:
        if not is_of_calendar(by):
            yield from (CurveByExperiment(column, by) for column in context.inputs)


def _lacking(context: Context) -> Iterator[tuple[str | None, str]]:
    if not context.labels:
        yield (
            None,
            "no column labels experiments; experiment=... declares one",
        )


def _trouble(cause: Cause, context: Context) -> str | None:
    assert isinstance(cause, CurveByExperiment)
    places, experiments = context.column(cause.column), context.column(cause.by)
    most = max(len(np.unique(places[experiments == e])) for e in np.unique(experiments))
    if most < _LEAST_PLACES:
        return (
            f"an experiment has {most} distinct values of {cause.column} at most; "
            f"{_LEAST_PLACES} are needed"
        )
    return None


register(
    Form(
        "curve-by-experiment",
        CurveByExperiment,
        _own_curves,
        meaning="{output} deviates by a smooth curve over {column} that differs between "
        "experiments: correlated errors, or something that the simulation ignores",
        least_rows=8,
        least_distinct=2,
        trouble=_trouble,
        lacking=_lacking,
        like=("parameter-by-experiment", "unexplained"),
        headline=(
            "{output} differs from the simulation by a smooth curve over {column} "
            "that is not the same in each experiment"
        ),
        formula="eta + u_e(x); u_e Gaussian, covariance amplitude² exp(-distance²/(2 length²))",
        priors="length: log-uniform, 15 % to 100 % of the span; amplitude: log-uniform, 0.3 % to "
        "100 % of the spread of the output",
        estimates="length, amplitude",
        left_out="no column of labels (declared, or 1, 2, 3 ...); fewer than four places "
        "in each experiment",
    )
)
