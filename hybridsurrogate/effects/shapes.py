"""Causes that add a curve of known shape over one column: offset, trend, periodic, step, bump."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import stats

from hybridsurrogate.effects.base import Cause, Context, FloatArray, Rows
from hybridsurrogate.priors import Prior


class Offset(Cause):
    """A constant added to the simulation, such as a zero error of the instrument."""

    kind = "offset"
    coefficients = ("amplitude",)

    def columns(self, X: Rows, theta: Rows) -> FloatArray:
        """Return a column of ones."""
        return np.ones((len(next(iter(X.values()))), 1))

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        return f"simulation {values['amplitude']:+.4g}"


class _OverColumn(Cause):
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

    def _scaled(self, X: Rows) -> FloatArray:
        assert self.center is not None
        assert self.span is not None
        return 2 * (X[self.column] - self.center) / self.span


class Trend(_OverColumn):
    """A straight line over an input of the simulation, with a zero of its own."""

    kind = "trend"
    coefficients = ("level", "slope")

    def columns(self, X: Rows, theta: Rows) -> FloatArray:
        """Return ones, and the column scaled to [-1, 1]."""
        scaled = self._scaled(X)
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


class MissingInput(_OverColumn):
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
        return self._scaled(X)[:, None]

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return the slope per unit of the column."""
        assert self.span is not None
        return {"slope": 2 * coefficients["slope"] / self.span}

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        return f"simulation {values['slope']:+.4g} ({self.column} - {self.center:.5g})"


class Periodic(_OverColumn):
    """A sine of unknown period, amplitude and phase over one input.

    The period is log-uniform between the shortest that the rows resolve and twice their span.
    """

    kind = "periodic"
    coefficients = ("sine", "cosine")

    def __init__(
        self,
        column: str,
        period: Prior | None = None,
        center: float | None = None,
        span: float | None = None,
    ):
        super().__init__(column, center, span)
        self.period = period

    def prepare(self, context: Context) -> Cause:
        """Fill in the prior of the period from the measured rows."""
        prepared = super().prepare(context)
        if self.period is None:
            distinct = np.unique(context.column(self.column))
            n = max(len(distinct), 4)
            span = float(np.ptp(distinct)) or 1.0
            prepared.period = stats.loguniform(2.0 * span / (n - 1), 2.0 * span)
        return prepared

    @property
    def parameters(self) -> Mapping[str, Prior]:  # type: ignore[override]
        """The prior of the period."""
        return {"period": self.period}

    def grid(self) -> dict[str, FloatArray]:
        """Return periods evenly spaced in frequency, five per independent frequency."""
        assert self.span is not None
        assert self.period is not None
        low, high = self.period.ppf([0.0, 1.0])
        n = int(np.ceil(5 * self.span * (1 / low - 1 / high))) + 1
        return {"period": 1 / np.linspace(1 / low, 1 / high, max(n, 8))}

    def columns(self, X: Rows, theta: Rows) -> FloatArray:
        """Return sine and cosine around the middle of the measured rows."""
        assert self.center is not None
        phase = 2 * np.pi * (X[self.column] - self.center) / theta["period"]
        return np.stack([np.sin(phase), np.cos(phase)], axis=-1)

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return period and amplitude."""
        amplitude = np.hypot(coefficients["sine"], coefficients["cosine"])
        return {"period": np.asarray(theta["period"]), "amplitude": amplitude}

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        return (
            f"simulation + {values['amplitude']:.4g} "
            f"sin(2 pi {self.column} / {values['period']:.5g} + phase)"
        )


class _Located(_OverColumn):
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

    def _locations(self, most: int) -> FloatArray:
        assert self.location is not None
        assert self.spacing is not None
        low, high = self.location.support()
        n = int(np.clip(2 * (high - low) / self.spacing, 8, most))
        return low + (high - low) * (np.arange(n) + 0.5) / n


class Step(_Located):
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
        return {"location": self._locations(200)}

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


class Bump(_Located):
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
        return {"location": self._locations(80), "width": np.geomspace(low * 1.1, high / 1.1, 7)}

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
