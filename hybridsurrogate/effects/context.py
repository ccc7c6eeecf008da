"""What a cause may use before it is fitted, and where measured rows lie along a column."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from hybridsurrogate.exceptions import did_you_mean
from hybridsurrogate.priors import frozen, period_range, prior_range
from hybridsurrogate.simulation.arrays import is_of_calendar
from hybridsurrogate.types import FloatArray, Prior

# longest period in spans of the measured rows: of a wave at least a half must be seen
LONGEST_PERIOD = 2.0
# rows that are tried one by one: of more those that the simulation misses most as wild ones, and
# between more a jump is looked for as anything else is: on a grid, finer where it informs more
# (with 400 evidence of 12 sets of 300 rows is 0.007 nats larger, standard error 0.003)
MAX_TRIED_ROWS = 200
# how much faster waves may be in irregular rows than in as many even ones
_TIMES_EVEN = 5
# shares of the rows' phases that agree: a wave is no alias of another, or nearly one
_INCOHERENT, _COHERENT = 0.5, 0.9
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
    most = min(_TIMES_EVEN * even, most_cycles)
    # the rows' spectral window, up to twice that, from rows put into fine bins
    bins = int(_BINS_A_CYCLE * 2 * most) + 1
    place = np.rint((distinct - distinct[0]) / span * (bins - 1)).astype(np.intp)
    window = np.abs(np.fft.rfft(np.bincount(place, minlength=bins), _PADDED * bins)) / len(distinct)
    cycles = np.arange(len(window)) * (bins - 1) / (_PADDED * bins)
    falls = int(np.argmax(window < _INCOHERENT))
    again = np.flatnonzero((window > _COHERENT) & (np.arange(len(window)) > falls))
    if window[falls] < _INCOHERENT and len(again):
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


Rows = Mapping[str, FloatArray]  # a name and its values in n rows

# logarithm of a factor, six scales of its usual prior
_LARGE_LOG_RATIO = 2.0
# integers that count this many experiments, each of as many rows, are labels; and a shape shows at
# as many rows of each level, or on each side of zero
MIN_ROWS_EACH = 3
# labels of more experiments have no separate levels
MAX_EXPERIMENTS = 20
# so many whole numbers one apart are an axis
_MIN_WHOLE_LEVELS = 5


class OfOutput(NamedTuple):
    """What causes may use of one of several outputs: as in `Context`, and its unit."""

    location: float
    distance: float
    ratio: float
    scale: float


@dataclass(frozen=True)
class Context:
    """What a cause may use before it is fitted: names, priors and the measured inputs, never y.

    Attributes
    ----------
    X : dict of name to ndarray of shape (n,)
        Measured columns, the simulation's inputs first.
    n_inputs : int
        How many of the columns are inputs of the simulation.
    parameters : dict of name to prior
        The simulation's unknown parameters.
    assumed : dict of name to Assumed
        Its assumed constants.
    scale : float
        Typical size of the output on the scale of eta, for default priors.
    log_scale : bool
        Whether eta is the logarithm of the output.
    location : float
        Mean of the output on the scale of eta.
    distance : float
        How far that is from the mean of what the simulation gives for the measured rows, at the
        medians of its priors.
    ratio : float
        Root mean square of the output, in shares of that of the simulation there.
    states : dict of str to float
        Typical sizes of the states of an `OdeSimulator` that is run directly, else empty.
    remembers : bool
        Whether its solver can pass earlier states to the right-hand side: "rk4" can.
    resolved : float
        The shortest time in which a state may decay for its solver; zero: there is no limit.
    rates : tuple of str
        Those parameters and assumed constants that its right-hand side takes.
    terms : dict of str to dict of str to bool
        Of each state those that multiply or divide a term of its slope which falls as it grows; and
        whether they divide it.
    starts : tuple of str
        Those parameters that set the initial state of a simulation in time and nothing else.
    gaussian, scales_noise : bool
        Whether the likelihood is normal on the scale of eta, and whether it has a scale of noise.
    overdisperses : bool
        Whether it has a form whose values scatter more than it allows: Poisson and binomial have.
    trials : int or None
        Of a binomial likelihood.
    outputs : tuple of str
        Names of several outputs, each in units of its measured standard deviation; a column of the
        rows then numbers them. Empty where there is one.
    of_outputs : tuple of OfOutput
        What differs between them.
    experiment : str or None
        The column with the experiment of each row, where one was declared.
    names : dict of str to tuple of str
        Names in columns of text, which are numbered from zero in this order.
    by_experiment : tuple of str
        Parameters that are known to differ between these.
    slopes : dict of str to ndarray of shape (n,)
        Slope of the simulation over each input, parameter and assumed constant at the measured
        rows, on the scale of eta per unit of it. Empty with several outputs.
    unit : float
        What one on the scale of eta is in the user's units: of one of several outputs.
    at_prior_end : dict of str to float
        Parameters that the data push against an end of their prior, and the values they have
        there. Empty where the simulation itself cannot be run beyond it.
    missed : ndarray of shape (n,)
        What the simulation misses at its best, in units of the noise factor. Empty where nothing
        was measured yet, and with several outputs.

    Examples
    --------
    >>> X = {"t": np.array([0.0, 1.0]), "wind": np.array([3.0, 4.0])}
    >>> context = Context(X, n_inputs=1, parameters={}, assumed={}, scale=1.0)
    >>> context.inputs, context.extras, context.column("wind")
    (('t',), ('wind',), array([3., 4.]))
    """

    X: Rows
    n_inputs: int
    parameters: Mapping[str, Prior]
    assumed: Mapping[str, Any]
    scale: float
    log_scale: bool = False
    location: float = 0.0
    distance: float = 0.0
    ratio: float = 1.0
    states: Mapping[str, float] = field(default_factory=dict)
    remembers: bool = False
    resolved: float = 0.0
    rates: tuple[str, ...] = ()
    terms: Mapping[str, Mapping[str, bool]] = field(default_factory=dict)
    starts: tuple[str, ...] = ()
    gaussian: bool = True
    scales_noise: bool = True
    overdisperses: bool = False
    trials: int | None = None
    outputs: tuple[str, ...] = ()
    of_outputs: tuple[OfOutput, ...] = ()
    experiment: str | None = None
    names: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    by_experiment: tuple[str, ...] = ()
    slopes: Mapping[str, FloatArray] = field(default_factory=dict)
    unit: float = 1.0
    at_prior_end: Mapping[str, float] = field(default_factory=dict)
    missed: FloatArray = field(default_factory=lambda: np.empty(0), repr=False)
    _axes: dict[str, Axis] = field(default_factory=dict, init=False, repr=False)

    def begins_at_zero(self, column: str) -> bool:
        """Return whether a column ends near zero, and is never on the other side of it.

        Of its span it may begin a quarter from zero and still be measured from there.
        """
        low, high = self.X[column].min(), self.X[column].max()
        ends = sorted(abs(end) for end in (low, high))
        return bool(low * high >= 0 and ends[0] <= 0.25 * (high - low))

    def usual_change(self, quantity: str) -> float:
        """Return a quarter of an input's span, or the prior sd of a parameter or a constant.

        Raises
        ------
        ValueError
            If the simulation has no such quantity.
        """
        if quantity in self.inputs:
            return float(np.ptp(self.X[quantity])) / 4
        priors = {**self.parameters, **{k: a.prior for k, a in self.assumed.items()}}
        if quantity not in priors:
            raise ValueError(
                f"The simulation has no input or parameter {quantity!r}; there are "
                f"{[*self.inputs, *priors]}.{did_you_mean(quantity, [*self.inputs, *priors])}"
            )
        # a heavy tail may have no standard deviation
        low, high = priors[quantity].ppf([0.16, 0.84])
        return float(high - low) / 2

    def parameter(self, name: str) -> Prior:
        """Return the prior of a parameter; raise ValueError when there is none of that name."""
        if name not in self.parameters:
            raise ValueError(
                f"{name!r} is not a parameter of the simulation; these are: "
                f"{list(self.parameters)}.{did_you_mean(name, self.parameters)}"
            )
        return self.parameters[name]

    def level(self, column: str, level: float | str) -> float:
        """Return a value of a column, or the number of a name.

        Raises ValueError where the column never has it.
        """
        names, found = self.names.get(column, ()), self.axis(column).rows.tolist()
        number = float(names.index(level)) if level in names else level
        if number not in found:
            raise ValueError(f"{column!r} is never {level!r}; it is {list(names or found)}.")
        return float(number)

    def axis(self, column: str) -> Axis:
        """Return where the measured rows lie along a column."""
        if column not in self._axes:
            self._axes[column] = Axis.of(self.column(column))
        return self._axes[column]

    @property
    def measured(self) -> OutputScale:
        """Where the measured output lies."""
        simulated = self.location - self.distance
        return OutputScale(self.location, self.scale, simulated, self.log_scale, self.unit)

    @property
    def sd_of_shift(self) -> float | None:
        """Prior sd of a constant added to the simulation, None where the usual one will do.

        Mistaken units put outputs hundreds of spreads away from the simulation, where a prior as
        wide as the spread can explain them by noise only.
        """
        needed = abs(self.distance) / 3
        return needed if needed > 3 * self.scale else None

    @property
    def scale_of_gain(self) -> float | None:
        """Prior scale of the logarithm of a factor, None where the usual one will do."""
        log_ratio = abs(float(np.log(self.ratio)))
        return log_ratio / 3 if log_ratio > _LARGE_LOG_RATIO else None

    @property
    def reach(self) -> float:
        """Size of an effect, on the scale of eta, that may be needed to get to the output.

        A factor is followed along its logarithm's tangent, so that many times the output counts.
        """
        factor = 3 * (self.scale_of_gain or 0.0) * math.hypot(self.location, self.scale)
        return max(3 * self.scale, self.sd_of_shift or 0.0, factor)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the simulation's inputs."""
        return tuple(self.X)[: self.n_inputs]

    @property
    def ignored(self) -> tuple[str, ...]:
        """Names of the measured columns that the simulation ignores: extras and labels."""
        return tuple(self.X)[self.n_inputs :]

    @property
    def extras(self) -> tuple[str, ...]:
        """Names of the measured quantities that the simulation ignores."""
        labels = self.labels
        return tuple(name for name in self.ignored if name not in labels)

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the columns of labels: the declared one, names, counts, weekday and month.

        The simulation ignores them, and they are no axis. A few other numbers, such as four
        temperatures, are a quantity: numbers of subjects with gaps have to be declared.
        """
        return label_columns(self.X, self.n_inputs, self.experiment, self.names)

    def column(self, name: str) -> FloatArray:
        """Return a measured column; raise ValueError when there is none of that name."""
        if name not in self.X:
            raise ValueError(
                f"There is no measured column {name!r}; the columns are {list(self.X)}."
                f"{did_you_mean(name, self.X)}"
            )
        return np.asarray(self.X[name])


def label_columns(
    X: Rows, n_inputs: int, experiment: str | None, names: Mapping[str, tuple[str, ...]]
) -> tuple[str, ...]:
    """Return the columns beyond the inputs that label experiments: `Context.labels`."""
    return tuple(
        name
        for name in list(X)[n_inputs:]
        if name == experiment
        or name in names
        or is_of_calendar(name)
        or _counts_experiments(X[name])
    )


def trouble_with_labels(column: str, context: Context) -> str | None:
    """Return what is wrong with few whole numbers side by side, such as those of sensors."""
    if column not in context.X:  # of a user-defined cause
        return None
    values = np.unique(context.X[column])
    whole = np.all(values == np.round(values)) and np.all(np.diff(values) == 1)
    if not whole or len(values) >= _MIN_WHOLE_LEVELS:
        return None
    return (
        f"{column} has {len(values)} distinct values one apart, which may be labels; "
        f"{_MIN_WHOLE_LEVELS} are needed"
    )


def _counts_experiments(values: FloatArray) -> bool:
    """Return whether a column is 0, 1, 2 ... or 1, 2, 3 ..., three of them or more repeated."""
    levels, rows = np.unique(values, return_counts=True)
    counted = levels[0] + np.arange(len(levels))
    return bool(
        len(levels) >= MIN_ROWS_EACH
        and rows.min() >= MIN_ROWS_EACH
        and levels[0] in (0, 1)
        and np.array_equal(levels, counted)
    )
