"""A periodic curve over one column."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import stats

from hybridsurrogate.effects.base import Cause, Context, FloatArray, Rows
from hybridsurrogate.effects.over_column import OverColumn
from hybridsurrogate.priors import Prior


class Periodic(OverColumn):
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
