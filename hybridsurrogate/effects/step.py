"""A sudden change of level."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hybridsurrogate.effects.base import FloatArray, Rows
from hybridsurrogate.effects.over_column import Located
from hybridsurrogate.priors import Prior


class Step(Located):
    """A sudden change of level at an unknown location over one input.

    The jump is a logistic rise over a fifth of the distance of neighbouring rows: to the data it
    is a step, to a sampler it has a slope.
    """

    kind = "step"
    coefficients = ("amplitude",)

    @property
    def parameters(self) -> Mapping[str, Prior]:  # type: ignore[override]
        """The prior of the location."""
        return {"location": self.location}

    def grid(self) -> dict[str, FloatArray]:
        """Return locations, two per distance of neighbouring rows."""
        return {"location": self.locations(200)}

    def columns(self, X: Rows, theta: Rows) -> FloatArray:
        """Return 0 before and 1 after the location."""
        assert self.spacing is not None
        rise = (X[self.column] - theta["location"]) / (0.1 * self.spacing)
        return (0.5 * (1 + np.tanh(rise)))[:, None]

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        return (
            f"simulation, and from {self.column} = {values['location']:.6g} on "
            f"{values['amplitude']:+.4g}"
        )
