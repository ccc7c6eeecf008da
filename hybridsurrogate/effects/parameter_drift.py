"""A parameter that does not stay constant."""

from __future__ import annotations

from collections.abc import Mapping

from scipy import stats

from hybridsurrogate.effects.base import Cause, Context, Rows
from hybridsurrogate.priors import Prior


class ParameterDrift(Cause):
    """A parameter that changes linearly over an input instead of staying constant.

    The slope has a Cauchy prior: over the measured rows the parameter changes by about its own
    prior standard deviation, or by much less or more.
    """

    kind = "parameter-drift"

    def __init__(
        self,
        parameter: str,
        column: str,
        slope: Prior | None = None,
        center: float | None = None,
    ):
        self.parameter = parameter
        self.column = column
        self.slope = slope
        self.center = center

    @property
    def target(self) -> str:  # type: ignore[override]
        """The parameter concerned."""
        return self.parameter

    @property
    def name(self) -> str:
        """The kind, the parameter and the input over which it drifts."""
        return f"{self.kind}({self.parameter} over {self.column})"

    @property
    def parameters(self) -> Mapping[str, Prior]:  # type: ignore[override]
        """The prior of the slope."""
        return {"slope": self.slope}

    def prepare(self, context: Context) -> Cause:
        """Fill in the pivot and the prior of the slope."""
        if self.parameter not in context.parameters:
            raise ValueError(
                f"{self.parameter!r} is not a parameter of the simulation; these are: "
                f"{list(context.parameters)}."
            )
        values = context.column(self.column)
        low, high = float(values.min()), float(values.max())
        sd = float(context.parameters[self.parameter].std())
        scale = sd / ((high - low) or 1.0)
        return ParameterDrift(
            self.parameter,
            self.column,
            self.slope if self.slope is not None else stats.t(1, scale=scale),
            self.center if self.center is not None else (low + high) / 2,
        )

    def inputs(self, X: Rows, omega: Rows, theta: Rows) -> tuple[Rows, Rows]:
        """Let the parameter pass through its mean value in the middle of the measured rows."""
        assert self.center is not None
        shift = theta["slope"] * (X[self.column] - self.center)
        return X, {**omega, self.parameter: omega[self.parameter] + shift}

    def start(self) -> dict[str, float]:
        """Return a slope of zero."""
        return {"slope": 0.0}

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        return (
            f"simulation with {self.parameter} changing by {values['slope']:+.4g} per unit of "
            f"{self.column} around {self.column} = {self.center:.5g}"
        )
