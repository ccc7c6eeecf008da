"""Held-out scores of several simulations next to each other."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from hybridsurrogate.plotting.style import BEFORE, QUIET, new_axes, tidy


def plot_comparison(table: pd.DataFrame, ax: Axes | None = None) -> Axes:
    """Draw the held-out score of each simulation as a difference from the best.

    Bars are one standard error of the paired difference to either side.

    Parameters
    ----------
    table : DataFrame
        ``table`` of a `SimulationComparison`.
    ax : matplotlib Axes, optional

    Returns
    -------
    matplotlib Axes

    Examples
    --------
    >>> import pandas as pd
    >>> from hybridsurrogate.plotting import plot_comparison
    >>> rows = {"difference": [0.0, -0.7], "difference_error": [0.0, 0.2]}
    >>> plot_comparison(pd.DataFrame(rows, index=["fine", "coarse"])).get_xlabel()
    'held-out ELPD a row, less that of the best'
    """
    ax = new_axes(height=1.2 + 0.45 * len(table))[0] if ax is None else ax
    place = np.arange(len(table))[::-1]
    ax.errorbar(
        table["difference"],
        place,
        xerr=table["difference_error"].fillna(0.0),
        fmt="o",
        color=BEFORE,
        capsize=3,
    )
    ax.axvline(0.0, color=QUIET, lw=0.8, ls=":")
    ax.set_yticks(place, [str(name) for name in table.index])
    ax.set_ylim(-0.6, len(table) - 0.4)
    return tidy(ax, "held-out ELPD a row, less that of the best", "", legend=False)
