"""The pictures of a diagnosis: functions that take numbers and the Axes to draw on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from scipy import stats

from hybridsurrogate.plotting.style import AFTER, BEFORE, DATA, QUIET, RIVALS
from hybridsurrogate.priors import FloatArray

_FEW_VALUES, _LITTLE_INFORMATION = 12, 0.05


class Prediction(NamedTuple):
    """Predictions at some rows: mean and central intervals, all of shape (n,)."""

    mean: FloatArray
    lower50: FloatArray
    upper50: FloatArray
    lower90: FloatArray
    upper90: FloatArray


def plot_prediction(
    ax: Axes, x: FloatArray, told: Prediction, colour: str, label: str, curve: bool = True
) -> Axes:
    """Draw predictions with their 50 % and 90 % intervals.

    Parameters
    ----------
    ax : Axes
    x : ndarray of shape (n,)
    told : Prediction
    colour, label : str
    curve : bool
        Whether the rows lie on a line, so that bands make sense; else one bar for each row.
    """
    if curve:
        ax.fill_between(x, told.lower90, told.upper90, color=colour, alpha=0.18, lw=0)
        ax.fill_between(x, told.lower50, told.upper50, color=colour, alpha=0.3, lw=0)
        ax.plot(x, told.mean, color=colour, lw=1.5, label=f"{label}, 50 and 90 % bands")
        return ax
    ax.vlines(x, told.lower90, told.upper90, color=colour, alpha=0.25, lw=1)
    ax.vlines(x, told.lower50, told.upper50, color=colour, alpha=0.6, lw=2)
    ax.plot(x, told.mean, "_", color=colour, ms=6, label=f"{label}, 50 and 90 % intervals")
    return ax


def plot_discrepancy(
    ax: Axes, x: FloatArray, mean: FloatArray, lower: FloatArray, upper: FloatArray
) -> Axes:
    """Draw a smooth discrepancy with its 90 % band around the line of no discrepancy."""
    ax.axhline(0, color=QUIET, lw=1)
    label = "smooth discrepancy, 90 % band"
    ax.fill_between(x, lower, upper, color=BEFORE, alpha=0.25, lw=0)
    ax.plot(x, mean, color=BEFORE, label=label)
    return ax


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


def plot_residuals(ax: Axes, x: FloatArray, residual: FloatArray, colour: str, title: str) -> Axes:
    """Draw residuals over a column, with their root mean square in the title."""
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
    """
    places = np.arange(len(names))[::-1]
    ax.hlines(places, before, after, color=QUIET, lw=1)
    ax.plot(before, places, "o", color=BEFORE, ms=6, label="before")
    if np.isfinite(after).any():
        bar = np.where(np.isfinite(error), error, 0.0)
        label = "after, ± error of the difference"
        ax.errorbar(after, places, xerr=bar, fmt="s", color=AFTER, ms=5, capsize=3, label=label)
    ax.set_yticks(places, labels=list(names))
    ax.set_ylim(-0.6, len(names) - 0.4)
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
    """
    places = np.arange(len(names))[::-1]
    error = np.sqrt(level * (1 - level) / np.asarray(n_rows))
    ax.axvline(100 * level, color=QUIET, lw=1, ls="--", label=f"should be {100 * level:g} %")
    for place, share, bar, name in zip(places, shares, error, names, strict=True):
        colour, mark = (BEFORE, "o") if "before" in name else (AFTER, "s")
        ax.errorbar(100 * share, place, xerr=100 * bar, fmt=mark, color=colour, ms=5, capsize=3)
    ax.set_yticks(places, labels=list(names))
    ax.set_ylim(-0.6, len(names) - 0.4)
    ax.set_xlim(right=min(float(ax.get_xlim()[1]), 102))
    # where names leave little room the label would run over the edge
    ax.set_xlabel(f"rows in the {100 * level:g} % interval, %", loc="right")
    return ax


def plot_rivals(
    ax: Axes, x: FloatArray, means: Sequence[FloatArray], names: Sequence[str], place: float
) -> Axes:
    """Draw what each rival predicts, and the place at which they should be told apart."""
    # a column with a few values is no line
    mark = "o" if len(x) <= _FEW_VALUES else ""
    for mean, name, (colour, style) in zip(means, names, RIVALS, strict=False):
        ax.plot(x, mean, color=colour, ls=style, lw=1.6, marker=mark, label=name)
    ax.axvline(place, color=DATA, lw=1, ls=(0, (1, 1)), label="measure here")
    return ax


def plot_information(ax: Axes, x: FloatArray, information: FloatArray, place: float) -> Axes:
    """Draw how much one more measurement would tell, over a column."""
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
