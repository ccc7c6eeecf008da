"""Shapes over one column that add to the output: bump, decay, episode, ramp, saturation, step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from hybridsurrogate.effects.base import Act, Cause, Context, FloatArray, Forms, Rows
from hybridsurrogate.effects.context import MAX_TRIED_ROWS, UNKNOWN, Axis
from hybridsurrogate.effects.expressions import Code
from hybridsurrogate.effects.over_column import FromOrigin, Located
from hybridsurrogate.effects.registry import Form, needs, over_columns, over_inputs, register
from hybridsurrogate.priors import frozen
from hybridsurrogate.types import Prior


class Bump(Located):
    """A bump of unknown location and width over one column, such as a passing disturbance.

    ``simulation + amplitude exp(-(x - location)^2 / (2 width^2))``: amplitude in units of the
    output, location and width in those of the column. The location is uniform over the measured
    rows, the width log-uniform from half the distance of neighbouring rows (at most a twentieth of
    the span) to a quarter of the span.

    Parameters
    ----------
    column : str
        Any measured column.
    location : frozen scipy.stats distribution or None, default=None
        Prior of the middle of the bump; bounded.
    axis : Axis
        Where the measured rows lie; `prepare` looks.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> theta = {"location": 2.0, "width": 1.0}
    >>> hs.Bump("t").columns({"t": np.array([2.0, 3.0])}, theta).round(3).ravel().tolist()
    [1.0, 0.607]
    """

    kind = "bump"
    coefficients = ("amplitude",)
    expression = "{amplitude} * np.exp(-0.5 * (({x} - {location}) / {width}) ** 2)"
    units: ClassVar[Mapping[str, str]] = {"amplitude": "{y}", "location": "{x}", "width": "{x}"}

    def priors_by_name(self) -> Mapping[str, Prior]:
        """Return the priors of location and width."""
        low, span = min(self.axis.spacing, 0.1 * self.axis.span), self.axis.span
        width = frozen(stats.loguniform, 0.5 * low, 0.25 * span)
        return {"location": self.location, "width": width}

    def grid(self) -> dict[str, FloatArray]:
        """Return locations and widths."""
        low, high = self.parameters["width"].support()
        return {"location": self.locations(80), "width": np.geomspace(low * 1.1, high / 1.1, 7)}

    def columns(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the bump with height one."""
        z = (X[self.column] - theta["location"]) / theta["width"]
        return np.exp(-0.5 * z**2)[:, None]


register(
    Form(
        "bump",
        Bump,
        over_inputs(Bump),
        meaning="around one place of {column} the data rise or dip, and the simulation does not",
        least_distinct=8,
        headline=(
            "The simulation misses a {amplitude:rise|dip} of {output} by "
            "{amplitude:size} around {column} = {location:place}"
        ),
    )
)


