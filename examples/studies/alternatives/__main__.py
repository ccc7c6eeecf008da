"""`python -m examples.studies.alternatives`: the diagnosis next to other tools on the same blind cases."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from .methods import METHODS
from .run import read, run_into, tasks
from .table import counts, table


def parser() -> argparse.ArgumentParser:
    """Return the options."""
    made = argparse.ArgumentParser(
        prog="python -m examples.studies.alternatives", description=__doc__
    )
    made.add_argument("--sizes", type=float, nargs="*", default=[1, 2, 4])
    made.add_argument("--seeds", type=int, default=10, help="cases of every kind and size")
    made.add_argument("--nulls", type=int, default=100, help="cases in which nothing is hidden")
    made.add_argument("--first-seed", type=int, default=30_000)
    made.add_argument("--methods", nargs="+", default=list(METHODS), choices=list(METHODS))
    made.add_argument("--out", type=Path, default=Path("alternatives.csv"), help="is carried on")
    made.add_argument("--from-csv", type=Path, help="only print the table of this file")
    return made


def main(arguments: Sequence[str] | None = None) -> None:
    """Run what was asked for and print the table."""
    given = parser().parse_args(arguments)
    source = given.from_csv or given.out
    if given.from_csv is None:
        todo = tasks(given.sizes, given.seeds, given.nulls, given.first_seed)
        try:
            for row in run_into(source, given.methods, todo):
                print(f"{row['method']}: {row['kind']} {row['size']:g} is {row['found']}")
        except KeyboardInterrupt:
            print(f"Interrupted; {source} keeps what there is, the same command goes on.")
    rows = read(source)
    if not rows:
        print(f"{source} holds no results.")
        return
    print(f"\n{counts(rows)}\n\n{table(rows, given.methods)}")


if __name__ == "__main__":
    main()
