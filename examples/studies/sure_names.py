"""How sure a name is where truths outside the catalogue count: the numbers of `probability_right_`.

Usage: ``python examples/studies/sure_names.py ROWS [--seeds 8] [--first-seed 510000]``. ROWS is a file of
JSON lines, to which blind cases are added until all are there: a run that was stopped goes on. Each
is diagnosed with its kind in the catalogue and without it, alone and beside a further, smaller
fault, as measured data seldom have one fault only. A logistic regression then tells how often the
leading cause is right, each sort of case weighed by its share of measured data sets.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import warnings
from collections.abc import Iterator
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from hidden_effects.cases import FORMS, Case, InfeasibleError, make_case
from hidden_effects.several import PAIR_NAMES, make_several
from sklearn.linear_model import LogisticRegression
from sklearn.model_selection import KFold

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.fitting.verdict import DOCUMENTED, NOT_HELD
from hybridsurrogate.diagnosis.search.forward_selection import tested

STUDIED = Path(hs.__file__).with_name("studied.json")
# so many of the measured sets with a documented cause keep structure beside it: mauna-loa, measles,
# italy, whiffle-ball, carriage (docs/evidence/measured_data.md)
FURTHER = json.loads(STUDIED.read_text(encoding="utf-8"))["probability_right"]["further"]
SIZES, ROWS, SMALLER = (2.0, 4.0), (40, 100), 0.4
FEATURES = ("odds", "structure", "several")


def cases(first: int, seeds: int) -> Iterator[dict[str, Any]]:
    """Yield what identifies a case: by seed, so that a stopped run has some of everything."""
    forms = [form for form in FORMS if form != "none"]
    for seed in range(first, first + seeds):
        for kind in (*forms, *PAIR_NAMES):
            for size in SIZES:
                for outside in (False, True):
                    yield {"kind": kind, "size": size, "seed": seed, "outside": outside}


def make(kind: str, size: float, seed: int) -> Case:
    """Make a case: one hidden effect, or a pair of which the second is smaller."""
    entropy = [seed, round(1000 * size)]
    if "+" in kind:
        own = int(np.random.SeedSequence(entropy).generate_state(1)[0])
        return make_several(kind, size, own, n_rows=80, smaller=SMALLER)
    n_rows = ROWS[(seed + FORMS.index(kind)) % 2]
    own = int(np.random.SeedSequence([*entropy, n_rows]).generate_state(1)[0])
    return make_case(kind, size, own, n_rows)


def diagnosed(task: dict[str, Any]) -> dict[str, Any]:
    """Return a case with what its diagnosis says of the leading cause."""
    case = make(task["kind"], task["size"], task["seed"])
    true = {word.partition(":")[0] for word in task["kind"].split("+")}
    model = hs.PowerScaledSurrogate(
        case.simulator, surrogate=hs.ExactSurrogate(), n_draws=200, random_state=task["seed"]
    )
    diagnosis = hs.DiscrepancyDiagnosis(
        model,
        exclude=tuple(sorted(true)) if task["outside"] else (),
        cv=None,
        random_state=task["seed"],
    ).fit(case.X, case.y)
    first = diagnosis.result_.steps[0]
    found, chosen = first.conditional, first.chosen
    return {
        "verdict": diagnosis.verdict_,
        "share": found.kind_shares.get(chosen.kind, float("nan")),
        "several": len(tested(diagnosis.result_.steps)) > 1,
        "right": diagnosis.best_cause_.kind in true,
        "told": diagnosis.probability_right_,
    }


def rows_of(path: Path, first: int, seeds: int) -> pd.DataFrame:
    """Return the rows of all cases; those that a file lacks are made and added to it."""
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    lines = [json.loads(line) for line in text.splitlines() if line.endswith("}")]
    have = {(row["kind"], row["size"], row["seed"], row["outside"]) for row in lines}
    with path.open("a", encoding="utf-8") as file:
        for task in cases(first, seeds):
            if tuple(task.values()) in have:
                continue
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", hs.HybridSurrogateWarning)
                warnings.simplefilter("ignore", RuntimeWarning)
                try:
                    lines.append(task | diagnosed(task))
                except InfeasibleError:
                    continue
            file.write(json.dumps(lines[-1]) + "\n")
            file.flush()
    return pd.DataFrame(lines)


def weights(table: pd.DataFrame) -> np.ndarray:
    """Return weights of cases: each sort as frequent as among measured data sets, mean one."""
    further = table["kind"].str.contains("+", regex=False)
    share = np.where(table["outside"], NOT_HELD, DOCUMENTED - NOT_HELD) / DOCUMENTED
    share = share * np.where(further, FURTHER, DOCUMENTED - FURTHER) / DOCUMENTED
    count = table.groupby([table["outside"], further])["right"].transform("size")
    return np.asarray(share / count * len(table))


def described(table: pd.DataFrame) -> pd.DataFrame:
    """Return the features of the regression."""
    share = table["share"].clip(1e-4, 1 - 1e-4)
    return pd.DataFrame(
        {
            "odds": np.log(share / (1 - share)),
            "structure": (table["verdict"] == "nearest").astype(float),
            "several": table["several"].astype(float),
        }
    )


def regression(X: pd.DataFrame, right: np.ndarray, weight: np.ndarray) -> LogisticRegression:
    """Return the regression, without a penalty that matters."""
    return LogisticRegression(C=1e6, max_iter=5000).fit(X, right, sample_weight=weight)


def losses(X: pd.DataFrame, right: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Return the log loss of each case in tenfold cross-validation."""
    told = np.empty(len(X))
    for some, others in KFold(10, shuffle=True, random_state=0).split(X):
        model = regression(X.iloc[some], right[some], weight[some])
        told[others] = model.predict_proba(X.iloc[others])[:, 1]
    return np.asarray(-np.where(right, np.log(told), np.log1p(-told)))


