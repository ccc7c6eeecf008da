"""Causes inside the simulation: a wrong factor, a wrong constant, a parameter that drifts."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import stats

from hybridsurrogate.effects.base import Cause, Context, FloatArray, Rows
from hybridsurrogate.priors import Prior


class Gain(Cause):
    """A factor on the simulation, such as a sensor that reads too high.

    On a logarithmic scale of the output a factor is an added constant, and is treated as one.
    """

    kind = "gain"

    def __init__(self, log_scale: bool = False):
        self.log_scale = log_scale

    @property
    def parameters(self) -> Mapping[str, Prior]:  # type: ignore[override]
        """The prior of the factor: log gain is Laplace with scale 1/3."""
        return {} if self.log_scale else {"gain": stats.loglaplace(3.0)}

    @property
    def coefficients(self) -> tuple[str, ...]:  # type: ignore[override]
        """The logarithm of the factor where the output is logarithmic."""
        return ("log_gain",) if self.log_scale else ()

    def prepare(self, context: Context) -> Cause:
        """Choose the form that fits the scale of the output."""
        return Gain(log_scale=context.log_scale)

    def gain(self, X: Rows, theta: Rows) -> FloatArray | float:
        """Return the factor."""
        return 1.0 if self.log_scale else theta["gain"]

    def columns(self, X: Rows, theta: Rows) -> FloatArray | None:
        """Return a column of ones on a logarithmic scale, else nothing."""
        return np.ones((len(next(iter(X.values()))), 1)) if self.log_scale else None

    def start(self) -> dict[str, float]:
        """Return a gain of one."""
        return {} if self.log_scale else {"gain": 1.0}

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return the factor in the units of the output."""
        if self.log_scale:
            return {"gain": np.exp(coefficients["log_gain"])}
        return {"gain": np.asarray(theta["gain"])}

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        return f"{values['gain']:.4g} * simulation"


class WrongConstant(Cause):
    """An assumed constant that has another value."""

    kind = "wrong-constant"

    def __init__(self, constant: str, prior: Prior | None = None, assumed: float | None = None):
        self.constant = constant
        self.prior = prior
        self.assumed = assumed

    @property
    def target(self) -> str:  # type: ignore[override]
        """The constant concerned."""
        return self.constant

    @property
    def replaces(self) -> str | None:
        """The constant itself."""
        return self.constant

    @property
    def parameters(self) -> Mapping[str, Prior]:  # type: ignore[override]
        """The prior of the constant's value."""
        return {"value": self.prior}

    def prepare(self, context: Context) -> Cause:
        """Take the prior and the assumed value from the simulation."""
        if self.constant not in context.assumed:
            raise ValueError(
                f"{self.constant!r} is not an assumed constant of the simulation; these are: "
                f"{list(context.assumed)}."
            )
        constant = context.assumed[self.constant]
        return WrongConstant(
            self.constant,
            self.prior if self.prior is not None else constant.prior,
            constant.value,
        )

    def inputs(self, X: Rows, omega: Rows, theta: Rows) -> tuple[Rows, Rows]:
        """Run the simulation with another value of the constant."""
        return X, {**omega, self.constant: theta["value"]}

    def start(self) -> dict[str, float]:
        """Return the assumed value."""
        assert self.assumed is not None
        return {"value": self.assumed}

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        return f"simulation with {self.constant} = {values['value']:.4g} (was {self.assumed:.4g})"


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