@dataclass(eq=False, repr=False)
class Decay(FromOrigin):
    """A deviation at the beginning that dies away, such as an instrument that warms up.

    ``simulation + amplitude exp(-(x - origin) / scale)``: first-order relaxation from the first
    measured row on, and the full amplitude before it. The amplitude is in units of the output, the
    scale (after which 37 % remains) in units of the column. The scale is log-uniform between two
    distances of neighbouring rows and the measured span.

    Parameters
    ----------
    column : str
        Any measured column.
    scale : frozen scipy.stats distribution or None, default=None
        Prior of the scale; positive.
    origin : float or None, default=None
        Where the amplitude is meant. None: the smallest measured value.
    axis : Axis
        Where the measured rows lie; `prepare` looks.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> decay = hs.Decay("t", origin=1.0)
    >>> decay.columns({"t": np.array([1.0, 3.0])}, {"scale": 2.0}).round(3).ravel().tolist()
    [1.0, 0.368]
    """

    kind = "decay"
    coefficients = ("amplitude",)
    unknowns = ("scale",)
    expression = "{amplitude} * np.exp(-np.maximum({x} - {origin}, 0) / {scale})"
    units: ClassVar[Mapping[str, str]] = {"amplitude": "{y}", "scale": "{x}"}

    column: str
    scale: Prior | None = None
    origin: float | None = None
    axis: Axis = UNKNOWN

    def prepare(self, context: Context) -> Cause:
        """Fill in origin and prior from the measured rows."""
        axis = self.along(context)
        shortest = min(2 * axis.spacing, 0.5 * axis.span)
        scale = self.scale or frozen(stats.loguniform, shortest, axis.span)
        return self.filled(axis=axis, scale=scale)

    def columns(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the share that remains."""
        return np.exp(-self.distance(X) / theta["scale"])[:, None]


register(
    Form(
        "decay",
        Decay,
        over_inputs(Decay),
        meaning="a gap at the start of {column} dies away",
        least_distinct=6,
        headline=(
            "{output} starts {amplitude:size} {amplitude:above|below} the "
            "simulation, and the gap dies away over {scale}"
        ),
    )
)


@dataclass(eq=False, repr=False)
class Episode(Located):
    """An added level between two unknown places: an instrument that read otherwise for some years.

    ``simulation``, and ``+ amplitude`` for location <= x < end. The amplitude is in units of the
    output, location and end in those of the column. The location is uniform over the measured rows.
    Given it the length is log-uniform, from the distance of neighbouring rows (at most a twentieth
    of the span) to the distance of the last row. ``share`` is its quantile in that prior. So an
    episode ends before the last row: one that does not is a `Step`.

    With ``factor=True`` it is ``factor simulation`` there, as where another unit was written down
    for a while; the logarithm of the factor is Laplace with scale 1/3, as that of `Gain`. Where the
    output is logarithmic the added level is that.

    Parameters
    ----------
    column : str
        Any measured column.
    location : frozen scipy.stats distribution or None, default=None
        Prior of the place where it begins; bounded.
    axis : Axis
        Where the measured rows lie; `prepare` looks.
    factor : bool, default=False
        Whether the output is multiplied there.

    Raises
    ------
    ValueError
        When prepared with ``factor=True`` for a logarithmic output.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> from hybridsurrogate.effects.context import Axis
    >>> episode = hs.Episode("t", axis=Axis.of(np.linspace(0, 10, 21)))
    >>> theta = {"location": np.array([2.0]), "share": np.array([0.5])}
    >>> {name: float(values[0]) for name, values in episode.estimates(theta, {}).items()}
    {'location': 2.0, 'end': 4.0}
    >>> episode.columns({"t": np.array([1.0, 2.0, 3.9, 4.0])}, theta).ravel().tolist()
    [0.0, 1.0, 1.0, 0.0]
    """

    kind = "episode"
    forms: ClassVar[Forms] = {("factor", True): "factor"}

    column: str
    location: Prior | None = None
    axis: Axis = UNKNOWN
    factor: bool = False

    @property
    def coefficients(self) -> tuple[str, ...]:  # type: ignore[override]
        """The level that is added."""
        return () if self.factor else ("amplitude",)

    def prepare(self, context: Context) -> Cause:
        """Fill in the axis, and the prior of the location."""
        if self.factor and context.log_scale:
            raise ValueError(
                f"Episode({self.column!r}, factor=True) is for an output itself; where its "
                f"logarithm is measured, Episode({self.column!r}) is a factor."
            )
        return super().prepare(context)

    def priors_by_name(self) -> Mapping[str, Prior]:
        """Return the priors of the location, of the length's share, and of a factor."""
        places = {"location": self.location, "share": frozen(stats.uniform)}
        return {**places, "factor": frozen(stats.loglaplace, 3.0)} if self.factor else places

    def start(self) -> dict[str, float]:
        """Return a factor of one."""
        return {"factor": 1.0} if self.factor else {}

    def grid(self) -> dict[str, FloatArray]:
        """Return locations and shares of lengths."""
        # a factor needs the output at every node: with a quarter of the places the same 22 of 24
        # blind factors lead; with fewer lengths evidences are 0.15 nats off
        most = 20 if self.factor else 80
        return {"location": self.locations(most), "share": (np.arange(10) + 0.5) / 10}

    def end(self, theta: Rows) -> FloatArray:
        """Return where it ends."""
        axis = self.axis
        shortest = min(axis.spacing, 0.05 * axis.span)
        longest = np.maximum(axis.center + 0.5 * axis.span - theta["location"], shortest)
        return theta["location"] + shortest * (longest / shortest) ** theta["share"]

    def _within(self, X: Rows, theta: Rows) -> NDArray[np.bool_]:
        x = X[self.column]
        return np.asarray((x >= theta["location"]) & (x < self.end(theta)))

    def columns(self, X: Rows, theta: Rows) -> FloatArray | None:
        """Return 1 within the episode, 0 elsewhere; nothing where it multiplies."""
        return None if self.factor else self._within(X, theta).astype(float)[:, None]

    def gain(self, X: Rows, theta: Rows) -> FloatArray | float:
        """Return the factor within the episode, 1 elsewhere."""
        return np.where(self._within(X, theta), theta["factor"], 1.0) if self.factor else 1.0

    @property
    def acts_on(self) -> frozenset[Act]:
        """The factor, where there is one."""
        return frozenset({"gain"} if self.factor else ())

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return where it begins and ends, and the amplitude or the factor."""
        size = {"factor": np.asarray(theta["factor"])} if self.factor else coefficients
        begin = np.asarray(theta["location"])
        return {"location": begin, "end": self.end(theta), **size}

    def code(self) -> Code:
        """Return the cause as Python."""
        places, x = {"location": "{x}", "end": "{x}"}, {"x": self.column}
        within = "(({x} >= {location}) & ({x} < {end}))"
        if self.factor:
            whole = f"{{simulated}} * np.where({within}, {{factor}}, 1)"
            return Code(whole, {"factor": "1", **places}, x, does="responds")
        return Code(f"{{amplitude}} * {within}", {"amplitude": "{y}", **places}, x)


register(
    Form(
        "episode",
        Episode,
        over_inputs(Episode),
        meaning=(
            "between two places of {column} {output} has another level, and the simulation has not"
        ),
        least_distinct=8,
        headline=(
            "From {column} = {location:place} to {end:place} {output} is {amplitude:size} "
            "{amplitude:above|below} the simulation"
        ),
    ),
    Form(
        "episode: factor",
        Episode,
        lambda context: (
            Episode(name, factor=True) for name in context.inputs if not context.log_scale
        ),
        meaning=(
            "between two places of {column} {output} is a multiple of what is simulated, as "
            "where another unit was written down"
        ),
        least_distinct=8,
        lacking=needs(
            lambda context: not context.log_scale,
            "the logarithm of the output is measured: episode is the same",
        ),
        headline=(
            "From {column} = {location:place} to {end:place} {output} is {factor} times what the "
            "simulation gives"
        ),
    ),
)


class Ramp(Located):
    """Nothing before an unknown location, a straight line after it: a sensor that starts to drift.

    ``simulation + slope max(x - location, 0)``, the hinge of piecewise linear regression (Friedman
    1991, Annals of Statistics 19:1). The slope is in units of the output per unit of the
    column; the location is uniform over the measured rows.

    Parameters
    ----------
    column : str
        Any measured column.
    location : frozen scipy.stats distribution or None, default=None
        Prior of the place where the change sets in; bounded.
    axis : Axis
        Where the measured rows lie; `prepare` looks.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> from hybridsurrogate.effects.context import Axis
    >>> ramp = hs.Ramp("t", axis=Axis.of([0.0, 10.0]))
    >>> ramp.columns({"t": np.array([2.0, 4.0, 9.0])}, {"location": 4.0}).ravel().tolist()
    [0.0, 0.0, 0.5]
    """

    kind = "ramp"
    coefficients = ("slope",)
    unknowns = ("location",)
    expression = "{slope} * np.maximum({x} - {location}, 0)"
    units: ClassVar[Mapping[str, str]] = {"location": "{x}", "slope": "{y} / {x}"}

    def grid(self) -> dict[str, FloatArray]:
        """Return locations; a hinge needs fewer than a step does."""
        return {"location": self.locations(60)}

    def columns(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the distance beyond the location, in spans of the measured rows."""
        return (np.maximum(X[self.column] - theta["location"], 0.0) / self.axis.span)[:, None]

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return the location, and the slope per unit of the column after it."""
        return {
            "location": np.asarray(theta["location"]),
            "slope": coefficients["slope"] / self.axis.span,
        }


register(
    Form(
        "ramp",
        Ramp,
        over_inputs(Ramp),
        meaning="from one place of {column} on the gap grows steadily",
        least_distinct=6,
        headline=(
            "From {column} = {location:place} on {output} {slope:rises above|falls "
            "below} the simulation by {slope:size}"
        ),
    )
)


@dataclass(eq=False, repr=False)
class Saturation(FromOrigin):
    """A deviation that grows over a column and levels off, such as binding sites that fill up.

    ``simulation + amplitude u / (u + half - origin)`` with u = x - origin (zero before it): the
    rate law of Michaelis and Menten (1913, Biochemische Zeitschrift 49:333). The amplitude is what
    is reached in the end, in units of the output; ``half`` is the place in units of the column at
    which half of it is reached. Its distance from the origin is log-uniform between one distance
    of neighbouring rows and the measured span.

    Parameters
    ----------
    column : str
        Any measured column.
    half : frozen scipy.stats distribution or None, default=None
        Prior of the place where half is reached; above the origin.
    origin : float or None, default=None
        Where the deviation begins. None: the smallest measured value.
    axis : Axis
        Where the measured rows lie; `prepare` looks.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> filling = hs.Saturation("dose", origin=0.0)
    >>> filling.columns({"dose": np.array([0.0, 2.0, 6.0])}, {"half": 2.0}).ravel().tolist()
    [0.0, 0.5, 0.75]
    """

    kind = "saturation"
    coefficients = ("amplitude",)
    unknowns = ("half",)

    column: str
    half: Prior | None = None
    origin: float | None = None
    axis: Axis = UNKNOWN

    def prepare(self, context: Context) -> Cause:
        """Fill in origin and prior from the measured rows."""
        axis = self.along(context)
        begin = axis.origin if self.origin is None else self.origin
        shortest = min(axis.spacing, 0.5 * axis.span)
        half = self.half or frozen(stats.loguniform, shortest, axis.span, loc=begin)
        return self.filled(axis=axis, half=half)

    def columns(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the share that is reached."""
        u = self.distance(X)
        return (u / (u + (theta["half"] - self.pivot)))[:, None]

    def code(self) -> Code:
        """Return the cause as Python."""
        return Code(
            "{amplitude} * {beyond} / ({beyond} + ({half} - {origin}))",
            {"amplitude": "{y}", "half": "{x}"},
            {"x": self.column},
            {"origin": self.pivot},
            steps={"beyond": "np.maximum({x} - {origin}, 0)"},
        )


register(
    Form(
        "saturation",
        Saturation,
        over_inputs(Saturation),
        meaning="a gap grows over {column} and levels off",
        least_distinct=6,
        headline=(
            "{output} {amplitude:rises above|falls below} the simulation over "
            "{column} and levels off"
        ),
    )
)


@dataclass(eq=False, repr=False)
class Step(Located):
    """A sudden change of level at an unknown location over one column.

    ``simulation + amplitude`` from x = location on; with ``before=True`` ``simulation - amplitude``
    up to there instead, and the simulation as it is from there on. Either way the amplitude is the
    change of level at the location. Where the simulation has a parameter that sets its level the
    two are the same curve. Amplitude in units of the output,
    location in those of the column and uniform over the measured rows. The jump has no width: no
    row lies on it, and between two rows every location is equally probable.

    Parameters
    ----------
    column : str
        Any measured column.
    location : frozen scipy.stats distribution or None, default=None
        Prior of the place of the jump; bounded.
    before : bool, default=False
    axis : Axis
        Where the measured rows lie; `prepare` looks.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> step = hs.Step("t")
    >>> step.columns({"t": np.array([1.0, 4.0])}, {"location": 2.5}).ravel().tolist()
    [0.0, 1.0]
    """

    kind = "step"
    forms: ClassVar[Forms] = {("before", True): "before"}
    coefficients = ("amplitude",)
    unknowns = ("location",)
    units: ClassVar[Mapping[str, str]] = {"location": "{x}", "amplitude": "{y}"}

    column: str
    location: Prior | None = None
    before: bool = False
    axis: Axis = UNKNOWN

    def grid(self) -> dict[str, FloatArray]:
        """Return the gaps between neighbouring rows; of many rows two locations a distance."""
        many = len(self.axis.rows) > MAX_TRIED_ROWS
        return {
            "location": self.locations(MAX_TRIED_ROWS) if many else self.axis.gaps(self.location)
        }

    def columns(self, X: Rows, theta: Rows) -> FloatArray:
        """Return 0 before and 1 from the location on, or -1 before and 0 from there on."""
        after = (X[self.column] >= theta["location"]).astype(float)
        return (after - self.before)[:, None]

    @property
    def expression(self) -> str:  # type: ignore[override]
        """The level that is added from the location on, or missing before it."""
        if self.before:
            return "-{amplitude} * ({x} < {location})"
        return "{amplitude} * ({x} >= {location})"


register(
    Form(
        "step",
        Step,
        over_columns(Step),
        meaning="{output} changes level at one place of {column}, and the simulation does not",
        least_distinct=6,
        headline=(
            "At {column} = {location:place} {output} {amplitude:rises|falls} by "
            "{amplitude:size}, and the simulation does not"
        ),
    ),
    Form(
        "step: before",
        Step,
        over_columns(lambda column: Step(column, before=True)),
        least_distinct=6,
    ),
)
