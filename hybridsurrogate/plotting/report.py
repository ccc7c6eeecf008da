"""The pictures of a diagnosis: functions that take numbers and the Axes to draw on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from hybridsurrogate.plotting.style import (
    AFTER,
    ALTERNATIVES,
    BEFORE,
    DATA,
    QUIET,
    new_axes,
    tidy,
)
from hybridsurrogate.types import FloatArray

_FEW_VALUES, _LITTLE_INFORMATION = 12, 0.05


class Prediction(NamedTuple):
    """Predictions at some rows: mean and central intervals, all of shape (n,).

    Examples
    --------
    >>> import numpy as np
    >>> from hybridsurrogate.plotting import Prediction
    >>> mean = np.array([2.0, 3.0])
    >>> predicted = Prediction(mean, mean - 0.5, mean + 0.5, mean - 1, mean + 1)
    >>> predicted.upper90 - predicted.lower90
    array([2., 2.])
    """

    mean: FloatArray
    lower50: FloatArray
    upper50: FloatArray
    lower90: FloatArray
    upper90: FloatArray


def plot_prediction(
    ax: Axes, x: FloatArray, predicted: Prediction, colour: str, label: str, curve: bool = True
) -> Axes:
    """Draw predictions with their 50 % and 90 % intervals.

    Parameters
    ----------
    ax : Axes
    x : ndarray of shape (n,)
    predicted : Prediction
    colour, label : str
    curve : bool
        Whether the rows lie on a line, so that bands make sense; else one bar for each row.

    Returns
    -------
    matplotlib Axes

    Examples
    --------
    >>> import numpy as np
    >>> from matplotlib.figure import Figure
    >>> from hybridsurrogate.plotting import BEFORE, Prediction, plot_prediction
    >>> x = np.array([0.0, 1.0])
    >>> predicted = Prediction(x, x - 0.5, x + 0.5, x - 1, x + 1)
    >>> ax = plot_prediction(Figure().subplots(), x, predicted, BEFORE, "before")
    >>> len(ax.collections), ax.lines[0].get_label()
    (2, 'before, 50 and 90 % bands')
    """
    if curve:
        ax.fill_between(x, predicted.lower90, predicted.upper90, color=colour, alpha=0.18, lw=0)
        ax.fill_between(x, predicted.lower50, predicted.upper50, color=colour, alpha=0.3, lw=0)
        ax.plot(x, predicted.mean, color=colour, lw=1.5, label=f"{label}, 50 and 90 % bands")
        return ax
    ax.vlines(x, predicted.lower90, predicted.upper90, color=colour, alpha=0.25, lw=1)
    ax.vlines(x, predicted.lower50, predicted.upper50, color=colour, alpha=0.6, lw=2)
    ax.plot(x, predicted.mean, "_", color=colour, ms=6, label=f"{label}, 50 and 90 % intervals")
    return ax


def plot_discrepancy(
    ax: Axes, x: FloatArray, mean: FloatArray, lower: FloatArray, upper: FloatArray
) -> Axes:
    """Draw a smooth discrepancy with its 90 % band around the line of no discrepancy.

    Parameters
    ----------
    ax : Axes
    x, mean, lower, upper : ndarray of shape (n,)

    Returns
    -------
    matplotlib Axes

    Examples
    --------
    >>> import numpy as np
    >>> from matplotlib.figure import Figure
    >>> from hybridsurrogate.plotting import plot_discrepancy
    >>> x = np.array([0.0, 1.0])
    >>> ax = plot_discrepancy(Figure().subplots(), x, 2 * x, 2 * x - 1, 2 * x + 1)
    >>> ax.lines[1].get_label()
    'smooth discrepancy, 90 % band'
    """
    ax.axhline(0, color=QUIET, lw=1)
    label = "smooth discrepancy, 90 % band"
    ax.fill_between(x, lower, upper, color=BEFORE, alpha=0.25, lw=0)
    ax.plot(x, mean, color=BEFORE, label=label)
    return ax


def plot_parameter_course(table: pd.DataFrame, ax: Axes | None = None) -> Axes:
    """Draw a parameter that varies over an input with its 90 % band, and its constant value.

    Parameters
    ----------
    table : DataFrame
        Of `DiscrepancyDiagnosis.parameter_course`, of one parameter.
    ax : matplotlib Axes, optional

    Returns
    -------
    matplotlib Axes

    Raises
    ------
    ValueError
        For several parameters.

    Examples
    --------
    >>> import pandas as pd
    >>> from hybridsurrogate.plotting import plot_parameter_course
    >>> course = {"x": [0.0, 9.0], "mean": [1, 2], "lower": [0, 1], "upper": [2, 3]}
    >>> table = pd.DataFrame(course).assign(parameter="rate", over="t", constant=1.4)
    >>> ax = plot_parameter_course(table)
    >>> ax.get_xlabel(), ax.get_ylabel(), len(ax.lines)
    ('t', 'rate', 2)
    """
    names = table["parameter"].unique()
    if len(names) != 1:
        raise ValueError(
            f"The table is of {len(names)} parameters, {list(names)}: draw one at a time, "
            "table[table['parameter'] == name]."
        )
    ax = new_axes()[0] if ax is None else ax
    ax.fill_between(table["x"], table["lower"], table["upper"], color=AFTER, alpha=0.25, lw=0)
    ax.plot(table["x"], table["mean"], color=AFTER, label="as it would have to vary, 90 % band")
    constant = float(table["constant"].iloc[0])
    ax.axhline(constant, color=BEFORE, lw=1, ls="--", label="constant, as simulated")
    return tidy(ax, str(table["over"].iloc[0]), str(names[0]))


def plot_causes(
    ax: Axes, names: Sequence[str], probabilities: Sequence[float], chosen: int | None
) -> Axes:
    """Draw probabilities as horizontal bars, the first on top, the chosen one in colour.

    Parameters
    ----------
    ax : Axes
    names : sequence of str
    probabilities : sequence of float
    chosen : int or None
        Position of the one that is meant by the verdict.

    Returns
    -------
    matplotlib Axes

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> from hybridsurrogate.plotting import plot_causes
    >>> ax = plot_causes(Figure().subplots(), ["step", "trend"], [0.9, 0.1], chosen=0)
    >>> [round(bar.get_width()) for bar in ax.patches]
    [90, 10]
    """
    places = np.arange(len(names))[::-1]
    colours = [AFTER if k == chosen else QUIET for k in range(len(names))]
    bars = ax.barh(places, 100 * np.asarray(probabilities), color=colours, height=0.7)
    ax.bar_label(bars, fmt=_percent, padding=3, fontsize="small")
    ax.set_yticks(places, labels=list(names))
    ax.set_xlim(0, 118)
    ax.set_xlabel("probability in %")
    ax.set_ylabel("what is wrong")
    ax.set_xticks(range(0, 101, 25))
    ax.spines[["top", "right"]].set_visible(False)
    return ax


def plot_alternatives(
    ax: Axes, x: FloatArray, means: Sequence[FloatArray], names: Sequence[str], place: float
) -> Axes:
    """Draw what each alternative predicts, and the place at which they differ most.

    Parameters
    ----------
    ax : Axes
    x : ndarray of shape (n,)
    means : sequence of ndarray of shape (n,)
        One for each alternative; the first four are drawn.
    names : sequence of str
    place : float

    Returns
    -------
    matplotlib Axes

    Examples
    --------
    >>> import numpy as np
    >>> from matplotlib.figure import Figure
    >>> from hybridsurrogate.plotting import plot_alternatives
    >>> x = np.linspace(0, 1, 20)
    >>> ax = plot_alternatives(Figure().subplots(), x, [x, x**2], ["trend", "ramp"], place=0.5)
    >>> [line.get_label() for line in ax.lines]
    ['trend', 'ramp', 'measure here']
    """
    # a column with a few values is no line
    mark = "o" if len(x) <= _FEW_VALUES else ""
    for mean, name, (colour, style) in zip(means, names, ALTERNATIVES, strict=False):
        ax.plot(x, mean, color=colour, ls=style, lw=1.6, marker=mark, label=name)
    ax.axvline(place, color=DATA, lw=1, ls=(0, (1, 1)), label="measure here")
    return ax


def plot_information(ax: Axes, x: FloatArray, information: FloatArray, place: float) -> Axes:
    """Draw the expected information of one more measurement, over a column.

    Parameters
    ----------
    ax : Axes
    x : ndarray of shape (n,)
    information : ndarray of shape (n,)
        In bits.
    place : float
        Where to measure.

    Returns
    -------
    matplotlib Axes

    Examples
    --------
    >>> import numpy as np
    >>> from matplotlib.figure import Figure
    >>> from hybridsurrogate.plotting import plot_information
    >>> x = np.linspace(0, 1, 21)
    >>> ax = plot_information(Figure().subplots(), x, 4 * x * (1 - x), place=0.5)
    >>> ax.get_ylabel().split()
    ['information', 'in', 'bits']
    """
    ax.plot(x, information, color=DATA, marker="o" if len(x) <= _FEW_VALUES else "")
    ax.axvline(place, color=DATA, lw=1, ls=(0, (1, 1)))
    ax.set_ylabel("information\nin bits")
    # next to nothing shall look like it
    ax.set_ylim(0, max(float(ax.get_ylim()[1]), _LITTLE_INFORMATION))
    return ax


def _percent(value: float) -> str:
    if value >= 99.95:
        return "> 99.9 %"
    return f"{value:.1f} %" if value >= 0.1 else "< 0.1 %"
