"""How a figure becomes a picture of a report."""

from __future__ import annotations

import io
from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from hybridsurrogate.diagnosis.report.elements.section import Drawn
from hybridsurrogate.diagnosis.report.elements.settings import SETTINGS
from hybridsurrogate.diagnosis.report.elements.view import View
from hybridsurrogate.types import FloatArray


def rendered(axes: Sequence[Axes], description: str, data: pd.DataFrame | None = None) -> Drawn:
    """Return the figure of some Axes as SVG, with the numbers that it shows.

    Parameters
    ----------
    axes : sequence of matplotlib Axes
    description : str
    data : pandas.DataFrame or None
        None: the lines and bars of the Axes.
    """
    buffer = io.BytesIO()
    figure = axes[0].get_figure(root=True)
    assert isinstance(figure, Figure)
    # the same figure gives the same file
    with mpl.rc_context({"svg.hashsalt": "hybridsurrogate"}):
        figure.savefig(buffer, format="svg", facecolor="white", metadata={"Date": None})
    return Drawn(description, buffer.getvalue(), _numbers(axes) if data is None else data)


def _numbers(axes: Sequence[Axes]) -> pd.DataFrame:
    """Return what lines and bars show: panel, series, x and y."""
    parts = []
    for panel, ax in enumerate(axes, start=1):
        for line in ax.get_lines():
            x, y = (np.asarray(values, dtype=float) for values in line.get_data())
            name = str(line.get_label())
            parts.append(
                pd.DataFrame({"x": x, "y": y}).assign(series=name.lstrip("_"), panel=panel)
            )
        for bar in ax.patches:
            if isinstance(bar, Rectangle):
                middle = bar.get_y() + bar.get_height() / 2
                parts.append(
                    pd.DataFrame({"x": [bar.get_width()], "y": [middle]}).assign(
                        series="bar", panel=panel
                    )
                )
    table = pd.concat(parts, ignore_index=True) if parts else pd.DataFrame()
    return table.reindex(columns=["panel", "series", "x", "y"])


def logarithmic(ax: Axes, view: View, y: FloatArray) -> None:
    """Make the y axis logarithmic where the model is, and the outputs span decades."""
    if view.log_scale and y.min() > 0 and np.log10(y.max() / y.min()) > SETTINGS.log_axis_decades:
        ax.set_yscale("log")
