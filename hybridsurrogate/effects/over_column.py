"""What shapes over one measured column have in common."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from hybridsurrogate.effects.base import Cause, Context, FloatArray, Rows
from hybridsurrogate.priors import frozen, period_range, prior_range
from hybridsurrogate.types import Prior

# longest period in spans of the measured rows: of a wave at least a half must be seen
LONGEST_PERIOD = 2.0
# between more rows a jump is looked for as anything else is: on a grid, finer where it informs more
MOST_GAPS = 400
# how much faster waves may be in irregular rows than in as many even ones
_BEYOND_EVEN = 5
# shares of the rows' phases that agree: a wave is no alias of another, or nearly one
_APART, _ALIKE = 0.5, 0.9
# bins a cycle, and how much finer than one cycle the spectrum is looked at
_BINS_A_CYCLE, _PADDED = 16, 4


def span_and_spacing(values: FloatArray) -> tuple[float, float]:
    """Return how far the values reach, and the mean distance of distinct neighbours."""
    distinct = np.unique(values)
    span = float(np.ptp(distinct)) or 1.0
    return span, span / max(len(distinct) - 1, 1)


def highest_frequency(values: FloatArray, most_cycles: int) -> float:
    """Return the highest frequency that rows resolve, in cycles a unit.

    Where rows come evenly spaced, or at whole multiples of a distance, every wave has an alias. The
    highest frequency is half of the first at which all rows meet the same phase (Eyer and Bartholdi
    1999, Astronomy and Astrophysics Supplement 135:1). Irregular rows resolve much faster waves:
    here up to five times what as many even rows would, as is usual for periodograms (VanderPlas
    2018, Astrophysical Journal Supplement 236:16, section 7.1).

    Parameters
    ----------
    values : ndarray of shape (n,)
    most_cycles : int
        Waves in the span of the rows at most: with rows without end there would be no end of them.

    Examples
    --------
    >>> import numpy as np
    >>> highest_frequency(np.arange(21.0), 100)
    0.5
    >>> highest_frequency(20 * np.random.RandomState(0).random_sample(21), 100) > 1.0
    True
    """
    distinct = np.unique(values)
    n = max(len(distinct), 4)
    span = float(np.ptp(distinct)) or 1.0
    even = (n - 1) / 2
    most = min(_BEYOND_EVEN * even, most_cycles)
    # the rows' spectral window, up to twice that, from rows put into fine bins
    bins = int(_BINS_A_CYCLE * 2 * most) + 1
    place = np.rint((distinct - distinct[0]) / span * (bins - 1)).astype(np.intp)
    window = np.abs(np.fft.rfft(np.bincount(place, minlength=bins), _PADDED * bins)) / len(distinct)
    cycles = np.arange(len(window)) * (bins - 1) / (_PADDED * bins)
    falls = int(np.argmax(window < _APART))
    again = np.flatnonzero((window > _ALIKE) & (np.arange(len(window)) > falls))
    if window[falls] < _APART and len(again):
        first = int(again[0])
        # the top of that peak
        top = first + int(np.argmax(window[first : first + 2 * _PADDED]))
        most = min(most, max(float(np.round(2 * cycles[top])) / 4, 1.0))
    return most / span


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

    @property
    def extents(self) -> Mapping[str, float]:
        """How far the measured rows reach along the column."""
        return {} if self.span is None else {self.column: self.span}

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


def position_among(levels: Sequence[float], column: FloatArray) -> NDArray[np.intp]:
    """Return the position of each row's value (n,) among sorted levels (k,); k where it is none."""
    known = np.asarray(levels)
    which = np.minimum(np.searchsorted(known, column), len(known) - 1)
    return np.where(known[which] == column, which, len(known))
