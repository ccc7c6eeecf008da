"""A cause as Python source: the expression that a written module makes a function of."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

from hybridsurrogate.effects.context import Rows
from hybridsurrogate.types import FloatArray

Does = Literal[
    "adds",
    "responds",
    "moves",
    "replaces",
    "scales rate",
    "adds to slope",
    "delays",
    "scatters",
    "nothing",
]
# tables of numbers by name, made of draws of theta and of the coefficients
Tables = Callable[[Rows, Rows], dict[str, FloatArray]]


@dataclass(frozen=True)
class LevelTable:
    """Numbers of a cause that belong to the levels of a column.

    Attributes
    ----------
    column : str
    levels : tuple of (float, str)
        Each level, and the name of its number.
    unit : str
        As in `Code.numbers`.
    """

    column: str
    levels: tuple[tuple[float, str], ...]
    unit: str = "{y}"


@dataclass(frozen=True)
class Code:
    """What a cause does, as an expression of numpy.

    Names in braces are replaced by what is named below. ``{simulated}`` is the output on the scale
    on which causes act, ``{of}`` the quantity that is moved, and ``{sigma}`` the standard deviation
    of the noise. Of an ODE ``{t}`` is the time and ``{step}`` the solver's step.

    Attributes
    ----------
    expression : str
    numbers : mapping of str to str
        Names of the numbers, as `Cause.estimates` or else the cause's parameters have them,
        and their units: ``{y}`` is that of the output on the scale on which causes act,
        ``{plain}`` that of the output itself; names of columns and states stand for theirs.
    columns : mapping of str to str
        The measured column that each name stands for.
    constants : mapping of str to float
    levels : mapping of str to (str, float)
        Values of a column of labels: the column and the value.
    steps : mapping of str to str
        Variables that the expression uses, in order.
    does : str
        The expression "adds" to the output, is what the output becomes ("responds"), what a column
        or a parameter becomes ("moves"), or the noise ("scatters"); a number "replaces" a parameter
        or constant. Of an ODE it "scales rate", "adds to slope", or is how long ago the state is
        seen ("delays"). "nothing": what it changes is not in the simulation.
    of : str
        The column, parameter or state concerned.
    states : mapping of str to str
        The state of an ODE that each name stands for.
    table : Table or None
        ``{table}`` in the expression.
    unseen : str
        The slope of an unseen state, ``{store}``, that takes what the expression adds to a slope,
        over ``{ratio}``, and begins at that state plus ``{gap}``.
    by_row : mapping of str to str
        Numbers of an ODE that differ between rows, as expressions.
    grids : mapping of str to (float, float, int)
        Ends and number of places of grids on which ``tables`` store a curve.
    tables : callable or None
        ``(theta, coefficients) -> {name: array}``; means over draws.
    arguments : mapping of str to str
        What else the noise depends on, with words for it.
    note : str
        What a formula says in brackets of a number that replaces another.
    name : str
        Of the function; empty: that of the kind.
    output : str or None
        Of several outputs the one concerned.

    Examples
    --------
    >>> line = Code("{slope} * {x}", {"slope": "{y} / {x}"}, {"x": "t"})
    >>> line.does, line.expression.format(slope="slope", x="t")
    ('adds', 'slope * t')
    """

    expression: str
    numbers: Mapping[str, str] = field(default_factory=dict)
    columns: Mapping[str, str] = field(default_factory=dict)
    constants: Mapping[str, float] = field(default_factory=dict)
    levels: Mapping[str, tuple[str, float]] = field(default_factory=dict)
    steps: Mapping[str, str] = field(default_factory=dict)
    does: Does = "adds"
    of: str = ""
    states: Mapping[str, str] = field(default_factory=dict)
    unseen: str = ""
    table: LevelTable | None = None
    by_row: Mapping[str, str] = field(default_factory=dict)
    grids: Mapping[str, tuple[float, float, int]] = field(default_factory=dict)
    tables: Tables | None = None
    arguments: Mapping[str, str] = field(default_factory=dict)
    note: str = ""
    name: str = ""
    output: str | None = None


def names_in(template: str) -> list[str]:
    """Return the names in braces."""
    return re.findall(r"(?<!\{)\{(\w+)\}", template)
