"""What shapes over one measured column have in common."""

from __future__ import annotations

import numpy as np
from scipy import stats

from hybridsurrogate.effects.base import Cause, Context, FloatArray, Rows
from hybridsurrogate.priors import Prior, frozen, period_range, prior_range

# longest period in spans of the measured rows: of a wave at least a half must be seen
LONGEST_PERIOD = 2.0
# between more rows a jump is looked for as anything else is: on a grid, finer where it says more
MOST_GAPS = 400


def span_and_spacing(values: FloatArray) -> tuple[float, float]:
    """Return how far the values reach, and the mean distance of distinct neighbours."""
    distinct = np.unique(values)
    span = float(np.ptp(distinct)) or 1.0
    return span, span / max(len(distinct) - 1, 1)


def period_prior(values: FloatArray) -> Prior:
    """Return log-uniform periods of a change in time: from two distances of rows to two spans."""
    span, spacing = span_and_spacing(values)
    shortest = 2.0 * min(spacing, span / 3)
    return frozen(stats.loguniform, shortest, LONGEST_PERIOD * span)


def period_nodes(prior: Prior, each: float = 5, span: float | None = None) -> FloatArray:
    """Return periods evenly spaced in frequency, so many per independent one of a span.

    A span of None is that of `period_prior`.
    """
    low, high = period_range(prior)
    n = int(np.ceil(each * (span or high / LONGEST_PERIOD) * (1 / low - 1 / high))) + 1
    return 1 / np.linspace(1 / low, 1 / high, max(n, 8))


def gaps(rows: FloatArray, location: Prior) -> FloatArray:
    """Return the cells (T, 2) between neighbouring rows, in one of which a jump is.

    Parameters
    ----------
    rows : ndarray
        Distinct measured values, rising.
    location : frozen scipy.stats distribution
        Where there are none beyond the first or the last row, a cell reaches to the prior's end.
    """
    low, high = prior_range(location)
    borders = np.concatenate([[low], rows[(rows > low) & (rows < high)], [high]])
    return np.column_stack([borders[:-1], borders[1:]])


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
        return self.filled(**changes)

    def scaled(self, X: Rows) -> FloatArray:
        """Return the column from -1 to 1 over the measured rows."""
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
        values = context.column(self.column)
        span, spacing = span_and_spacing(values)
        if self.location is None:
            prepared.location = frozen(stats.uniform, loc=float(values.min()), scale=span)
        if self.spacing is None:
            prepared.spacing = spacing
        return prepared

    def locations(self, most: int) -> FloatArray:
        """Return nodes of the location, two per distance of neighbouring rows, at most so many."""
        assert self.location is not None
        assert self.spacing is not None
        low, high = prior_range(self.location)
        n = int(np.clip(2 * (high - low) / self.spacing, 8, most))
        return low + (high - low) * (np.arange(n) + 0.5) / n


class FromOrigin(Cause):
    """A shape over one measured column that begins where the measurements begin."""

    def __init__(self, column: str, origin: float | None = None):
        self.column = column
        self.origin = origin

    @property
    def target(self) -> str:  # type: ignore[override]
        """The column concerned."""
        return self.column

    def prepare(self, context: Context) -> Cause:
        """Fill in the smallest measured value of the column."""
        values = context.column(self.column)
        origin = self.origin if self.origin is not None else float(values.min())
        return self.filled(origin=origin)

    def distance(self, X: Rows) -> FloatArray:
        """Return how far rows are beyond the origin, zero before it."""
        assert self.origin is not None
        return np.maximum(X[self.column] - self.origin, 0.0)
