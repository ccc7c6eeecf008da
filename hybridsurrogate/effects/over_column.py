"""What shapes over one measured column have in common."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.effects.base import Cause, Context, Declared, FloatArray, Rows
from hybridsurrogate.effects.context import UNKNOWN, Axis, position_among
from hybridsurrogate.effects.expressions import Code, Does, names_in
from hybridsurrogate.priors import prior_range
from hybridsurrogate.types import Prior


class OverColumn(Declared):
    """A shape over one measured column, centred and scaled by what was measured.

    Attributes
    ----------
    expression : str
        The shape in Python, as in `Code`, over {x}; {center} or {origin} is its pivot.
    units : dict of str to str
        Units of the numbers in it.
    does : str
        What it does to the simulation.
    """

    about = "column"
    expression: str = ""
    units: ClassVar[Mapping[str, str]] = {}
    does: Does = "adds"

    def __init__(self, column: str, axis: Axis = UNKNOWN):
        self.column = column
        self.axis = axis

    @property
    def extents(self) -> Mapping[str, float]:
        """How far the measured rows reach along the column."""
        return {self.column: self.axis.span}

    def prepare(self, context: Context) -> Cause:
        """Look where the measured rows lie along the column."""
        return self.filled(axis=self.along(context))

    def code(self) -> Code | None:
        """Return the cause as Python, where it has an expression."""
        if not self.expression:
            return None
        places = dict.fromkeys({"center", "origin"} & {*names_in(self.expression)}, self.pivot)
        return Code(self.expression, self.units, {"x": self.column}, places, does=self.does)

    def along(self, context: Context) -> Axis:
        """Return where the measured rows lie along the column."""
        measured = context.axis(self.column)
        return self.axis if self.axis.is_known else measured

    @property
    def pivot(self) -> float:
        """The place from which it counts: the middle of the measured rows."""
        return self.axis.center

    def scaled(self, X: Rows) -> FloatArray:
        """Return the column from -1 to 1 over the measured rows."""
        return 2 * (X[self.column] - self.pivot) / self.axis.span


class AtLevel(Declared):
    """Something that may be so only where a column of few values has one of them.

    Attributes
    ----------
    column : str or None
    level : float, str or None
        None: it is so everywhere. A name, of a column of text, is a number once prepared.
    labels : tuple of str or None
        Names that such a column numbers from zero.
    """

    about = "column"
    column: Any
    level: Any
    labels: tuple[str, ...] | None = None

    @property
    def is_one_level(self) -> bool:  # type: ignore[override]
        """Whether a level is meant."""
        return self.level is not None

    @property
    def variant(self) -> str:
        """The one level; everywhere is the plain form."""
        return "" if self.level is None else f"level {self.name_of(self.level)}"

    @property
    def name(self) -> str:
        """The kind and the column, and the level where one is meant."""
        if self.level is None:
            return super().name
        return f"{self.kind}({self.column} = {self.name_of(self.level)})"

    def name_of(self, level: float | str) -> str:
        """Return the name of a level, or its value."""
        if isinstance(level, str):
            return level
        return f"{level:.12g}" if self.labels is None else self.labels[int(level)]

    def here(self, X: Rows) -> NDArray[np.bool_]:
        """Return the rows (n,) with the level."""
        return np.asarray(X[self.column]) == self.level

    def code_at_level(self, expression: str, units: Mapping[str, str], **further: Any) -> Code:
        """Return an expression over the column {x} and its {level}."""
        assert self.level is not None
        at = {"level": (self.column, self.level)}
        labels = self.labels or ()
        return Code(expression, units, {"x": self.column}, levels=at, labels=labels, **further)


class OverExperiments(Declared):
    """Something with a number for each value of a column of experiments.

    Attributes
    ----------
    column : str
    levels : tuple of float
        Values of the column.
    labels : tuple of str or None
        What to call them. None: as they are.
    """

    column: str
    levels: tuple[float, ...]
    labels: tuple[str, ...] | None

    @property
    def reads(self) -> tuple[str, ...]:
        """The column of the experiments."""
        return (self.column,)

    def levels_in(
        self, context: Context, labels: tuple[str, ...] | None = None
    ) -> tuple[float, ...]:
        """Return the values of the column: 0, 1, ... of labels, else those of measured rows."""
        found = context.axis(self.column).rows.tolist()
        numbers = map(float, range(len(self.labels or labels or ())))
        return self.levels or tuple(numbers) or tuple(found)

    @property
    def names_of_levels(self) -> list[str]:
        """Names of the separate numbers."""
        labels = self.labels or tuple(f"{level:.12g}" for level in self.levels)
        return [f"{self.column} = {label}" for label in labels]

    @property
    def another(self) -> str:
        """Name of the number of an experiment that was not measured."""
        return f"another {self.column}"

    def each_row(self, X: Rows, numbers: Sequence[FloatArray]) -> FloatArray:
        """Return the number of each row's experiment (n,), of arrays (n,) for these and others."""
        which = position_among(self.levels, X[self.column])
        return np.stack(numbers)[which, np.arange(len(which))]

    def rows_of(self, X: Rows) -> dict[str, NDArray[np.bool_]]:
        """Return the rows of each experiment, and those of other experiments."""
        names = [*self.names_of_levels, self.another]
        which = position_among(self.levels, X[self.column])
        return {name: which == k for k, name in enumerate(names) if name in self.parameters}


class Located(OverColumn):
    """A shape with a location inside the measured rows."""

    def __init__(self, column: str, location: Prior | None = None, axis: Axis = UNKNOWN):
        super().__init__(column, axis)
        self.location = location

    def prepare(self, context: Context) -> Cause:
        """Fill in the axis, and the prior of the location."""
        axis = self.along(context)
        return self.filled(axis=axis, location=self.location or axis.location_prior)

    def locations(self, most: int) -> FloatArray:
        """Return nodes of the location, two per distance of neighbouring rows, at most so many."""
        low, high = prior_range(self.parameters["location"])
        n = int(np.clip(2 * (high - low) / self.axis.spacing, 8, most))
        return low + (high - low) * (np.arange(n) + 0.5) / n


class FromOrigin(OverColumn):
    """A shape over one measured column that begins where the measurements begin."""

    def __init__(self, column: str, origin: float | None = None, axis: Axis = UNKNOWN):
        super().__init__(column, axis)
        self.origin = origin

    @property
    def pivot(self) -> float:
        """Where it begins: where it was said to, or at the first of the measured rows."""
        return self.axis.origin if self.origin is None else self.origin

    def distance(self, X: Rows) -> FloatArray:
        """Return how far rows are beyond the beginning, zero before it."""
        return np.maximum(X[self.column] - self.pivot, 0.0)
