"""An influence of a measured column that the simulation ignores."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hybridsurrogate.effects.base import Cause, Context, FloatArray, Rows
from hybridsurrogate.effects.over_column import OverColumn


class MissingInput(OverColumn):
    """A linear influence of a measured column that the simulation ignores.

    The simulation is taken to be right at the column's mean over the measured rows.
    """

    kind = "missing-input"
    coefficients = ("slope",)

    def prepare(self, context: Context) -> Cause:
        """Fill in mean and span of the column from the measured rows."""
        prepared = super().prepare(context)
        if self.center is None:
            prepared.center = float(np.mean(context.column(self.column)))
        return prepared

    def columns(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the column, centred and scaled by its range."""
        return self.scaled(X)[:, None]

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return the slope per unit of the column."""
        assert self.span is not None
        return {"slope": 2 * coefficients["slope"] / self.span}

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        return f"simulation {values['slope']:+.4g} ({self.column} - {self.center:.5g})"
