"""One picture of a diagnosis: data, simulation and extended model, residuals below."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from hybridsurrogate.plotting.report import Prediction
from hybridsurrogate.plotting.style import (
    AFTER,
    BEFORE,
    DATA,
    QUIET,
    grid_of_axes,
    share_range,
    tidy,
)
from hybridsurrogate.types import FloatArray

_MANY_ROWS = 400


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
    size = 3.0 if len(x) <= _MANY_ROWS else 1.6
    raster = len(x) > 3 * _MANY_ROWS
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
    exact = np.ones(len(y), dtype=bool) if side is None else side == 0
    top.plot(
        x[exact], y[exact], "o", color=DATA, ms=size, mew=0, label="measured", rasterized=raster,
        zorder=3,
    )  # fmt: skip
    for sign, mark, word in ((-1, "v", "at most"), (1, "^", "at least")):
        if side is not None and np.any(side == sign):
            here = side == sign
            top.plot(x[here], y[here], ls="", marker=mark, color=DATA, ms=4, label=word, zorder=3)
    if y_err is not None:
        top.errorbar(x, y, y_err, fmt="none", ecolor=DATA, elinewidth=0.6, alpha=0.5, zorder=2.9)
    values = y
    if held_out is not None:
        values = np.concatenate([y, held_out[1]])
        top.plot(*held_out, "o", color=DATA, mfc="none", ms=size + 1, mew=0.8, label="held out")
        if curve:
            _shade(top, below, held_out[0], x)
    share_range([top], values)
    tidy(top, "", labels[1])
    tidy(below, labels[0], labels[2], legend=False)
    top.tick_params(labelbottom=False)
    return [top, below]


def _shade(top: Axes, below: Axes, held: FloatArray, x: FloatArray) -> None:
    """Shade where measurements were held out, if that is beyond all others."""
    if held.min() >= x.max() or held.max() <= x.min():
        for ax in (top, below):
            ax.axvspan(held.min(), held.max(), color=QUIET, alpha=0.12, lw=0, zorder=0)
