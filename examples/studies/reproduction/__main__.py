"""`python -m examples.studies.reproduction`: all case studies, figures, docs/evidence/reproduction.md."""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from joblib import Parallel, delayed

from hybridsurrogate.numerics.atomic_file import written_whole

from . import extension, figures, page, scores
from .cases import CASES, italy

ROOT = Path(__file__).resolve().parents[3]
PAGES = ROOT / "docs" / "evidence"
# data sets of what is slow: Italy, of which only the runs and the draws differ from seed to seed,
# and diagnoses that ask the epidemic of case study 2.1
N_SLOW = 5

Task = tuple[Callable[..., pd.DataFrame], str, int, dict[str, Any]]


def tasks(n_seeds: int, fast: bool = False) -> list[Task]:
    """Return what to run: a function with case study, seed and settings; the slow ones first."""
    few = {"n_draws": 200} if fast else {}
    tenths = np.round(np.linspace(0, 1, 11), 2)
    coarse = {"betas": tenths}
    # its second step over two parameters is slow: finer only where the best beta lies
    italian = {"n_draws": 200, "betas": np.sort([*tenths, 0.35, 0.45, 0.55])}
    scan, theirs, extend = scores.scan, scores.kennedy_ohagan, extension.extend
    found: list[Task] = []
    for seed in range(n_seeds):
        if seed < N_SLOW and has_italy():
            found.append((scan, "2.2", seed, {**italian, **(coarse if fast else {})}))
            found.append((extend, "2.2", seed, few))
            found.append((theirs, "2.2", seed, few))
        found.append((scan, "1 process", seed, {**few, **coarse}))
        found += [(extend, name, seed, few) for name in ("1", "1.2")]
        if seed < N_SLOW:
            # asking this simulation takes time: fewer replicates of the search
            few_replicates = {**few, "n_replicates": 99}
            found += [(extend, name, seed, few_replicates) for name in ("2.1", "2.1 whole")]
        found += [
            (scan, name, seed, {**few, **(coarse if fast else {})})
            for name in ("1", "1.2", "30 runs", "50 runs", "2.1")
        ]
        found += [(theirs, name, seed, few) for name in ("1", "1.2", "1 process", "2.1")]
    return sorted(found, key=lambda task: task[1] != "2.2")


def has_italy() -> bool:
    """Return whether a copy of Italy's data is at hand."""
    try:
        italy(0, n_runs=2)
    except OSError:
        return False
    return True


def run(todo: Sequence[Task], n_jobs: int) -> pd.DataFrame:
    """Return the scores of all tasks as one table."""
    done = Parallel(n_jobs=n_jobs, verbose=5)(
        delayed(function)(name, seed, **settings) for function, name, seed, settings in todo
    )
    return pd.concat(done, ignore_index=True)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run, then write figures and page."""
    parser = argparse.ArgumentParser(
        prog="python -m examples.studies.reproduction", description=__doc__
    )
    parser.add_argument("--seeds", type=int, default=10, help="data sets of each case study")
    parser.add_argument("--fast", action="store_true", help="fewer draws and betas")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--cases", nargs="*", choices=list(CASES), help="only these case studies")
    parser.add_argument("--out", type=Path, default=PAGES, help="folder of reproduction.md")
    parser.add_argument("--csv", type=Path, help="keep the scores in this file")
    parser.add_argument("--from-csv", type=Path, help="scores from this file instead of new ones")
    given = parser.parse_args(arguments)
    # data that are not ours to redistribute may lie beside the checkout, as for measured_data.py
    os.environ.setdefault("HYBRIDSURROGATE_SHARED", str(ROOT.parent / "shared"))
    start = time.perf_counter()
    if given.from_csv:
        frame = pd.read_csv(given.from_csv, dtype={"case": str})
    else:
        todo = tasks(given.seeds, given.fast)
        frame = run(
            [task for task in todo if not given.cases or task[1] in given.cases], given.jobs
        )
    if given.csv:
        with written_whole(given.csv) as part:
            frame.to_csv(part, index=False)
    pictures = figures.write(frame, given.out / "figures")
    minutes = (time.perf_counter() - start) / 60
    text = page.write(frame, given.out / "reproduction.md", pictures)
    print(text)
    print(f"{minutes:.1f} minutes")


if __name__ == "__main__":
    main()
