"""A scorecard as text, and as a page of the documentation."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pandas as pd

from . import tables

_NAMES = {
    "kind": "hidden",
    "exact": "right kind first",
    "alike": "near copies counted",
    "covered": "90 % set covers",
    "set_size": "kinds in a set",
    "ratio": "out-of-range error",
    "rate": "false alarms",
    "upper": "upper 95 % limit",
    "both": "both named",
    "one": "one of them",
    "wrong": "something else too",
    "low": "95 % low",
    "high": "95 % high",
}
_RATES = ("detected", "exact", "alike", "covered", "rate", "upper", "coverage", "right", "stated")
_SHARES = frozenset([*_RATES, "both", "one", "wrong", "low", "high"])
CATALOGUES = {False: "the usual forms of the catalogue", True: "the whole catalogue"}


def sections(table: pd.DataFrame) -> Iterator[tuple[str, str, pd.DataFrame]]:
    """Yield heading, explanation and table, those that have any rows."""
    single = tables.single(table)
    for key, why in (
        ("size", ""),
        ("kind", ""),
        ("rows", ""),
        ("noise", "Noise sd in shares of the noise-free output's range."),
        ("simulation", ""),
    ):
        if len(single) and (key == "size" or len(single[key].unique()) > 1):
            yield f"By {key}", why, tables.rates(table, key)
    if len(single["weighed"].unique()) > 1:
        why = "A form that is not weighed cannot be named; `unexplained` would be a right answer."
        yield "By weighed or not, and size", why, tables.rates(table, ["weighed", "size"])
    if len(single["size"].unique()) > 1:
        wide = single.pivot_table(index="kind", columns="size", values="alike", aggfunc="mean")
        wide.columns = pd.Index([f"size {size:g}" for size in wide.columns])
        yield "Near copies counted, by kind and size", "", wide
    yield "False alarms", "", tables.false_alarms(table)
    bins = tables.name_calibration(table)
    error, chance = (100 * f(bins) for f in (tables.calibration_error, tables.chance_error))
    yield (
        "Probability of the first kind against how often it is right",
        "Shares of kinds that are weighed, given that something is wrong; undetected effects too. "
        "Mean absolute "
        f"calibration error {error:.1f} points; with so few cases chance alone makes {chance:.1f}.",
        bins,
    )
    yield (
        "Coverage of 90 % intervals",
        "Where kind, target and form were found; so of effects that were large enough for that.",
        tables.interval_coverage(table),
    )
    yield "Two effects at once", "Size 2 each, 80 rows, `max_causes=2`.", tables.both_named(table)
    yield "Most frequent confusions", "", tables.confusions(table)
    yield "Diagnoses that failed", "", tables.failures(table)


def cells(table: pd.DataFrame) -> tuple[list[str], list[list[str]]]:
    """Return header and cells of a table as text: shares in percent."""
    if table.index.name or isinstance(table.index, pd.MultiIndex):
        table = table.reset_index()
    header = [_NAMES.get(str(name), str(name)) for name in table.columns]
    rows = []
    for values in table.itertuples(index=False):
        rows.append([_cell(str(c), v) for c, v in zip(table.columns, values, strict=True)])
    return header, rows


def _cell(column: str, value: object) -> str:
    if not isinstance(value, (float, np.floating)):
        return str(value)
    if np.isnan(value):
        return ""
    if column in _SHARES or column.startswith("size "):
        return f"{100 * value:.1f} %"
    return f"{value:g}" if column in ("size", "above", "up to") else f"{value:.2f}"


def as_text(table: pd.DataFrame) -> str:
    """Return a table in columns."""
    header, rows = cells(table)
    widths = [max(map(len, column)) for column in zip(header, *rows, strict=True)]
    lines = [
        "  ".join(cell.ljust(w) if k == 0 else cell.rjust(w) for k, (cell, w) in enumerate(parts))
        for parts in (list(zip(line, widths, strict=True)) for line in [header, *rows])
    ]
    return "\n".join(line.rstrip() for line in lines)


def as_markdown(table: pd.DataFrame) -> str:
    """Return a table in pipes."""
    header, rows = cells(table)
    lines = [header, ["---", *["---:"] * (len(header) - 1)], *rows]
    return "\n".join("| " + " | ".join(c.replace("|", "/") for c in line) + " |" for line in lines)


def by_catalogue(table: pd.DataFrame) -> Iterator[tuple[str, pd.DataFrame]]:
    """Split by what was weighed."""
    for whole, name in CATALOGUES.items():
        part = table[table["whole"] == whole]
        if len(part):
            yield name, part


def report(table: pd.DataFrame, shape: Callable[[pd.DataFrame], str], heading: str) -> str:
    """Return all tables of all catalogues."""
    parts = []
    for name, part in by_catalogue(table):
        parts.append(f"{heading} Weighed: {name} ({len(part)} cases)")
        for title, why, found in sections(part):
            if len(found):
                parts += [f"{heading}# {title}", *([why] if why else []), shape(found)]
    return "\n\n".join(parts)


def commands(table: pd.DataFrame) -> list[str]:
    """Return the commands whose results these are, from the rows."""
    found = []
    for whole in (False, True):
        part = table[table["whole"] == whole]
        if part.empty:
            continue
        single, pairs = tables.single(part), part[part["pair"]]
        nulls = part[part["word"] == "none"]
        words = ["python -m tests.scorecard"]
        kinds = [f"'{kind}'" if " " in kind else kind for kind in dict.fromkeys(single["kind"])]
        words.append(f"--kinds {' '.join(kinds)}")
        words.append(f"--sizes {' '.join(f'{s:g}' for s in sorted(single['size'].unique()))}")
        n_rows = part[~part["pair"]]["rows"]
        words.append(f"--rows {' '.join(str(n) for n in sorted(n_rows.unique()))}")
        words.append(f"--seeds {single['seed'].nunique()} --nulls {nulls['seed'].nunique()}")
        words.append(f"--pairs {pairs['seed'].nunique()} --first-seed {part['seed'].min()}")
        found.append(" ".join(words) + (" --whole" if whole else ""))
    return found


_HOW = """Effects are hidden in eight simulations and the diagnosis has to find them. Size is the
root mean square of what is left of the effect after the parameters have been fitted to the
noise-free truth, in noise standard deviations; for `noise` the standard deviation at one end is
1 + size times that at the other. Right kind first: the verdict names the kind that is hidden.
Near copies counted: {trend, ramp, saturation, decay} are one kind. The 90 % set is
`indistinguishable_`. The out-of-range error is the median of the extended model's root mean square
error beyond the measured range against the plain simulation's. Failed diagnoses count as not
detected. Every case has draws of its own, so that limits for independent cases apply; both
catalogues see the same cases."""


def write_page(table: pd.DataFrame, path: Path, source: str, pictures: list[Path]) -> None:
    """Write the page of the documentation."""
    shown = "\n".join(f"![{p.stem}]({_relative(p, path)})" for p in pictures)
    lines = "\n".join(commands(table))
    count = f"It rests on {len(table)} cases."
    if len(table) < 2000:
        count += " That is few: a rate of 80 % over 100 cases is known to 8 points only."
    text = f"""# Scorecard

{_HOW}

{count} Made by these commands; a run that was stopped early has fewer cases than its command.

```
{lines}
python -m tests.scorecard --from-csv {source} --page docs/{path.name}
```

{shown}

{report(table, as_markdown, "##")}
"""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


def _relative(picture: Path, page: Path) -> str:
    same = picture.resolve().parent == page.resolve().parent
    return picture.name if same else str(picture)
