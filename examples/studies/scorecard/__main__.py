"""`python -m examples.studies.scorecard`: run blind cases, print the tables, write page and plots."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from hidden_effects import mechanisms
from hidden_effects.cases import FORMS
from hidden_effects.several import PAIR_NAMES, TRIPLE_NAMES

from . import outside, page, plots, tables
from .run import run_into, tasks


def parser() -> argparse.ArgumentParser:
    """Return the options."""
    made = argparse.ArgumentParser(prog="python -m examples.studies.scorecard", description=__doc__)
    hidden = [form for form in FORMS if form != "none"]
    made.add_argument("--kinds", nargs="*", default=hidden, choices=hidden, metavar="KIND")
    made.add_argument("--sizes", type=float, nargs="*", default=[0.5, 1, 2, 4, 8])
    made.add_argument("--rows", type=int, nargs="+", default=[40], help="for example 20 40 100 300")
    made.add_argument("--seeds", type=int, default=10, help="cases of every kind, size and rows")
    made.add_argument("--nulls", type=int, default=100, help="cases in which nothing is hidden")
    made.add_argument("--pairs", type=int, default=5, help="cases of every pair of effects")
    made.add_argument("--triples", type=int, default=0, help="cases of every three effects")
    made.add_argument("--first-seed", type=int, default=20_000)
    made.add_argument("--runs", type=int, default=0, help="of an emulated simulation")
    made.add_argument("--places", type=int, default=0, help="of a run that is a curve")
    made.add_argument("--further", type=int, default=0, help="runs where they tell most, at most")
    made.add_argument(
        "--outside", action="store_true", help="take the true kind out of the catalogue"
    )
    made.add_argument(
        "--mechanisms", action="store_true", help="hide what no kind of the catalogue draws"
    )
    made.add_argument("--jobs", type=int, default=1)
    made.add_argument("--out", type=Path, default=Path("scorecard.csv"), help="is carried on")
    made.add_argument("--from-csv", type=Path, help="only print the tables of this file")
    made.add_argument("--plots", type=Path, metavar="FOLDER", help="write the pictures there")
    made.add_argument("--page", type=Path, help="write this markdown page, and plots beside it")
    return made


def main(arguments: Sequence[str] | None = None) -> None:
    """Run what was asked for."""
    given = parser().parse_args(arguments)
    if given.mechanisms:
        given.outside, given.kinds = True, list(mechanisms.FORMS)
    source = given.from_csv
    if source is None:
        source = given.out
        first = given.first_seed
        todo = tasks(
            given.kinds,
            given.sizes,
            given.rows,
            range(first, first + given.seeds),
            range(first, first + given.nulls),
            dict.fromkeys(PAIR_NAMES, range(first, first + given.pairs))
            | dict.fromkeys(TRIPLE_NAMES, range(first, first + given.triples)),
            given.runs,
            given.places,
            given.further,
            given.outside,
        )
        try:
            for k, row in enumerate(run_into(source, todo, given.jobs), start=1):
                said = row["trouble"] or row["several"]
                print(k, row["kind"], f"{row['size']:g}", row["rows"], row["seed"], said)
        except KeyboardInterrupt:
            print(f"Interrupted; {source} keeps what there is, the same command goes on.")
    table = tables.read(source)
    if table.empty:
        print(f"{source} holds no results.")
        return
    if given.outside:
        text = outside.page_of(table, given.mechanisms)
        print(text)
        if given.page:
            given.page.write_text(text, encoding="utf-8")
        return
    print(page.report(table, page.as_text, "#"))
    folder = given.plots or (given.page.parent if given.page else None)
    name = given.page.stem if given.page else "scorecard"
    pictures = plots.write_plots(table, folder, name) if folder else []
    if given.page:
        page.write_page(table, given.page, source.name, pictures)


if __name__ == "__main__":
    main()
