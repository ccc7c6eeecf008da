"""The results as one table."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from hidden_effects.forms import KINDS

from .methods import METHODS

Row = dict[str, Any]


def table(rows: Sequence[Row], methods: Iterable[str]) -> str:
    """Return a markdown table, one line a method, the sizes of effects side by side."""
    sizes = sorted({row["size"] for row in rows} - {0.0})
    across = " / ".join(f"{size:g}" for size in sizes)
    heads = [
        "method",
        "has words for",
        f"right first, all kinds, sizes {across}",
        "same curve counted",
        "of the kinds it has words for",
        "false alarms",
        "out-of-range error",
        "seconds",
    ]
    lines = [_line(heads), _line(["---"] * len(heads))]
    for name in methods:
        mine = [row for row in rows if row["method"] == name]
        lines.append(_line([METHODS[name].title, *_cells(name, mine, sizes)]))
    return "\n".join(lines)


def counts(rows: Sequence[Row]) -> str:
    """Say how many cases the shares are of."""
    tasks = {(row["kind"], row["size"], row["seed"]) for row in rows}
    of_size = Counter(size for _, size, _ in tasks)
    nulls = of_size.pop(0.0, 0)
    hidden = ", ".join(f"{n} of size {size:g}" for size, n in sorted(of_size.items()))
    return f"Cases: {hidden + ', ' if hidden else ''}{nulls} in which nothing is hidden."


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _cells(name: str, rows: Sequence[Row], sizes: Sequence[float]) -> list[str]:
    method = METHODS[name]
    words = f"{len(method.words)} of {len(KINDS)}"
    if not rows:
        return [words, f"skipped: {method.trouble or 'not in the file'}", *[""] * 5]
    hidden = [[row for row in rows if row["size"] == size] for size in sizes]
    nameable = [[row for row in some if row["kind"] in method.words] for some in hidden]
    nulls = [row for row in rows if row["size"] == 0]
    alarms = f"{_share(nulls, 'exact', wrong=True)} % of {len(nulls)}"
    return [
        words,
        " / ".join(_share(some, "exact") for some in hidden) + " %",
        " / ".join(_share(some, "equivalent") for some in hidden) + " %",
        " / ".join(_share(some, "equivalent") for some in nameable) + " %",
        alarms if nulls else "",
        " / ".join(_median(some, "ratio", 3) for some in hidden),
        _median(rows, "seconds", 1),
    ]


def _share(rows: Sequence[Row], word: str, wrong: bool = False) -> str:
    # a method that was not put to some size has nothing to say about it
    return f"{100 * np.mean([row[word] != wrong for row in rows]):.0f}" if rows else "-"


def _median(rows: Sequence[Row], word: str, digits: int) -> str:
    return f"{np.median([row[word] for row in rows]):.{digits}f}" if rows else "-"
