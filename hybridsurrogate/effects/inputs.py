"""Causes that move the inputs, or are over columns that the simulation ignores."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy import stats

from hybridsurrogate.arguments import check_choice
from hybridsurrogate.effects.base import Cause, Context, Declared, FloatArray, Rows
from hybridsurrogate.effects.context import (
    MAX_EXPERIMENTS,
    MIN_ROWS_EACH,
    UNKNOWN,
    Axis,
    trouble_with_labels,
)
from hybridsurrogate.effects.expressions import Code, LevelTable
from hybridsurrogate.effects.over_column import AtLevel, OverColumn
from hybridsurrogate.effects.registry import (
    Form,
    needs,
    over_extras,
    over_ignored,
    over_inputs,
    register,
)
from hybridsurrogate.exceptions import did_you_mean
from hybridsurrogate.priors import frozen
from hybridsurrogate.simulation.variables import MAX_LEVELS
from hybridsurrogate.types import Prior


@dataclass(eq=False, repr=False)
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

    column: str
    lag: Prior | None = None

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


register(
    Form(
        "delay",
        Delay,
        over_inputs(Delay),
        meaning=(
            "the measurements lag behind the simulation, or run ahead of it, in {column}, as "
            "where its clock or its sensor is off"
        ),
        # a shift is one number and no shape, but one from label to label means nothing
        trouble=lambda cause, context: trouble_with_labels(cause.target or "", context),
        headline="The measurements come {lag:size} {lag:later|earlier} than in the simulation",
    )
)


class Friction(OverColumn):
    """Dry friction and viscous friction: one depends on the sign, the other on the speed.

    ``simulation + viscous x + dry sign(x)``: Coulomb's and Newton's law (Olsson et al. 1998,
    European Journal of Control 4:176); the same form has the voltage at a contact, or a backlash.
    ``dry`` is in units of the output, ``viscous`` in those per unit of the column.

    Parameters
    ----------
    column : str
        A measured column that the simulation ignores, with rows on both sides of zero.
    axis : Axis
        Where the measured rows lie; `prepare` looks.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> from hybridsurrogate.effects.context import Axis
    >>> friction = hs.Friction("v", axis=Axis.of([-2.0, 2.0]))
    >>> friction.columns({"v": np.array([-2.0, 1.0])}, {}).tolist()
    [[-1.0, -1.0], [0.5, 1.0]]
    """

    kind = "missing-input"
    coefficients = ("viscous", "dry")
    variant = "friction"
    expression = "{viscous} * {x} + {dry} * np.sign({x})"
    units: ClassVar[Mapping[str, str]] = {"viscous": "{y} / {x}", "dry": "{y}"}

    def columns(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the column in half spans, and its sign."""
        x = X[self.column]
        return np.stack([2 * x / self.axis.span, np.sign(x)], axis=-1)

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return both parts in the units of output and column."""
        return {
            "viscous": 2 / self.axis.span * np.asarray(coefficients["viscous"]),
            "dry": np.asarray(coefficients["dry"]),
        }


def _trouble(cause: Cause, context: Context) -> str | None:
    if not isinstance(cause, Friction) or cause.column not in context.X:
        return None
    values = np.unique(context.column(cause.column))
    if min(np.sum(values < 0), np.sum(values > 0)) >= MIN_ROWS_EACH:
        return None
    return f"{cause.column} has fewer than {MIN_ROWS_EACH} distinct values on one side of zero"


register(
    Form(
        "missing-input: friction",
        Friction,
        over_extras(Friction),
        meaning=(
            "{output} has a part that turns with the sign of {target}, which the simulation "
            "ignores, and one in proportion to it, as dry and viscous friction"
        ),
        least_distinct=6,
        trouble=_trouble,
        headline="{output} depends on {target} as by friction, which the simulation ignores",
    )
)


_SHAPES = ("linear", "quadratic", "categorical")


@dataclass(eq=False, repr=False)
class MissingInput(AtLevel, OverColumn):
    """An influence of a measured column that the simulation ignores.

    - ``shape="linear"``: ``simulation + slope (x - center)``; with ``offset=True``
      ``simulation + offset + slope (x - center)``: it is right at another value than ``center``;
    - ``shape="quadratic"``: ``... + curvature (x - center)^2``;
    - ``shape="categorical"``: ``simulation + deviation of the row's level``, one number for each
      distinct value of a column such as a batch or a sensor; the deviations have mean zero over
      the measured rows, and a level that was not measured has none; with ``offset=True`` they are
      amounts of any mean;
    - ``shape="categorical", level=3``: ``simulation + amplitude`` where the column is 3 and the
      simulation as it is elsewhere: one bad batch.

    Slope, curvature, offset, deviations and amplitude are in units of the output (per unit of the
    column, per squared unit). The simulation is taken to be right where the column is ``center``:
    at its mean over the measured rows, unless you know better, such as zero for a dose.

    Parameters
    ----------
    column : str
        Any measured column.
    shape : {"linear", "quadratic", "categorical"}, default="linear"
    level : float, str or None, default=None
        The one level that is off, of a column of text its name; only with the categorical shape.
    center : float or None, default=None
        Where the simulation is right. None: at the mean of the measured rows.
    levels : tuple of (value, share of the rows), default=()
        Empty: those of the measured rows, each with at least three of these; at most six, or twenty
        of a column that labels experiments.
    offset : bool, default=False
        Whether the value at which the simulation is right is unknown, so that an offset is
        estimated too; not with the quadratic shape or one level.
    labels : tuple of str or None, default=None
        Names in a column of text; `prepare` looks.
    axis : Axis
        Where the measured rows lie; `prepare` looks.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> bad_batch = hs.MissingInput("batch", shape="categorical", level=3, levels=((3, 0.5),))
    >>> bad_batch.columns({"batch": np.array([1.0, 3.0])}, {}).ravel().tolist()
    [0.0, 1.0]
    """

    kind = "missing-input"

    column: str
    shape: str = "linear"
    level: float | str | None = None
    center: float | None = None
    levels: tuple[tuple[float, float], ...] = ()
    offset: bool = False
    axis: Axis = UNKNOWN
    labels: tuple[str, ...] | None = None

    @property
    def pivot(self) -> float:
        """Where the simulation is right."""
        return self.axis.mean if self.center is None else self.center

    @property
    def variant(self) -> str:
        """The shape, or the one level; a straight line is the plain form."""
        if self.level is not None:
            return super().variant
        words = [] if self.shape == "linear" else [self.shape]
        if self.offset:
            return " ".join([*words, "with offset"])
        return " ".join([*words, "from zero"] if self.center == 0 else words)

    @property
    def coefficients(self) -> tuple[str, ...]:  # type: ignore[override]
        """Slope and curvature or offset, one deviation a level, or the amplitude of one level."""
        if self.shape == "linear" and self.offset:
            return ("slope", "offset")
        if self.shape != "categorical":
            return ("slope", "curvature")[: _SHAPES.index(self.shape) + 1]
        if self.level is not None:
            return ("amplitude",)
        return tuple(f"level_{self.name_of(value)}" for value, _ in self.levels)

    def prepare(self, context: Context) -> Cause:
        """Fill in mean and span of the column, or its levels, from the measured rows."""
        values = context.column(self.column)
        check_choice(self.shape, "shape", _SHAPES)
        if self.level is not None and self.shape != "categorical":
            raise ValueError(f"level={self.level!r} needs shape='categorical'.")
        if self.offset and (self.shape == "quadratic" or self.level is not None):
            raise ValueError("offset=True needs shape='linear', or 'categorical' without a level.")
        level, levels = self.level, self.levels
        if self.shape == "categorical" and not self.levels:
            if trouble := trouble_with_levels(context, self.column):
                raise ValueError(f"A categorical cause has no use for this column: {trouble}.")
            if self.level is not None:
                level = context.level(self.column, self.level)
            found, counts = np.unique(values, return_counts=True)
            levels = tuple(zip(found.tolist(), (counts / len(values)).tolist(), strict=True))
        names = context.names.get(self.column)
        return self.filled(axis=self.along(context), level=level, levels=levels, labels=names)

    def columns(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the scaled column and its square, or what belongs to the levels."""
        if self.shape != "categorical":
            scaled = self.scaled(X)
            second = np.ones_like(scaled) if self.offset else scaled**2
            return np.stack([scaled, second][: len(self.coefficients)], axis=-1)
        values = np.asarray(X[self.column])
        if self.level is not None:
            return self.here(X).astype(float)[:, None]
        known, shares = np.array(self.levels).T
        indicator = values[:, None] == known
        mean = 0.0 if self.offset else shares
        return np.where(indicator.any(axis=1, keepdims=True), indicator - mean, 0.0)

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return slope and curvature per unit of the column, offset, deviations or amplitude."""
        if self.shape == "categorical":
            if self.offset or self.level is not None:
                return dict(coefficients)
            mean = sum(
                share * coefficients[name]
                for name, (_, share) in zip(self.coefficients, self.levels, strict=True)
            )
            return {name: coefficients[name] - mean for name in self.coefficients}
        span = self.axis.span
        out = {"slope": 2 * coefficients["slope"] / span}
        if self.shape == "quadratic":
            out["curvature"] = 4 * coefficients["curvature"] / span**2
        if self.offset:
            out["offset"] = np.asarray(coefficients["offset"])
        return out

    def code(self) -> Code:
        """Return the cause as Python."""
        if self.level is not None:
            return self.code_at_level("{amplitude} * ({x} == {level})", {"amplitude": "{y}"})
        x = {"x": self.column}
        if self.shape == "categorical":
            known = [value for value, _ in self.levels]
            levels = tuple(zip(known, self.coefficients, strict=True))
            table = LevelTable(self.column, levels)
            return Code("by_level({x}, {table})", {}, x, table=table, labels=self.labels or ())
        away = "({x} - {center})" if self.pivot else "{x}"
        line, numbers = f"{{slope}} * {away}", {"slope": "{y} / {x}"}
        if self.shape == "quadratic":
            line, numbers["curvature"] = f"{line} + {{curvature}} * {away} ** 2", "{y} / {x}^2"
        if self.offset:
            line, numbers["offset"] = f"{{offset}} + {line}", "{y}"
        return Code(line, numbers, x, {"center": self.pivot} if self.pivot else {})


def trouble_with_levels(context: Context, column: str) -> str | None:
    """Return why a column cannot be taken as levels, None if it can."""
    _, counts = np.unique(context.X[column], return_counts=True)
    most = MAX_EXPERIMENTS if column in context.labels else MAX_LEVELS
    if not 2 <= len(counts) <= most:
        return f"{column} has {len(counts)} distinct values, 2 to {most} can be levels"
    if counts.min() < MIN_ROWS_EACH:
        return f"a level of {column} has {counts.min()} rows, {MIN_ROWS_EACH} are needed for each"
    return None


def at_levels(
    make: Callable[[str, float], Cause], context: Context, columns: Iterable[str]
) -> Iterator[Cause]:
    """Yield a cause for each value of those columns that can be taken as levels."""
    for column in columns:
        if trouble_with_levels(context, column) is None:
            for level in context.axis(column).rows.tolist():
                yield make(column, level)


def _trouble_with_categories(cause: Cause, context: Context) -> str | None:
    (column,) = cause.reads
    if len(np.unique(context.X[column])) == 2:
        return f"{column} has 2 distinct values: a straight line over it is the same"
    return trouble_with_levels(context, column)


register(
    Form(
        "missing-input",
        MissingInput,
        over_extras(MissingInput),
        meaning="{target}, which the simulation ignores, influences {output}",
        lacking=needs(lambda context: context.ignored, "no measured column apart from the inputs"),
        headline="{output} depends on {target}, which the simulation ignores",
    ),
    Form(
        "missing-input: quadratic",
        MissingInput,
        over_extras(lambda column: MissingInput(column, shape="quadratic")),
        least_distinct=4,
    ),
    Form(
        "missing-input: categorical",
        MissingInput,
        over_ignored(lambda column: MissingInput(column, shape="categorical")),
        meaning=(
            "{output} is shifted by an amount that differs between the values of {target}, "
            "which the simulation ignores"
        ),
        trouble=_trouble_with_categories,
        headline="{output} differs between the values of {target}, which the simulation ignores",
    ),
    Form(
        "missing-input: categorical with offset",
        MissingInput,
        over_ignored(lambda column: MissingInput(column, shape="categorical", offset=True)),
        trouble=_trouble_with_categories,
        only_alone=True,
    ),
    Form(
        "missing-input: level",
        MissingInput,
        lambda context: at_levels(
            lambda column, level: MissingInput(column, "categorical", level),
            context,
            context.ignored,
        ),
        meaning="{output} is off where {target} has one of its values",
        lacking=lambda context: (
            (column, f"level: {trouble}")
            for column in context.ignored
            if (trouble := trouble_with_levels(context, column))
        ),
        headline=(
            "{output} is {amplitude:size} {amplitude:above|below} the simulation "
            "where {target} is {level}"
        ),
    ),
    Form(
        "missing-input: with offset",
        MissingInput,
        over_extras(lambda column: MissingInput(column, offset=True)),
        least_distinct=3,
        only_alone=True,
    ),
    Form(
        "missing-input: from zero",
        MissingInput,
        # such as a dose, where the simulation knows none
        lambda context: (
            MissingInput(column, center=0.0)
            for column in context.extras
            if len(np.unique(context.X[column])) > 2 and context.begins_at_zero(column)
        ),
    ),
)
