"""How often planned measurements would detect and name causes, over their size."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib import ticker
from matplotlib.axes import Axes

from hybridsurrogate.plotting.style import OMEGA_COLOURS, QUIET, new_axes, tidy

# lines that an Axes has room to name within it
_NAMED = 6


def plot_power(table: pd.DataFrame, ax: Axes | None = None, power: float = 0.9) -> Axes:
    """Draw how often each cause is detected, and dashed how often it is named, over its size.

    Parameters
    ----------
    table : DataFrame
        ``table`` of a `Detectability`.
    ax : matplotlib Axes, optional
    power : float, default=0.9
        Share of data sets that is marked.

    Returns
    -------
    matplotlib Axes

    Examples
    --------
    >>> import pandas as pd
    >>> from hybridsurrogate.plotting import plot_power
    >>> rows = [("step", 1.0, 0.3, 0.1), ("step", 4.0, 1.0, 0.8)]
    >>> table = pd.DataFrame(rows, columns=["cause", "size", "detected", "named"])
    >>> plot_power(table).get_ylabel()
    'share of data sets'
    """
    ax = new_axes()[0] if ax is None else ax
    names = list(dict.fromkeys(table["cause"]))
    for name, place in zip(names, np.linspace(0, 1, len(names)), strict=True):
        some, colour = table[table["cause"] == name], OMEGA_COLOURS(place)
        ax.plot(some["size"], some["detected"], "-o", color=colour, ms=3, label=name)
        ax.plot(some["size"], some["named"], "--", color=colour, lw=1)
    ax.axhline(power, color=QUIET, lw=0.8, ls=":")
    ax.set_xscale("log")
    ax.set_ylim(0, 1.02)
    few = len(names) <= _NAMED
    tidy(ax, "size, in standard deviations of the noise", "share of data sets", legend=few)
    if not few:
        ax.legend(loc="center left", bbox_to_anchor=(1, 0.5), fontsize="x-small", frameon=False)
    ticks = sorted(set(table["size"]))
    ax.xaxis.set_major_locator(ticker.FixedLocator(ticks))
    ax.xaxis.set_major_formatter(ticker.FuncFormatter(lambda x, _: f"{x:g}"))
    ax.xaxis.set_minor_locator(ticker.NullLocator())
    return ax
