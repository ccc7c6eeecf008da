"""Noise of one experiment that differs from that of the others."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from scipy import stats

from hybridsurrogate.effects.base import Cause, Context, Declared, FloatArray, Rows
from hybridsurrogate.effects.code import Code
from hybridsurrogate.effects.ignored.missing_input import trouble_with_levels
from hybridsurrogate.effects.registry import Form, register
from hybridsurrogate.priors import frozen
from hybridsurrogate.types import Prior


class NoiseAtLevel(Declared):
    """Noise that is larger or smaller where a column has one value; the simulation is right.

    One bad batch, one bad sensor: the standard deviation is ``ratio sigma`` there, and sigma
    everywhere else. The ratio is log-normal around one, mostly between 1/7 and 7.

    Parameters
    ----------
    column : str
        A measured column that labels experiments.
    level : float
        The value that is meant.
    ratio : frozen scipy.stats distribution or None, default=None
        Prior of the ratio.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> bad = hs.NoiseAtLevel("batch", 3)
    >>> bad.noise({"batch": np.array([1.0, 3.0])}, {"ratio": np.full(2, 4.0)}).tolist()
    [1.0, 4.0]
    """

    kind = "noise"
    about = "column"
    unknowns = ("ratio",)
    is_one_level = True

    def __init__(self, column: str, level: float, ratio: Prior | None = None):
        self.column = column
        self.level = level
        self.ratio = ratio

    @property
    def variant(self) -> str:
        """The level."""
        return f"level {self.level:.12g}"

    @property
    def name(self) -> str:
        """The kind, the column and the level."""
        return f"{self.kind}({self.column} = {self.level:.12g})"

    def prepare(self, context: Context) -> Cause:
        """Fill in the prior; raise ValueError where the level is never measured."""
        found = np.unique(context.column(self.column))
        if self.level not in found:
            raise ValueError(f"{self.column!r} is never {self.level!r}; it is {list(found)}.")
        return self if self.ratio is not None else self.filled(ratio=frozen(stats.lognorm, 1.0))

    def noise(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the factor on the noise scale."""
        return np.where(X[self.column] == self.level, theta["ratio"], 1.0)

    def code(self) -> Code:
        """Return the cause as Python."""
        return Code(
            "{sigma} * np.where({x} == {level}, {ratio}, 1)",
            {"ratio": "1"},
            {"x": self.column},
            levels={"level": (self.column, self.level)},
            does="scatters",
            name="noise_sd",
        )

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        there = f"where {self.column} = {self.level:.12g}"
        return f"simulation, with {values['ratio']:.4g} times the noise {there}"


def _at_levels(context: Context) -> Iterator[Cause]:
    for column in context.labels:
        if trouble_with_levels(context, column) is None:
            for level in np.unique(context.X[column]):
                yield NoiseAtLevel(column, float(level))


register(
    Form(
        "noise: level",
        NoiseAtLevel,
        _at_levels,
        meaning="the measurements scatter more, or less, in one experiment of {target} than in the "
        "others",
        least_rows=12,
        headline="{output} scatters differently at one value of {target}",
        call="`NoiseAtLevel(e, level=2)`",
        formula="eta; noise ratio sigma where the label e is 2",
        priors="ratio: log-normal, s = 1",
        estimates="ratio",
        left_out="no column of labels (declared, or 1, 2, 3 ...); more than 20 labels, "
        "or one with fewer than 3 rows",
    )
)
