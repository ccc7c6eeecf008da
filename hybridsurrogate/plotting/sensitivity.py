"""Sobol indices over an input."""

from __future__ import annotations

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.axes import Axes


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
