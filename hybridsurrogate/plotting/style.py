"""What all pictures share: colours, Axes without a window, labels and ranges.

Colours are those of Okabe and Ito, which colour-blind readers can distinguish; where two series
share an Axes, their markers or lines differ as well.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib import colormaps, ticker
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray
from scipy.stats import norm

from hybridsurrogate.types import FloatArray

BEFORE, AFTER, DATA, HELD_OUT, QUIET = "#0072B2", "#D55E00", "#222222", "#009E73", "#777777"
# alternatives differ in line style too
ALTERNATIVES = (("#D55E00", "-"), ("#0072B2", "--"), ("#009E73", "-."), ("#CC79A7", ":"))
# without its lightest end, which is lost on white
OMEGA_COLOURS = ListedColormap(colormaps["viridis"](np.linspace(0, 0.93, 256)), "omega")


# half the width of the middle nine tenths of a standard normal
NINE_TENTHS = float(norm.ppf(0.95))


class Style(NamedTuple):
    """How one scheme is drawn."""

    colour: str
    line: str
    mark: str


# the first scheme, the second and others
SCHEMES = (
    Style("#0072B2", "-", "o"),
    Style("#D55E00", "--", "s"),
    Style("#009E73", "-.", "^"),
    Style("#CC79A7", ":", "D"),
)


def new_axes(
    rows: int = 1, columns: int = 1, width: float = 7.0, height: float = 3.4, share: bool = False
) -> list[Axes]:
    """Return Axes on a new figure without a window, row by row; ``share`` their x within columns.

    Parameters
    ----------
    rows, columns : int
    width, height : float
        Of the figure, in inches.
    share : bool

    Returns
    -------
    list of matplotlib Axes

    Examples
    --------
    >>> from hybridsurrogate.plotting import new_axes
    >>> len(new_axes(2, 3))
    6
    """
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.subplots(rows, columns, squeeze=False, sharex="col" if share else False)
    return list(grid.ravel())


def tidy(ax: Axes, xlabel: str, ylabel: str, legend: bool = True, ticks: int = 7) -> Axes:
    """Name the axes, and explain the series where they hide the least.

    Parameters
    ----------
    ax : matplotlib Axes
    xlabel, ylabel : str
    legend : bool, default=True
        Whether to explain the series that have names.
    ticks : int, default=7
        At most as many steps on the x axis.

    Returns
    -------
    matplotlib Axes

    Examples
    --------
    >>> from hybridsurrogate.plotting import new_axes, tidy
    >>> tidy(new_axes()[0], "days", "infected").get_ylabel()
    'infected'
    """
    ax.set_xlabel(xlabel)
    ax.set_ylabel(ylabel)
    ax.xaxis.set_major_locator(ticker.MaxNLocator(ticks))
    if legend:
        add_legend(ax)
    return ax


def list_names(ax: Axes, names: Iterable[Any]) -> NDArray[np.int_]:
    """Give names a line each on the y axis, the first on top, and return their places."""
    labels = [str(name) for name in names]
    places = np.arange(len(labels))[::-1]
    ax.set_yticks(places, labels=labels)
    ax.set_ylim(-0.6, len(labels) - 0.4)
    return places


def add_legend(ax: Axes) -> Axes:
    """Explain the series where they hide the least, if any has a name."""
    if ax.get_legend_handles_labels()[0]:
        ax.legend(frameon=True, framealpha=0.85, edgecolor="none", fontsize="small", loc="best")
    return ax


def explain(axes: Sequence[Axes], below: bool) -> None:
    """Explain the series of several Axes once: below the figure or in the first of the Axes."""
    series: dict[str, Any] = {}
    for ax in axes:
        handles, labels = ax.get_legend_handles_labels()
        series = dict(zip(labels, handles, strict=True)) | series
    if series and below:
        figure = axes[0].figure
        # a column takes 1.9 inches
        columns = max(1, min(len(series), int(figure.bbox.width / figure.dpi / 1.9)))
        legend = figure.legend(
            list(series.values()), list(series), loc="outside lower center", ncols=columns
        )
        legend.set_frame_on(False)
    elif series:
        look = {"framealpha": 0.85, "edgecolor": "none", "fontsize": "x-small"}
        axes[0].legend(list(series.values()), list(series), loc="best", **look)


def grid_of_axes(
    axes: ArrayLike | None, shape: tuple[int, int], width: float, height: float
) -> NDArray[np.object_]:
    """Return the given Axes in rows and columns, or those of a new figure of a size in inches."""
    made = new_axes(*shape, width, height, share=True) if axes is None else axes
    grid = np.array(made, dtype=object)
    if grid.size != shape[0] * shape[1]:
        raise ValueError(f"axes must contain {shape[0]} x {shape[1]} Axes, got {grid.size}.")
    return grid.reshape(shape)


def share_range(axes: Sequence[Axes], values: FloatArray) -> None:
    """Give Axes one range, wide enough for the data but not for a runaway extrapolation.

    Parameters
    ----------
    axes : sequence of matplotlib Axes
    values : ndarray
        The data; half of their range is added as room on either side.

    Examples
    --------
    >>> import numpy as np
    >>> from hybridsurrogate.plotting import new_axes, share_range
    >>> (ax,) = new_axes()
    >>> ax.set_ylim(-1000, 11)
    (-1000.0, 11.0)
    >>> share_range([ax], np.array([0.0, 10.0]))
    >>> bottom, top = ax.get_ylim()
    >>> float(bottom), float(top)
    (-5.0, 11.0)
    """
    values = values[np.isfinite(values)]
    low, high = float(np.min(values)), float(np.max(values))
    room = 0.5 * (high - low) or 1.0
    bottom = max(min(float(ax.get_ylim()[0]) for ax in axes), low - room)
    top = min(max(float(ax.get_ylim()[1]) for ax in axes), high + room)
    if axes[0].get_yscale() == "log":
        bottom = max(bottom, 0.2 * low)
    for ax in axes:
        ax.set_ylim(bottom, top)
