"""The pictures of a diagnosis: overview, report, predictive checks, the emulator."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from numpy.typing import ArrayLike, NDArray
from scipy import stats
from sklearn.utils.validation import check_is_fitted

from hybridsurrogate.plotting.style import (
    AFTER,
    ALTERNATIVES,
    BEFORE,
    DATA,
    NINE_TENTHS,
    QUIET,
    grid_of_axes,
    list_names,
    new_axes,
    share_range,
    tidy,
)
from hybridsurrogate.simulation.variables import MAX_LEVELS
from hybridsurrogate.types import FloatArray

if TYPE_CHECKING:
    from hybridsurrogate.emulators.emulator import Emulator


def plot_residuals(ax: Axes, x: FloatArray, residual: FloatArray, colour: str, title: str) -> Axes:
    """Draw residuals over a column, with their root mean square in the title.

    Parameters
    ----------
    ax : Axes
    x, residual : ndarray of shape (n,)
    colour, title : str

    Returns
    -------
    matplotlib Axes

    Examples
    --------
    >>> import numpy as np
    >>> from matplotlib.figure import Figure
    >>> from hybridsurrogate.plotting import BEFORE, plot_residuals
    >>> residual = np.array([2.0, -2.0])
    >>> ax = plot_residuals(Figure().subplots(), np.arange(2), residual, BEFORE, "before")
    >>> ax.get_title()
    'before: root mean square 2'
    """
    ax.axhline(0, color=QUIET, lw=1)
    ax.plot(x, residual, ".", color=colour, ms=4 if len(x) <= 150 else 2.5)
    rms = np.sqrt(np.mean(residual**2))
    ax.set_title(f"{title}: root mean square {rms:.3g}", fontsize="medium")
    return ax


def plot_quantiles(ax: Axes, z: FloatArray, colour: str, mark: str, label: str) -> Axes:
    """Draw sorted standardised residuals against the quantiles of the standard normal.

    Parameters
    ----------
    ax : Axes
    z : ndarray of shape (n,)
        Standard normal if the predictive distribution is right.
    colour, mark, label : str

    Returns
    -------
    matplotlib Axes

    Examples
    --------
    >>> import numpy as np
    >>> from matplotlib.figure import Figure
    >>> from hybridsurrogate.plotting import BEFORE, plot_quantiles
    >>> z = np.array([1.0, 0.0, -1.0])
    >>> ax = plot_quantiles(Figure().subplots(), z, BEFORE, "o", "before")
    >>> ax.lines[1].get_ydata()
    array([-1.,  0.,  1.])
    """
    n = len(z)
    expected = stats.norm.ppf((np.arange(n) + 0.5) / n)
    end = float(expected[-1])
    ax.plot([-end, end], [-end, end], color=QUIET, lw=1)
    ax.plot(expected, np.sort(z), mark, color=colour, ms=4, mfc="none", label=label)
    ax.set_xlabel("expected of a standard normal")
    ax.set_ylabel("standardised residual")
    return ax


def plot_scores(
    ax: Axes, names: Sequence[str], before: FloatArray, after: FloatArray, error: FloatArray
) -> Axes:
    """Draw held-out scores before and after, one line for each fold.

    Parameters
    ----------
    ax : Axes
    names : sequence of str
    before, after : ndarray of shape (n,)
        After may be NaN where nothing was added.
    error : ndarray of shape (n,)
        Standard error of the difference, drawn on the score after; NaN: none.

    Returns
    -------
    matplotlib Axes

    Examples
    --------
    >>> import numpy as np
    >>> from matplotlib.figure import Figure
    >>> from hybridsurrogate.plotting import plot_scores
    >>> before, after, error = np.array([[-2.0, -1.0], [-1.5, -0.5], [0.1, 0.2]])
    >>> ax = plot_scores(Figure().subplots(), ["fold 1", "fold 2"], before, after, error)
    >>> ax.lines[0].get_xdata()
    array([-2., -1.])
    """
    places = list_names(ax, names)
    ax.hlines(places, before, after, color=QUIET, lw=1)
    ax.plot(before, places, "o", color=BEFORE, ms=6, label="before")
    if np.isfinite(after).any():
        bar = np.where(np.isfinite(error), error, 0.0)
        label = "after, ± error of the difference"
        ax.errorbar(after, places, xerr=bar, fmt="s", color=AFTER, ms=5, capsize=3, label=label)
    ax.set_xlabel("held-out log density per row\n(further right is better)")
    return ax


def plot_coverage(
    ax: Axes, names: Sequence[str], shares: FloatArray, n_rows: Sequence[int], level: float
) -> Axes:
    """Draw the share of held-out rows inside an interval against what it should be.

    Parameters
    ----------
    ax : Axes
    names : sequence of str
    shares : ndarray of shape (n,)
    n_rows : sequence of int
        How many rows each share is of, for its standard error.
    level : float
        What the shares should be.

    Returns
    -------
    matplotlib Axes

    Examples
    --------
    >>> import numpy as np
    >>> from matplotlib.figure import Figure
    >>> from hybridsurrogate.plotting import plot_coverage
    >>> shares = np.array([0.7, 0.9])
    >>> ax = plot_coverage(Figure().subplots(), ["before", "after"], shares, [20, 20], level=0.9)
    >>> ax.get_xlabel()
    'rows in the 90 % interval, %'
    """
    places = list_names(ax, names)
    error = np.sqrt(level * (1 - level) / np.asarray(n_rows))
    ax.axvline(100 * level, color=QUIET, lw=1, ls="--", label=f"should be {100 * level:g} %")
    for place, share, bar, name in zip(places, shares, error, names, strict=True):
        colour, mark = (BEFORE, "o") if "before" in name else (AFTER, "s")
        ax.errorbar(100 * share, place, xerr=100 * bar, fmt=mark, color=colour, ms=5, capsize=3)
    ax.set_xlim(right=min(float(ax.get_xlim()[1]), 102))
    # where names leave little room the label would run over the edge
    ax.set_xlabel(f"rows in the {100 * level:g} % interval, %", loc="right")
    return ax


def plot_emulator(emulator: Emulator, axes: ArrayLike | None = None) -> NDArray[np.object_]:
    """Draw runs left out against what an emulator of all others predicts, and their PIT.

    Left the predictions with 90 % intervals, on the line where they are exact; right a histogram of
    where the runs lie in their predictive distributions: level if the intervals are right, a hill
    where they are too wide, a valley where they are too narrow.

    Parameters
    ----------
    emulator : Emulator
        Fitted.
    axes : array of matplotlib Axes of shape (n_outputs, 2), or None

    Returns
    -------
    ndarray of matplotlib Axes, shape (n_outputs, 2)

    Raises
    ------
    sklearn.exceptions.NotFittedError
        Before ``fit``.

    Examples
    --------
    >>> import hybridsurrogate as hs
    >>> from hybridsurrogate.datasets import make_log_sin
    >>> from hybridsurrogate.plotting import plot_emulator
    >>> emulator = hs.Emulator("polynomial").fit(make_log_sin(random_state=0).simulation)
    >>> plot_emulator(emulator).shape
    (1, 2)
    """
    check_is_fitted(emulator, "left_out_")
    left_out = emulator.left_out_
    grid = grid_of_axes(axes, (len(left_out), 2), 8.0, 3.6 * len(left_out))
    for (name, one), (scatter, histogram) in zip(left_out.items(), grid, strict=True):
        some = np.linspace(0, len(one.y) - 1, min(len(one.y), 2000)).astype(int)
        y, mean, sd = one.y[some], one.mean[some], one.sd[some]
        scatter.errorbar(y, mean, NINE_TENTHS * sd, fmt=".", color=AFTER, elinewidth=0.7, ms=3)
        scatter.axline((y.min(), y.min()), slope=1.0, color=DATA, lw=0.8)
        scatter.set(xlabel=f"{name}, simulated", ylabel=f"{name}, predicted without the run")
        scatter.set_title(f"Q² = {one.q2:.4g}")
        histogram.hist(one.pit, np.linspace(0, 1, 11), density=True, color=AFTER)
        histogram.axhline(1.0, color=DATA, lw=0.8)
        histogram.set(xlabel="PIT of runs left out", ylabel="density")
        histogram.set_title(f"{100 * one.coverage():.0f} % within 90 % intervals")
    return grid


class Predicted(NamedTuple):
    """What a model predicts, and its residuals at the measured rows.

    Attributes
    ----------
    x : ndarray of shape (m,)
    prediction : Prediction
        At x.
    residual : ndarray of shape (n,)
        Measured minus predicted at the measured rows.

    Examples
    --------
    >>> import numpy as np
    >>> from hybridsurrogate.plotting import Predicted, Prediction
    >>> mean, y = np.array([2.0, 3.0]), np.array([2.5, 2.5])
    >>> band = Prediction(mean, mean - 0.5, mean + 0.5, mean - 1, mean + 1)
    >>> Predicted(np.array([0.0, 1.0]), band, y - mean).residual
    array([ 0.5, -0.5])
    """

    x: FloatArray
    prediction: Prediction
    residual: FloatArray


def plot_overview(
    x: FloatArray,
    y: FloatArray,
    before: Predicted,
    after: Predicted | None = None,
    held_out: tuple[FloatArray, FloatArray] | None = None,
    curve: bool = True,
    labels: tuple[str, str, str] = ("x", "y", "residual"),
    axes: Sequence[Axes] | None = None,
    y_err: FloatArray | None = None,
    side: NDArray[np.int_] | None = None,
    held_side: NDArray[np.int_] | None = None,
) -> list[Axes]:
    """Draw measurements, a simulation and its extension with 90 % intervals, and the residuals.

    Parameters
    ----------
    x, y : ndarray of shape (n,)
        Measurements.
    before : Predicted
        The calibrated simulation.
    after : Predicted or None
        The extended model.
    held_out : (x, y) or None
        Measurements that no fit has seen.
    curve : bool, default=True
        Whether predictions lie on a line; else they are drawn at the measured rows alone.
    labels : (str, str, str)
        Of the x axis, the y axis, and the y axis of the residuals.
    axes : sequence of two matplotlib Axes, default=None
        None: those of a new figure without a window.
    y_err : ndarray of shape (n,) or None, default=None
        Known standard deviations of the measurements: bars.
    side : ndarray of int of shape (n,) or None, default=None
        -1 where a measurement is an upper bound of the value, 1 where it is a lower bound: arrows
        that point to where the value is.
    held_side : ndarray of int or None, default=None
        The same of ``held_out``.

    Returns
    -------
    list of two matplotlib Axes

    Examples
    --------
    >>> import numpy as np
    >>> from hybridsurrogate.plotting import Predicted, Prediction, plot_overview
    >>> x = np.linspace(0, 1, 5)
    >>> flat = Prediction(0 * x, x - 1, x + 1, x - 2, x + 2)
    >>> top, below = plot_overview(x, x, Predicted(x, flat, x))
    >>> top.get_legend_handles_labels()[1]
    ['simulation, calibrated', 'measured']
    """
    top, below = grid_of_axes(None if axes is None else np.asarray(axes), (2, 1), 7.2, 4.8).ravel()
    size = 3.0 if len(x) <= 400 else 1.6
    raster = len(x) > 1200
    series = [(before, BEFORE, "simulation, calibrated", "s")]
    if after is not None:
        series.append((after, AFTER, "extended model", "o"))
    below.axhline(0, color=QUIET, lw=1)
    for (where, drawn, residual), colour, name, mark in series:
        if curve:
            top.fill_between(where, drawn.lower90, drawn.upper90, color=colour, alpha=0.2, lw=0)
            top.plot(where, drawn.mean, color=colour, lw=1.5, label=name)
        else:
            top.vlines(where, drawn.lower90, drawn.upper90, color=colour, alpha=0.3, lw=1)
            top.plot(where, drawn.mean, "_", color=colour, ms=6, label=name, rasterized=raster)
        below.plot(
            x, residual, mark, color=colour, ms=size, mew=0, alpha=0.7, label=name,
            rasterized=raster,
        )  # fmt: skip
    look: dict[str, Any] = {"color": DATA, "ls": "", "zorder": 3, "rasterized": raster}
    _dots_and_arrows(top, x, y, side, "measured", ms=size, mew=0, **look)
    if y_err is not None:
        top.errorbar(x, y, y_err, fmt="none", ecolor=DATA, elinewidth=0.6, alpha=0.5, zorder=2.9)
    values = y
    if held_out is not None:
        values = np.concatenate([y, held_out[1]])
        look |= {"mfc": "none", "ms": size + 1, "mew": 0.8}
        _dots_and_arrows(top, *held_out, held_side, "held out", **look)
        if curve:
            _shade(top, below, held_out[0], x)
    share_range([top], values)
    tidy(top, "", labels[1])
    tidy(below, labels[0], labels[2], legend=False)
    top.tick_params(labelbottom=False)
    return [top, below]


def _dots_and_arrows(
    ax: Axes,
    x: FloatArray,
    y: FloatArray,
    side: NDArray[np.int_] | None,
    label: str,
    **look: Any,
) -> None:
    """Draw values as dots, and bounds as arrows that point to where the value is."""
    side = np.zeros(len(y), dtype=int) if side is None else side
    for sign, mark, word in ((0, "o", label), (-1, "v", "at most"), (1, "^", "at least")):
        here = side == sign
        if sign and here.any():
            known = ax.get_legend_handles_labels()[1]
            word = word if word not in known else f"{word}, {label}"
            look = {**look, "ms": 4}
        if here.any() or not sign:
            ax.plot(x[here], y[here], marker=mark, label=word, **look)


def _shade(top: Axes, below: Axes, held: FloatArray, x: FloatArray) -> None:
    """Shade where measurements were held out, if that is beyond all others."""
    if held.min() >= x.max() or held.max() <= x.min():
        for ax in (top, below):
            ax.axvspan(held.min(), held.max(), color=QUIET, alpha=0.12, lw=0, zorder=0)


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
    mark = "o" if len(x) <= MAX_LEVELS else ""
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
    ax.plot(x, information, color=DATA, marker="o" if len(x) <= MAX_LEVELS else "")
    ax.axvline(place, color=DATA, lw=1, ls=(0, (1, 1)))
    ax.set_ylabel("information\nin bits")
    # next to nothing shall look like it
    ax.set_ylim(0, max(float(ax.get_ylim()[1]), 0.05))
    return ax


def _percent(value: float) -> str:
    if value >= 99.95:
        return "> 99.9 %"
    return f"{value:.1f} %" if value >= 0.1 else "< 0.1 %"
