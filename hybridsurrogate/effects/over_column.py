"""What shapes over one measured column have in common."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hybridsurrogate.effects.base import Cause, Context, Declared, FloatArray, Rows
from hybridsurrogate.effects.context import UNKNOWN, Axis
from hybridsurrogate.priors import prior_range
from hybridsurrogate.types import Prior


class OverColumn(Declared):
    """A shape over one measured column, centred and scaled by what was measured."""

    about = "column"

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
