"""The parts of a report."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import pandas as pd


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
        Takes nothing and returns a `Drawn`.
    """

    def __init__(self, draw: Callable[[], Drawn]) -> None:
        self._draw = draw

    @cached_property
    def drawn(self) -> Drawn:
        """The picture itself."""
        return self._draw()


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
