"""A report as plain text."""

from __future__ import annotations

import textwrap

import pandas as pd

from hybridsurrogate.diagnosis.report.elements.section import Card, FirstScreen, Section

_WIDTH, _HOLD = 88, "\u00a0"


def screen(first: FirstScreen) -> str:
    """Return the first screen: at most 30 lines."""
    width = max(len(card.question) for card in first.cards)
    lines = [wrapped(first.headline), "", *map(wrapped, first.lead), ""]
    lines += [_card(card, width) for card in first.cards]
    if first.caution:
        lines += ["", wrapped(f"Caution: {first.caution}")]
    lines += ["", "Next:"]
    lines += [wrapped(f"{one.sentence} {one.call}".rstrip(), "- ", "  ") for one in first.advice]
    lines += ["", wrapped("Everything else: report(full=True), or .save('report.html').")]
    return "\n".join(lines)


def section(part: Section) -> str:
    """Return one section without its pictures."""
    lines = ["", part.title, "-" * len(part.title), *map(wrapped, part.sentences)]
    for name, plain, latex in part.formulas:
        lines += [f"{name}:\n    {plain}", f"In LaTeX:\n    {latex}"]
    for table in part.tables:
        lines += ["", *([wrapped(table.caption)] if table.caption else []), aligned(table.rows)]
    if part.code:
        lines += ["", textwrap.indent(part.code.rstrip(), "    ")]
    return "\n".join(lines)


def wrapped(sentence: str, first: str = "", rest: str = "") -> str:
    """Return a sentence in lines; a number stays with its sign."""
    lines = textwrap.wrap(
        sentence.replace(" %", _HOLD + "%"),
        _WIDTH,
        initial_indent=first,
        subsequent_indent=rest,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return "\n".join(lines).replace(_HOLD, " ")


def aligned(table: pd.DataFrame) -> str:
    """Return a table as text, its columns left-aligned."""
    cells = [[str(name) for name in table.columns]]
    cells += [[str(cell) for cell in row] for row in table.itertuples(index=False)]
    widths = [max(len(row[k]) for row in cells) for k in range(len(table.columns))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in cells
    )


def _card(card: Card, width: int) -> str:
    return wrapped(
        f"{card.answer}: {card.detail}" if card.detail else card.answer,
        f"{card.question:<{width}}  ",
        " " * (width + 2),
    )
