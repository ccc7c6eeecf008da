"""The pictures of how well a diagnosis's predictions meet the data."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from scipy import stats

from hybridsurrogate.plotting.style import AFTER, BEFORE, QUIET
from hybridsurrogate.types import FloatArray


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
