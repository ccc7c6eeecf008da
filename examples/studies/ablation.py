"""Each number of the search off, halved and doubled, on fixed blind cases: what does it earn?

``python -m examples.studies ablation --out FOLDER`` keeps one file of rows for each value of each
number, and goes on with what a stop left. Without ``--names`` it tries all of them: hours.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path

import numpy as np
import pandas as pd
from hidden_effects.cases import FORMS
from scorecard.run import Task, run_into, tasks

from hybridsurrogate.inference.evidence.settings import SETTINGS

FACTORS = {"off": 0.0, "halved": 0.5, "doubled": 2.0}
# where a difference of the table is beyond chance, and time that is worth a number
_ERRORS, _WORTH = 2.0, 0.02


def numbers() -> dict[str, float]:
    """Return every number of the search's settings by name."""
    return {one.name: getattr(SETTINGS, one.name) for one in fields(SETTINGS)}


def value_of(name: str, factor: float) -> float | int:
    """Return a number of the settings times a factor, of its type; a count is 1 at least."""
    usual = numbers()[name]
    if isinstance(usual, int):
        return max(round(usual * factor), 1)
    return usual * factor


@contextmanager
def setting(name: str, value: float) -> Iterator[None]:
    """Set one number while a block runs, in this process."""
    usual = getattr(SETTINGS, name)
    object.__setattr__(SETTINGS, name, value)
    try:
        yield
    finally:
        object.__setattr__(SETTINGS, name, usual)


def measured(folder: Path, names: Sequence[str], todo: Sequence[Task]) -> None:
    """Diagnose the cases under the usual settings, then under each other value of each number."""
    for _ in run_into(folder / "usual.csv", todo):
        pass
    for name in names:
        for word, factor in FACTORS.items():
            with setting(name, value_of(name, factor)):
                for _ in run_into(folder / f"{name}={word}.csv", todo):
                    pass


def scores(rows: pd.DataFrame) -> pd.DataFrame:
    """Return what counts of each case, by its task: right, in the set, alarm, score, seconds.

    Of cases in which nothing is hidden an alarm is what counts, of the others the rest. A diagnosis
    that raised an error is wrong.
    """
    null = rows["kind"] == "none"
    kind = rows["kind"].str.partition(":")[0]
    sets = rows["credible"].fillna("").str.split("|")
    held = [k in some for k, some in zip(kind, sets, strict=True)]
    out = pd.DataFrame(
        {
            "right": (rows["leader"] == kind).where(~null),
            "in set": pd.Series(held, rows.index).where(~null),
            "alarm": (~rows["found"].isin(["none", ""])).where(null),
            "elpd": rows["elpd_averaged"].where(~null),
            "seconds": rows["seconds"],
        }
    ).astype(float)
    out.index = pd.MultiIndex.from_frame(rows[["kind", "size", "rows", "seed"]])
    return out


def compared(usual: pd.DataFrame, other: pd.DataFrame) -> dict[str, float | bool]:
    """Return paired differences of the scores, their standard errors, and whether they matter.

    Parameters
    ----------
    usual, other : DataFrame
        `scores` of cases, those of ``other`` among the usual ones.
    """
    both = usual.index.intersection(other.index)
    usual, other = usual.loc[both], other.loc[both]
    out: dict[str, float | bool] = {"cases": len(both)}
    matters = False
    for column in ("right", "in set", "alarm", "elpd"):
        change = (other[column] - usual[column]).dropna()
        error = float(change.std(ddof=1) / np.sqrt(len(change))) if len(change) > 1 else np.nan
        out[column], out[f"{column} error"] = float(change.mean()), error
        matters |= bool(abs(change.mean()) > _ERRORS * error)
    out["time"] = float(other["seconds"].sum() / usual["seconds"].sum())
    out["earns its place"] = matters or out["time"] > 1 + _WORTH
    return out


def summary(folder: Path) -> pd.DataFrame:
    """Return the differences of every file of a folder from the usual settings."""
    usual = scores(pd.read_csv(folder / "usual.csv"))
    found = {
        tuple(path.stem.split("=")): compared(usual, scores(pd.read_csv(path)))
        for path in sorted(folder.glob("*=*.csv"))
    }
    table = pd.DataFrame(found.values(), index=pd.MultiIndex.from_tuples(found.keys()))
    return table.rename_axis(["number", "value"])


def main(arguments: Sequence[str] | None = None) -> None:
    """Run what is asked for, and print the table."""
    parser = argparse.ArgumentParser(
        prog="python -m examples.studies ablation", description=__doc__
    )
    parser.add_argument("--out", type=Path, required=True, help="folder of the rows")
    parser.add_argument("--names", nargs="+", choices=list(numbers()), default=list(numbers()))
    parser.add_argument("--seeds", type=int, default=3, help="of every kind at sizes 1 and 3")
    parser.add_argument("--nulls", type=int, default=40)
    parser.add_argument("--first-seed", type=int, default=660000)
    given = parser.parse_args(arguments)
    seeds, nulls = (
        range(given.first_seed, given.first_seed + n) for n in (given.seeds, given.nulls)
    )
    hidden = [form for form in FORMS if form != "none"]
    measured(given.out, given.names, tasks(hidden, (1.0, 3.0), (40,), seeds, nulls))
    print(summary(given.out).round(3).to_string())


if __name__ == "__main__":
    main()
