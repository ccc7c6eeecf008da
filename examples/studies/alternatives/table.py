"""The results as one table."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from hidden_effects.forms import KINDS

from .methods import METHODS

Row = dict[str, Any]
Case = tuple[str, float, int]


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
        "... in those of the diagnosis, case by case",
        "seconds",
    ]
    lines = [_line(heads), _line(["---"] * len(heads))]
    ours = {_case(row): row["ratio"] for row in rows if row["method"] == "hybridsurrogate"}
    for name in methods:
        mine = [row for row in rows if row["method"] == name]
        lines.append(_line([METHODS[name].title, *_cells(name, mine, sizes, ours)]))
    return "\n".join(lines)


def counts(rows: Sequence[Row]) -> str:
    """Say how many cases the shares are of."""
    tasks = {_case(row) for row in rows}
    of_size = Counter(size for _, size, _ in tasks)
    nulls = of_size.pop(0.0, 0)
    hidden = ", ".join(f"{n} of size {size:g}" for size, n in sorted(of_size.items()))
    return f"Cases: {hidden + ', ' if hidden else ''}{nulls} in which nothing is hidden."


def _case(row: Row) -> Case:
    return row["kind"], row["size"], row["seed"]


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _cells(
    name: str, rows: Sequence[Row], sizes: Sequence[float], ours: Mapping[Case, float]
) -> list[str]:
    method = METHODS[name]
    words = f"{len(method.words)} of {len(KINDS)}"
    if not rows:
        return [words, f"skipped: {method.trouble or 'not in the file'}", *[""] * 6]
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
        " / ".join(_paired(some, ours) for some in hidden),
        _median(rows, "seconds", 1),
    ]


def _share(rows: Sequence[Row], word: str, wrong: bool = False) -> str:
    # a method that was not put to some size has nothing to say about it
    return f"{100 * np.mean([row[word] != wrong for row in rows]):.0f}" if rows else "-"


def _median(rows: Sequence[Row], word: str, digits: int) -> str:
    return f"{np.median([row[word] for row in rows]):.{digits}f}" if rows else "-"


def _paired(rows: Sequence[Row], ours: Mapping[Case, float]) -> str:
    """Geometric mean, as single cases differ by orders of magnitude."""
    logs = [np.log(row["ratio"] / ours[_case(row)]) for row in rows if _case(row) in ours]
    return f"{np.exp(np.mean(logs)):.2f}" if logs else "-"
