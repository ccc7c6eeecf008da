"""Detection over sizes of a cause, sensitivity over an input, new measurements as they come."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib import ticker
from matplotlib.axes import Axes

from hybridsurrogate.plotting.style import (
    AFTER,
    DATA,
    NINE_TENTHS,
    OMEGA_COLOURS,
    QUIET,
    new_axes,
    tidy,
)


def plot_power(table: pd.DataFrame, ax: Axes | None = None, power: float = 0.9) -> Axes:
    """Draw how often each cause is detected, and dashed how often it is named, over its size.

    Of more than six causes lines could not be followed: the colour of a tile is how often one is
    detected, and its number how often it is named, in percent.

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
    names = list(dict.fromkeys(table["cause"]))
    if len(names) > 6:
        return _plot_tiles(table, names, ax)
    ax = new_axes()[0] if ax is None else ax
    for name, place in zip(names, np.linspace(0, 1, len(names)), strict=True):
        some, colour = table[table["cause"] == name], OMEGA_COLOURS(place)
        ax.plot(some["size"], some["detected"], "-o", color=colour, ms=3, label=name)
        ax.plot(some["size"], some["named"], "--", color=colour, lw=1)
    ax.axhline(power, color=QUIET, lw=0.8, ls=":")
    ax.set_xscale("log")
    ax.set_ylim(0, 1.02)
    tidy(ax, "size, in standard deviations of the noise", "share of data sets", legend=True)
    ticks = sorted(set(table["size"]))
    ax.xaxis.set_major_locator(ticker.FixedLocator(ticks))
    ax.xaxis.set_major_formatter(ticker.FuncFormatter(lambda x, _: f"{x:g}"))
    ax.xaxis.set_minor_locator(ticker.NullLocator())
    return ax


def _plot_tiles(table: pd.DataFrame, names: Sequence[str], ax: Axes | None) -> Axes:
    """Draw a row of tiles for each cause, a column for each size."""
    ax = new_axes(height=0.22 * len(names) + 0.8)[0] if ax is None else ax
    detected, named = (
        table.pivot_table(index="cause", columns="size", values=of).loc[list(names)]
        for of in ("detected", "named")
    )
    tiles = ax.imshow(detected, cmap="Blues", vmin=0, vmax=1, aspect="auto")
    for (row, column), value in np.ndenumerate(named.to_numpy()):
        dark = detected.iloc[row, column] > 0.6
        words = f"{100 * value:.0f}" if np.isfinite(value) else ""
        ax.text(column, row, words, ha="center", va="center", color="white" if dark else DATA)
    ax.set_yticks(range(len(names)), names, fontsize="small")
    ax.set_xticks(range(named.shape[1]), [f"{size:g}" for size in named.columns])
    ax.set_xlabel("size, in standard deviations of the noise; number: named, in %")
    ax.figure.colorbar(tiles, ax=ax, label="share that is detected")
    return ax


def plot_monitor(
    table: pd.DataFrame, false_alarm_rate: float, since: int | None = None, ax: Axes | None = None
) -> Axes:
    """Draw deviations of new measurements from predictions, and the odds of a change.

    Points are deviations, nine of ten of which lie in the band while the extension is right. The
    line, with its axis on the right, is the odds that something changed; dashed the odds that are
    an alarm.

    Parameters
    ----------
    table : DataFrame
        ``table`` of a `Monitor`.
    false_alarm_rate : float
        That of the `Monitor`.
    since : int, optional
        ``since`` of the `Monitor`: the measurement from which something most probably changed.
    ax : matplotlib Axes, optional

    Returns
    -------
    matplotlib Axes

    Examples
    --------
    >>> import pandas as pd
    >>> from hybridsurrogate.plotting import plot_monitor
    >>> table = pd.DataFrame({"deviation": [0.3, -1.0, 4.0], "e_value": [0.9, 0.8, 30.0]})
    >>> plot_monitor(table, 0.05, since=2).get_ylabel()
    'deviation, in sd of the prediction'
    """
    ax = new_axes()[0] if ax is None else ax
    number = np.arange(len(table))
    ax.axhspan(-NINE_TENTHS, NINE_TENTHS, color=QUIET, alpha=0.15, lw=0, label="nine of ten")
    ax.plot(number, table["deviation"], "o", color=DATA, ms=4, label="measured")
    if since is not None:
        ax.axvline(since - 0.5, color=QUIET, ls=":", label="most probably changed")
    odds = ax.twinx()
    odds.semilogy(number, table["e_value"], color=AFTER, label="odds of a change")
    odds.axhline(1 / false_alarm_rate, color=AFTER, ls="--", lw=1)
    odds.set_ylabel("odds of a change to one (dashed: alarm)", color=AFTER)
    return tidy(ax, "new measurement", "deviation, in sd of the prediction")


def plot_sobol(table: pd.DataFrame, ax: Axes | None = None) -> Axes:
    """Draw the indices of each parameter over the first column: total as lines, first dashed.

    Parameters
    ----------
    table : DataFrame
        Of `hybridsurrogate.sobol_indices`.
    ax : Axes, optional

    Returns
    -------
    Axes

    Examples
    --------
    >>> import pandas as pd
    >>> from hybridsurrogate.plotting import plot_sobol
    >>> table = pd.DataFrame(
    ...     {"t": [0, 1], "parameter": "rate", "first": [0.2, 0.9], "total": [0.3, 1.0]})
    >>> plot_sobol(table).get_xlabel()
    't'
    """
    ax = plt.subplots(layout="constrained")[1] if ax is None else ax
    column = table.columns[0]
    # of several outputs a pair of lines for each
    keys = ["parameter", "output"] if "output" in table else ["parameter"]
    for k, (names, own) in enumerate(table.groupby(keys, sort=False)):
        own = own.sort_values(column)
        ax.plot(own[column], own["total"], color=f"C{k}", label=", ".join(map(str, names)))
        ax.plot(own[column], own["first"], color=f"C{k}", ls="--")
    ax.set(xlabel=column, ylabel="share of the variance\n(total; dashed: first order)")
    ax.set_ylim(-0.05, 1.05)
    ax.legend()
    return ax
