"""The diagnosis on measured data sets whose missing cause is known: does it find it?

Usage: ``python examples/measured_data.py [NAME] [--folder FOLDER] [--rows FILE] [--fast]``.
Without a name a Markdown page of all sets; with one, that set's report. The files and their sources
are described in the shared INDEX.md; a file that is absent is said and skipped.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from measured_sets import SETS, DataSet, Frame

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.evidence import Search, kind_of, probabilities
from hybridsurrogate.diagnosis.verdict import leader

FAST = ("nile", "school-influenza")


def find_folder(given: str | None) -> Path:
    """Return where the data are: the named folder, the environment's, or the shared one."""
    if given:
        return Path(given)
    beside = Path(__file__).resolve().parents[2] / "shared"
    return Path(os.environ.get("HYBRIDSURROGATE_SHARED", beside)) / "data"


def split(data: DataSet, frame: Frame) -> tuple[tuple[Frame, np.ndarray], tuple[Frame, np.ndarray]]:
    """Return X and y of the rows that train, thinned regularly, and of those held out."""
    frame = data.load(frame)
    frame = frame.dropna(subset=[*data.columns, data.output])
    train = data.train(frame)
    test = ~train if data.test is None else data.test(frame)
    parts = []
    for rows in (frame[train].iloc[:: data.every], frame[test].iloc[:: data.every]):
        X = rows[list(data.columns)].astype(float).rename(columns=data.columns)
        parts.append((X.reset_index(drop=True), rows[data.output].to_numpy(dtype=float)))
    return parts[0], parts[1]


def diagnose(data: DataSet, frame: Frame, fast: bool):
    """Return the fitted diagnosis, which has seen the training rows only, and both parts."""
    train, test = split(data, frame)
    model = hs.PowerScaledSurrogate(
        data.simulator(), surrogate=hs.ExactSurrogate(), likelihood=data.likelihood, random_state=0
    )
    # the split replaces the folds
    diagnosis = hs.DiscrepancyDiagnosis(
        model, causes=data.own, n_replicates=39 if fast else 200, cv=None, random_state=0
    )
    with warnings.catch_warnings():
        # of draws that are doubtful in a model known to be wrong; the report repeats them
        warnings.simplefilter("ignore", hs.HybridSurrogateWarning)
        return diagnosis.fit(*train), train, test


def error(data: DataSet, model, X: Frame, y: np.ndarray) -> float:
    """Return the RMSE of the predictive mean, of logarithms where INDEX has those."""
    difference = model.predict(X) - y
    if "(ln)" in data.index:
        difference = np.log(np.maximum(model.predict(X), 1e-9)) - np.log(y)
    return float(np.sqrt(np.mean(difference**2)))


def catalogue_alone(data: DataSet, found: Search) -> tuple[str, float]:
    """Return who leads a search, and with what probability, where own causes are left out."""
    own = {cause.kind for cause in data.own}
    kept = [weighed for weighed in found.weighed if kind_of(weighed) not in own]
    probability, remainder = probabilities(kept)
    rest = replace(found, weighed=kept, probability=probability, remainder=remainder)
    best = kept[leader(rest)].cause
    share = probability[leader(rest)] / (1 - probability[0])
    return label(best.kind, best.target), float(share)


def label(kind: str, target: str | None) -> str:
    """Return the word for a cause: its kind, and what it concerns."""
    return f"{kind}({target})" if target else kind


def row(data: DataSet, frame: Frame, fast: bool) -> list[str]:
    """Return one line of the table."""
    start = time.perf_counter()
    diagnosis, train, test = diagnose(data, frame, fast)
    seconds = time.perf_counter() - start
    best = diagnosis.best_cause_
    named = label(best.kind, best.target)
    right = "yes" if named in data.right else "no"
    kinds = {kind.partition("(")[0] for kind in data.right}
    if right == "no" and diagnosis.verdict_ == "ambiguous":
        right = "among rivals" if kinds & set(diagnosis.indistinguishable_) else right
    estimates = ", ".join(
        f"{name} {mean:.4g} ({low:.4g} to {high:.4g})"
        for name, (mean, low, high) in best.estimates.items()
    )
    models = (diagnosis.estimator_, diagnosis.extended_estimator_)
    errors = [f"{error(data, model, *test):.4g}" for model in models]
    thinned = f", 1 row in {data.every}" if data.every > 1 else ""
    without = "-"
    if data.own:
        other, probability = catalogue_alone(data, diagnosis.search_)
        without = f"{other}, {probability:.2f}: {'yes' if other in data.right else 'no'}"
    return [
        data.name,
        f"{len(train[1])} / {len(test[1])}{thinned}",
        data.cause,
        diagnosis.verdict_,
        f"{named}, {best.probability:.2f}" if best.kind != "none" else "none",
        right,
        without,
        f"{diagnosis.p_value_:.3f}",
        estimates or "-",
        data.value or "-",
        " -> ".join(errors),
        data.index,
        f"{seconds:.0f}",
    ]


