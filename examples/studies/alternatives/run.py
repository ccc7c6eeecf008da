"""Put every method to every case; one row of results each, written as they come."""

from __future__ import annotations

import csv
import warnings
from collections.abc import Iterator, Sequence
from io import StringIO
from pathlib import Path
from typing import Any, NamedTuple

from hidden_effects.cases import make_case
from hidden_effects.forms import KINDS
from scorecard.run import complete_lines

from .judging import result
from .methods import METHODS

COLUMNS = (
    "method",
    "kind",
    "size",
    "seed",
    "simulation",
    "found",
    "exact",
    "equivalent",
    "ratio",
    "seconds",
)


class Task(NamedTuple):
    """One case; its size is 0 where nothing is hidden."""

    kind: str
    size: float
    seed: int


def tasks(sizes: Sequence[float], n_seeds: int, n_nulls: int, first_seed: int) -> list[Task]:
    """List the cases by seed, so that an interrupted run has some of everything."""
    found: list[Task] = []
    for k in range(max(n_seeds, n_nulls)):
        seed = first_seed + k
        if k < n_seeds:
            found += [Task(kind, float(size), seed) for size in sizes for kind in KINDS]
        if k < n_nulls:
            found.append(Task("none", 0.0, seed))
    return found


def run_into(path: Path, methods: Sequence[str], todo: Sequence[Task]) -> Iterator[dict[str, Any]]:
    """Add what a file does not hold yet, and yield each row when it is there."""
    have = {(row["method"], _task_of(row)) for row in read(path)}
    text = complete_lines(path)
    path.write_text(text, encoding="utf-8")
    with path.open("a", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n", extrasaction="ignore")
        if not text:
            writer.writeheader()
        for task in todo:
            names = [name for name in methods if (name, task) not in have]
            for row in _answers(task, names):
                writer.writerow(row)
                file.flush()
                yield row


def _answers(task: Task, methods: Sequence[str]) -> Iterator[dict[str, Any]]:
    able = [name for name in methods if not METHODS[name].trouble]
    if not able:
        return
    case = make_case(*task)
    for name in able:
        with warnings.catch_warnings():
            # what a simulation or a library mutters on the way to an answer is not judged
            warnings.simplefilter("ignore")
            row = result(METHODS[name], case, task.seed)
        yield task._asdict() | {"method": name} | row


def read(path: Path) -> list[dict[str, Any]]:
    """Return the rows of a file, numbers as numbers."""
    return [
        row
        | {"size": float(row["size"]), "seed": int(row["seed"])}
        | {word: row[word] == "True" for word in ("exact", "equivalent")}
        | {word: float(row[word]) for word in ("ratio", "seconds")}
        for row in csv.DictReader(StringIO(complete_lines(path)))
    ]


def _task_of(row: dict[str, Any]) -> Task:
    return Task(row["kind"], row["size"], row["seed"])
