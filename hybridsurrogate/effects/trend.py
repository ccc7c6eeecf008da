"""A trend over one column."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hybridsurrogate.effects.base import FloatArray, Rows
from hybridsurrogate.effects.over_column import OverColumn


class Trend(OverColumn):
    """A straight line over an input of the simulation, with a zero of its own."""

    kind = "trend"
    coefficients = ("level", "slope")

    def columns(self, X: Rows, theta: Rows) -> FloatArray:
        """Return ones, and the column scaled to [-1, 1]."""
        scaled = self.scaled(X)
        return np.stack([np.ones_like(scaled), scaled], axis=-1)

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return the slope per unit of the column, and the level in the middle."""
        assert self.span is not None
        return {
            "slope": 2 * coefficients["slope"] / self.span,
            "level": np.asarray(coefficients["level"]),
        }

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        return (
            f"simulation {values['level']:+.4g} {values['slope']:+.4g} "
            f"({self.column} - {self.center:.5g})"
        )