def written(path: Path, model: LogisticRegression, n_cases: int) -> None:
    """Replace the numbers of `probability_right` in a file of studied numbers."""
    every = json.loads(path.read_text(encoding="utf-8"))
    command = ["git", "rev-parse", "--short", "HEAD"]
    commit = subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    coefficients = np.round([model.intercept_[0], *model.coef_[0]], 3).tolist()
    every["probability_right"] |= {
        "commit": commit,
        "date": date.today().isoformat(),
        "n_cases": n_cases,
        **dict(zip(("one", *FEATURES), coefficients, strict=True)),
    }
    path.write_text(json.dumps(every, indent=2) + "\n", encoding="utf-8")


def main() -> None:
    """Make the cases, print the coefficients and what each feature gains."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rows", type=Path)
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--first-seed", type=int, default=510_000)
    parser.add_argument("--write", action="store_true", help="replace the package's numbers")
    given = parser.parse_args()
    table = rows_of(given.rows, given.first_seed, given.seeds)
    print(f"{len(table)} cases")
    weight = weights(table)
    named = table["verdict"].isin(["named", "nearest", "ambiguous"]).to_numpy()
    table, weight = table[named].reset_index(drop=True), weight[named]
    X, right = described(table), table["right"].to_numpy(dtype=bool)
    model = regression(X, right, weight)
    print("one", round(float(model.intercept_[0]), 3))
    for name, value in zip(X.columns, model.coef_[0], strict=True):
        print(name, round(float(value), 3))
    if given.write:
        written(STUDIED, model, len(table))
    whole = losses(X, right, weight)
    for name in FEATURES:
        gain = (losses(X.drop(columns=name), right, weight) - whole) * weight
        error = gain.std() / np.sqrt(len(gain))
        print(f"{name} gains {gain.mean():.4f}, standard error {error:.4f}")
    told = table["told"].astype(float)
    for group in np.array_split(np.argsort(told.to_numpy()), 6):
        stated, true = (np.average(v[group], weights=weight[group]) for v in (told, right))
        print(f"{len(group)} cases: told {stated:.2f}, right {true:.2f}")


if __name__ == "__main__":
    main()
