"""Something that begins at one place of a column and ends at another."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import stats

from hybridsurrogate.effects.base import FloatArray, Rows
from hybridsurrogate.effects.code import Code
from hybridsurrogate.effects.over_column import Located
from hybridsurrogate.effects.registry import Form, over_inputs, register
from hybridsurrogate.priors import frozen
from hybridsurrogate.types import Prior


class Episode(Located):
    """An added level between two unknown places: an instrument that read otherwise for some years.

    ``simulation``, and ``+ amplitude`` for location <= x < end. The amplitude is in units of the
    output, location and end in those of the column. The location is uniform over the measured rows.
    Given it the length is log-uniform, from the distance of neighbouring rows (at most a twentieth
    of the span) to the distance of the last row. ``share`` is its quantile in that prior. So an
    episode ends before the last row: one that does not is a `Step`.

    Parameters
    ----------
    column : str
        Any measured column.
    location : frozen scipy.stats distribution or None, default=None
        Prior of the place where it begins; bounded.
    axis : Axis
        Where the measured rows lie; `prepare` looks.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> from hybridsurrogate.effects.axis import Axis
    >>> episode = hs.Episode("t", axis=Axis.of(np.linspace(0, 10, 21)))
    >>> theta = {"location": np.array([2.0]), "share": np.array([0.5])}
    >>> {name: float(values[0]) for name, values in episode.estimates(theta, {}).items()}
    {'location': 2.0, 'end': 4.0}
    >>> episode.columns({"t": np.array([1.0, 2.0, 3.9, 4.0])}, theta).ravel().tolist()
    [0.0, 1.0, 1.0, 0.0]
    """

    kind = "episode"
    coefficients = ("amplitude",)

    def priors_by_name(self) -> Mapping[str, Prior]:
        """Return the priors of the location and of the length's share."""
        return {"location": self.location, "share": frozen(stats.uniform)}

    def grid(self) -> dict[str, FloatArray]:
        """Return locations and shares of lengths."""
        return {"location": self.locations(80), "share": (np.arange(10) + 0.5) / 10}

    def end(self, theta: Rows) -> FloatArray:
        """Return where it ends."""
        axis = self.axis
        shortest = min(axis.spacing, 0.05 * axis.span)
        longest = np.maximum(axis.center + 0.5 * axis.span - theta["location"], shortest)
        return theta["location"] + shortest * (longest / shortest) ** theta["share"]

    def columns(self, X: Rows, theta: Rows) -> FloatArray:
        """Return 1 within the episode, 0 elsewhere."""
        x = X[self.column]
        return ((x >= theta["location"]) & (x < self.end(theta))).astype(float)[:, None]

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return where it begins and ends, and the amplitude."""
        begin = np.asarray(theta["location"])
        return {"location": begin, "end": self.end(theta), **coefficients}

    def code(self) -> Code:
        """Return the cause as Python."""
        return Code(
            "{amplitude} * (({x} >= {location}) & ({x} < {end}))",
            {"amplitude": "{y}", "location": "{x}", "end": "{x}"},
            {"x": self.column},
        )


register(
    Form(
        "episode",
        Episode,
        over_inputs(Episode),
        meaning="between two places of {column} {output} has another level, and the simulation "
        "has not",
        least_distinct=8,
        like=("step", "bump"),
        headline=(
            "From {column} = {location:place} to {end:place} {output} is {amplitude:size} "
            "{amplitude:above|below} the simulation"
        ),
        formula="eta, + amplitude from location to end",
        priors="location: uniform over the rows; length: log-uniform, a spacing (at most a "
        "twentieth of the span) to the distance of the last row",
        estimates="location, end, amplitude",
        left_out="fewer than 8 distinct values",
    )
)
