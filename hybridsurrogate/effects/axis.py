"""Where measured rows lie along a column."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from hybridsurrogate.priors import frozen, period_range, prior_range
from hybridsurrogate.types import FloatArray, Prior

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


@dataclass(frozen=True, eq=False)
class Axis:
    """Where measured rows lie along a column, in its units.

    Attributes
    ----------
    origin : float
        The smallest value.
    center : float
        The middle between the smallest and the largest.
    mean : float
        Of all rows.
    span : float
        How far the rows reach; one where they are all the same.
    spacing : float
        The mean distance of distinct neighbours.
    rows : ndarray
        Distinct values, rising.

    Examples
    --------
    >>> Axis.of([2.0, 4.0, 4.0, 12.0])
    Axis(origin=2.0, center=7.0, mean=5.5, span=10.0, spacing=5.0)
    """

    origin: float = np.nan
    center: float = np.nan
    mean: float = np.nan
    span: float = np.nan
    spacing: float = np.nan
    rows: FloatArray = field(default_factory=lambda: np.empty(0), repr=False)

    @classmethod
    def of(cls, values: ArrayLike) -> Axis:
        """Return the axis of measured rows."""
        values = np.asarray(values, dtype=float)
        rows = np.unique(values)
        low, high = float(rows[0]), float(rows[-1])
        span = high - low or 1.0
        spacing = span / max(len(rows) - 1, 1)
        return cls(low, (low + high) / 2, float(np.mean(values)), span, spacing, rows)

    def __deepcopy__(self, memo: dict[int, object]) -> Axis:
        """Return itself: nothing of it changes."""
        return self

    @property
    def is_known(self) -> bool:
        """Whether it is one of measured rows."""
        return len(self.rows) > 0

    @property
    def end(self) -> float:
        """The largest value."""
        return float(self.rows[-1])

    @property
    def location_prior(self) -> Prior:
        """A place that is uniform over the rows."""
        return frozen(stats.uniform, loc=self.origin, scale=self.span)

    @property
    def period_prior(self) -> Prior:
        """Log-uniform periods of a change in time: from two distances of rows to two spans."""
        shortest = 2.0 * min(self.spacing, self.span / 3)
        return frozen(stats.loguniform, shortest, LONGEST_PERIOD * self.span)

    def gaps(self, location: Prior) -> FloatArray:
        """Return the cells (T, 2) between neighbouring rows, in one of which a jump is.

        Parameters
        ----------
        location : frozen scipy.stats distribution
            Where there are no rows beyond the first or the last one, a cell reaches to its end.
        """
        low, high = prior_range(location)
        inside = self.rows[(self.rows > low) & (self.rows < high)]
        borders = np.concatenate([[low], inside, [high]])
        return np.column_stack([borders[:-1], borders[1:]])


UNKNOWN = Axis()


@dataclass(frozen=True)
class OutputScale:
    """Where the measured output lies, on the scale of eta.

    Attributes
    ----------
    location, spread : float
        Its mean and standard deviation.
    simulated : float
        The mean of what is simulated for the measured rows, at the medians of the priors.
    is_log : bool
        Whether eta is the logarithm of the output.
    unit : float
        What one on the scale of eta is in the user's units.
    """

    location: float = np.nan
    spread: float = np.nan
    simulated: float = np.nan
    is_log: bool = False
    unit: float = 1.0

    @property
    def is_known(self) -> bool:
        """Whether it is that of measurements."""
        return not math.isnan(self.location)

    @property
    def size(self) -> float:
        """The root mean square of the output."""
        return float(np.hypot(self.location, self.spread))


UNMEASURED = OutputScale()


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


def period_nodes(prior: Prior, each: float = 5, span: float | None = None) -> FloatArray:
    """Return periods evenly spaced in frequency, so many per independent one of a span.

    A span of None is that of `period_prior`.
    """
    low, high = period_range(prior)
    n = int(np.ceil(each * (span or high / LONGEST_PERIOD) * (1 / low - 1 / high))) + 1
    return 1 / np.linspace(1 / low, 1 / high, max(n, 8))


def position_among(levels: Sequence[float], column: FloatArray) -> NDArray[np.intp]:
    """Return the position of each row's value (n,) among sorted levels (k,); k where it is none."""
    known = np.asarray(levels)
    which = np.minimum(np.searchsorted(known, column), len(known) - 1)
    return np.where(known[which] == column, which, len(known))
