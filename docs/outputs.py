"""Outputs that the pages show: `python docs/outputs.py docs/index.md ...` writes them anew.

A block of Python on a page is run, and a block of text that follows it shows what it printed. The
tests run the same blocks and compare words exactly, numbers to a tolerance.
"""

from __future__ import annotations

import contextlib
import io
import math
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator
from itertools import zip_longest
from pathlib import Path
from typing import Any, NamedTuple

DOCS = Path(__file__).resolve().parent
# folders in which a reader copies code from a page
GUIDE = ("tutorials", "how-to", "explanation", "reference")
# whose blocks are files of the package: tests of the registries write and import them
FILES = DOCS / "how-to" / "add_to_the_catalogue.md"
_BLOCK = re.compile(r"```python\n(?P<code>.*?)```(?:\n+```text\n(?P<shown>.*?)```)?", re.DOTALL)
_WORDS = re.compile(r"[-+−]?\d+(?:\.\d*)?(?:e[-+]?\d+)?|[^\s\d]+")
_NUMBER = re.compile(r"[-+−]?\d+(?:\.\d*)?(?:e[-+]?\d+)?")


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


def run(page: Path, names: dict[str, Any] | None = None) -> Iterator[tuple[Block, str]]:
    """Run a page in the current folder; yield each block with what it printed.

    ``names`` is filled with what the blocks define.
    """
    for table in page.parent.glob("*.csv"):
        shutil.copy(table, ".")
    names = {} if names is None else names
    names["__name__"] = "page"
    for block in blocks(page):
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile(block.code, str(page), "exec"), names)
        text = "\n".join(line.rstrip() for line in printed.getvalue().splitlines())
        yield block, f"{text}\n" if text else ""


def differences(printed: str, shown: str) -> list[str]:
    """Return where an output differs from the one shown: another word, or quite another number.

    Other processors and versions draw other numbers: a tenth of a number, or a digit of one that is
    shown with one decimal, may be different.
    """
    pairs = list(zip_longest(_WORDS.findall(printed), _WORDS.findall(shown)))
    return [f"{new!r} instead of {old!r}" for new, old in pairs if not _alike(new, old)]


def _alike(new: str | None, old: str | None) -> bool:
    if new is None or old is None:
        return False
    numbers = [_NUMBER.fullmatch(one) for one in (new, old)]
    if not all(numbers):
        return new == old
    a, b = (float(one.replace("−", "-")) for one in (new, old))
    return math.isclose(a, b, rel_tol=0.1, abs_tol=0.11)


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
