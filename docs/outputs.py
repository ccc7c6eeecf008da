"""Outputs that the pages show: `python docs/outputs.py docs/index.md ...` writes them anew.

A block of Python on a page is run, and a block of text that follows it shows what it printed. The
tests run the same blocks and compare words exactly, numbers to a tolerance.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

DOCS = Path(__file__).resolve().parent
# folders in which a reader copies code from a page
GUIDE = ("tutorials", "how-to", "explanation", "reference")
# whose blocks are files of the package: tests of the registries write and import them
FILES = DOCS / "how-to" / "add_to_the_catalogue.md"
_BLOCK = re.compile(r"```python\n(?P<code>.*?)```(?:\n+```text\n(?P<shown>.*?)```)?", re.DOTALL)
_NUMBER = re.compile(r"[-+−]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


class Block(NamedTuple):
    """Code of a page, what the page shows as its output, and where that text begins and ends."""

    code: str
    shown: str | None
    place: tuple[int, int]


def pages() -> list[Path]:
    """Return the pages that hold code to be run."""
    inner = [page for folder in GUIDE for page in sorted((DOCS / folder).glob("*.md"))]
    return [page for page in (DOCS / "index.md", *inner) if page != FILES and blocks(page)]


def blocks(page: Path) -> list[Block]:
    """Return the blocks of Python of a page."""
    text = page.read_text(encoding="utf-8")
    return [Block(m["code"], m["shown"], m.span("shown")) for m in _BLOCK.finditer(text)]


def run(page: Path) -> Iterator[tuple[Block, str]]:
    """Run a page in the current folder; yield each block with what it printed."""
    for table in page.parent.glob("*.csv"):
        shutil.copy(table, ".")
    names: dict[str, object] = {"__name__": "page"}
    for block in blocks(page):
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile(block.code, str(page), "exec"), names)
        text = "\n".join(line.rstrip() for line in printed.getvalue().splitlines())
        yield block, f"{text}\n" if text else ""


def words_and_numbers(text: str) -> tuple[list[str], list[float]]:
    """Return the words of an output, and its numbers in the same order."""
    numbers = [float(found.replace("−", "-")) for found in _NUMBER.findall(text)]
    words = _NUMBER.sub("#", re.sub(r"\s*[-─]{3,}\s*", " ", text)).split()
    return words, numbers


def rewrite(page: Path) -> None:
    """Run a page and write the outputs that it shows anew."""
    here = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            ran = list(run(page))
        finally:
            os.chdir(here)
    text = page.read_text(encoding="utf-8")
    for block, printed in reversed(ran):
        if block.shown is not None:
            start, end = block.place
            text = text[:start] + printed + text[end:]
    page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    for name in sys.argv[1:]:
        rewrite(Path(name).resolve())
