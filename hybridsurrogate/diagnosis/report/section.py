"""The parts of a report."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import pandas as pd


class Picture(NamedTuple):
    """A PNG image, and what a reader who cannot see it should know."""

    description: str
    png: bytes


@dataclass(frozen=True)
class Section:
    """A heading, sentences, formulas by name, pictures, and a table with a caption."""

    title: str
    sentences: tuple[str, ...]
    pictures: tuple[Picture, ...] = ()
    table: pd.DataFrame | None = None
    caption: str = ""
    formulas: tuple[tuple[str, str], ...] = ()
