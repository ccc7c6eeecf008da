"""New measurements against predictions of an extension, and the odds of a change."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from hybridsurrogate.plotting.style import AFTER, DATA, QUIET, new_axes, tidy

# of a standard normal, the middle nine tenths
_NINE_TENTHS = 1.645


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
    ax.axhspan(-_NINE_TENTHS, _NINE_TENTHS, color=QUIET, alpha=0.15, lw=0, label="nine of ten")
    ax.plot(number, table["deviation"], "o", color=DATA, ms=4, label="measured")
    if since is not None:
        ax.axvline(since - 0.5, color=QUIET, ls=":", label="most probably changed")
    odds = ax.twinx()
    odds.semilogy(number, table["e_value"], color=AFTER, label="odds of a change")
    odds.axhline(1 / false_alarm_rate, color=AFTER, ls="--", lw=1)
    odds.set_ylabel("odds of a change to one (dashed: alarm)", color=AFTER)
    return tidy(ax, "new measurement", "deviation, in sd of the prediction")
