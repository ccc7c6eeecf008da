"""What the parts of a report are made of, and how a figure becomes a picture of one."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from hybridsurrogate.diagnosis.report.elements.view import View
from hybridsurrogate.types import FloatArray


class Drawn(NamedTuple):
    """A picture as it is shown.

    Attributes
    ----------
    description : str
        The caption, which also serves readers who cannot see the picture.
    svg : bytes
    data : pandas.DataFrame
        The numbers that are drawn.
    """

    description: str
    svg: bytes
    data: pd.DataFrame


class Picture:
    """A picture that is drawn when it is first shown, as drawing takes longer than all text.

    Parameters
    ----------
    draw : callable
        Returns a `Drawn`.
    *shown : Any
        What it takes.
    """

    def __init__(self, draw: Callable[..., Drawn], *shown: Any) -> None:
        self._draw, self._shown = draw, shown

    @cached_property
    def drawn(self) -> Drawn:
        """The picture itself."""
        return self._draw(*self._shown)


class Card(NamedTuple):
    """One question, its short answer, and what the answer rests on."""

    question: str
    answer: str
    detail: str


class Advice(NamedTuple):
    """What to do next, and the call to paste for it, "" without one."""

    sentence: str
    call: str = ""


@dataclass(frozen=True)
class Table:
    """A table with a caption."""

    rows: pd.DataFrame
    caption: str = ""


@dataclass(frozen=True)
class Section:
    """A part that is folded at first.

    Attributes
    ----------
    title : str
    hint : str
        What is inside, in a few words.
    sentences : tuple of str
    formulas : tuple of (name, plain text, LaTeX)
    code : str
        Source code to copy.
    tables : tuple of Table
    pictures : tuple of Picture
    """

    title: str
    hint: str = ""
    sentences: tuple[str, ...] = ()
    formulas: tuple[tuple[str, str, str], ...] = ()
    code: str = ""
    tables: tuple[Table, ...] = ()
    pictures: tuple[Picture, ...] = ()


@dataclass(frozen=True)
class FirstScreen:
    """What a reader sees first.

    Attributes
    ----------
    subject : str
        Simulation, data, version and seed, in one line.
    headline : str
        One sentence.
    lead : tuple of str
    cards : tuple of Card
    caution : str
        The most important reason to doubt the headline, "" without one.
    picture : Picture
    advice : tuple of Advice
    """

    subject: str
    headline: str
    lead: tuple[str, ...]
    cards: tuple[Card, ...]
    caution: str
    picture: Picture
    advice: tuple[Advice, ...]


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
    # over one and a half decades small outputs would be a flat line
    if view.log_scale and y.min() > 0 and np.log10(y.max() / y.min()) > 1.5:
        ax.set_yscale("log")
