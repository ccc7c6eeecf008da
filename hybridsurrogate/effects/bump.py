"""A Gaussian bump over one column."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import stats

from hybridsurrogate.effects.base import FloatArray, Rows
from hybridsurrogate.effects.over_column import Located
from hybridsurrogate.priors import Prior


class Bump(Located):
    """A Gaussian bump of unknown location and width over one input."""

    kind = "bump"
    coefficients = ("amplitude",)

    @property
    def parameters(self) -> Mapping[str, Prior]:  # type: ignore[override]
        """The priors of location and width."""
        assert self.span is not None
        assert self.spacing is not None
        low = min(self.spacing, 0.1 * self.span)
        return {
            "location": self.location,
            "width": stats.loguniform(0.5 * low, 0.25 * self.span),
        }

    def grid(self) -> dict[str, FloatArray]:
        """Return locations and widths."""
        low, high = self.parameters["width"].support()
        return {"location": self.locations(80), "width": np.geomspace(low * 1.1, high / 1.1, 7)}

    def columns(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the bump with height one."""
        z = (X[self.column] - theta["location"]) / theta["width"]
        return np.exp(-0.5 * z**2)[:, None]

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        return (
            f"simulation {values['amplitude']:+.4g} exp(-({self.column} - "
            f"{values['location']:.5g})^2 / (2 * {values['width']:.4g}^2))"
        )