HEAD = (
    "data set", "rows, train / held out", "documented cause", "verdict",
    "named, probability", "right", "without own cause", "p-value", "estimates (90 %)", "documented",
    "RMSE held out", "INDEX", "s",
)  # fmt: skip


def page(sets: tuple[DataSet, ...], folder: Path, fast: bool, kept: Path | None) -> None:
    """Print the page, a line at a time; rows that a file keeps are not computed anew."""
    known = json.loads(kept.read_text()) if kept and kept.exists() else {}
    print(INTRODUCTION)
    print("| " + " | ".join(HEAD) + " |")
    print("|" + "---|" * len(HEAD))
    outcomes = []
    for data in sets:
        path = folder / data.file
        if not path.exists():
            print(f"{data.name}: {path} does not exist, skipped.", file=sys.stderr)
            continue
        cells = known.get(data.name) or row(data, pd.read_csv(path, comment="#"), fast)
        known[data.name] = cells
        if kept:
            kept.write_text(json.dumps(known))
        print("| " + " | ".join(cells) + " |", flush=True)
        outcomes.append((data, cells[5], cells[6]))
    words = [right for _, right, _ in outcomes]
    print(f"\n{words.count('yes')} of {len(words)} as documented, ", end="")
    print(f"{words.count('among rivals')} more with the documented kind among the rivals. ", end="")
    alone = [right if other == "-" else other.rsplit(": ")[-1] for _, right, other in outcomes]
    print(f"Without own causes {alone.count('yes')} of {len(alone)} as documented.")
    notes = [f"- {data.name}: {data.remark}" for data, *_ in outcomes if data.remark]
    if notes:
        print("\n## Remarks (readings of the table, not tested)\n\n" + "\n".join(notes))


INTRODUCTION = """# Measured data with a known cause

Printed by `python examples/measured_data.py > docs/measured_data.md` in some minutes; `--rows FILE`
keeps finished rows, so that a run that was stopped goes on. Each data set meets the simulation that
a scientist would write first. The diagnosis sees that simulation, its priors and
the training rows; "RMSE held out" is on rows that it never saw, before -> after the
cause that it named. INDEX is the same with the documented cause fitted by least squares. "Right"
says whether the leading cause is the documented one or equal to it in effect, whatever the verdict
is; "among rivals": it is not, but its kind is among those that cannot be told apart.

Where the catalogue has no cause of the documented form, that formula was weighed beside it as the
scientist's own cause, with a prior of the field (`examples/measured_mechanisms.py`). "Without own
cause" says who leads the same search where it is left out, and whether that is right.

No rows of these files are part of the package, apart from `nile`, `mauna-loa`, `enso` and
`ultrasound`, which are in the public domain.
"""


def main() -> None:
    """Print the page, or one report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("name", nargs="?", choices=[data.name for data in SETS])
    parser.add_argument("--folder", help="where the files are")
    parser.add_argument("--rows", help="a JSON file that keeps finished rows, to go on from")
    parser.add_argument("--fast", action="store_true", help="two small sets, few replicates")
    given = parser.parse_args()
    folder = find_folder(given.folder)
    if given.name is None:
        fast = given.fast
        kept = Path(given.rows) if given.rows else None
        page(tuple(d for d in SETS if d.name in FAST) if fast else SETS, folder, fast, kept)
        return
    data = next(data for data in SETS if data.name == given.name)
    if not (folder / data.file).exists():
        sys.exit(f"{folder / data.file} does not exist: name its folder with --folder.")
    frame = pd.read_csv(folder / data.file, comment="#")
    diagnosis, _, test = diagnose(data, frame, given.fast)
    print(diagnosis.report(test=test))


if __name__ == "__main__":
    main()
