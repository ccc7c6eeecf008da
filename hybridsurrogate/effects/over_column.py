"""What shapes over one measured column have in common."""

from __future__ import annotations

import numpy as np
from scipy import stats

from hybridsurrogate.effects.base import Cause, Context, FloatArray, Rows
from hybridsurrogate.priors import Prior


class OverColumn(Cause):
    """A shape over one measured column, centred and scaled by what was measured."""

    def __init__(self, column: str, center: float | None = None, span: float | None = None):
        self.column = column
        self.center = center
        self.span = span

    @property
    def target(self) -> str:  # type: ignore[override]
        """The column concerned."""
        return self.column

    def prepare(self, context: Context) -> Cause:
        """Fill in the middle and the span of the column from the measured rows."""
        values = context.column(self.column)
        low, high = float(values.min()), float(values.max())
        changes = {
            "center": self.center if self.center is not None else (low + high) / 2,
            "span": self.span if self.span is not None else (high - low) or 1.0,
        }
        return type(self)(**{**self.get_params(deep=False), **changes})

    def scaled(self, X: Rows) -> FloatArray:
        assert self.center is not None
        assert self.span is not None
        return 2 * (X[self.column] - self.center) / self.span


class Located(OverColumn):
    """A shape with a location inside the measured rows."""

    def __init__(
        self,
        column: str,
        location: Prior | None = None,
        center: float | None = None,
        span: float | None = None,
        spacing: float | None = None,
    ):
        super().__init__(column, center, span)
        self.location = location
        self.spacing = spacing

    def prepare(self, context: Context) -> Cause:
        """Fill in the prior of the location and the typical distance of measured rows."""
        prepared = super().prepare(context)
        distinct = np.unique(context.column(self.column))
        low, high = float(distinct[0]), float(distinct[-1])
        if self.location is None:
            prepared.location = stats.uniform(low, (high - low) or 1.0)
        if self.spacing is None:
            prepared.spacing = ((high - low) or 1.0) / max(len(distinct) - 1, 1)
        return prepared

    def locations(self, most: int) -> FloatArray:
        assert self.location is not None
        assert self.spacing is not None
        low, high = self.location.support()
        n = int(np.clip(2 * (high - low) / self.spacing, 8, most))
        return low + (high - low) * (np.arange(n) + 0.5) / n
