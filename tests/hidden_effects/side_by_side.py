"""The diagnosis and the engineer on the same blind cases.

`python -m tests.hidden_effects.side_by_side` prints both tables.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np

import hybridsurrogate as hs

from .by_hand import diagnose_by_hand
from .cases import Case, make_case
from .forms import KINDS
from .rates import judge, print_rates


def diagnose(case: Case, seed: int) -> dict[str, Any]:
    """Diagnose one case by the package; the truth in it is not looked at."""
    model = hs.PowerScaledSurrogate(
        case.simulator, surrogate=hs.ExactSurrogate(), random_state=seed
    )
    diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, random_state=seed)
    with warnings.catch_warnings():
        # doubtful draws of a wrong cause are its own affair; what counts here are the names
        warnings.simplefilter("ignore", hs.HybridSurrogateWarning)
        diagnosis.fit(case.X, case.y)
    return {
        "kind": diagnosis.best_cause_.kind,
        "set": diagnosis.indistinguishable_,
        "effect": next(iter(diagnosis.extended_estimator_.effects), None),
        "verdict": diagnosis.verdict_,
        "p_value": diagnosis.p_value_,
        "predict": diagnosis.extended_estimator_.predict,
        "predict_none": diagnosis.estimator_.predict,
    }


def compare(
    sizes: Sequence[float], n_seeds: int, n_null: int, first_seed: int = 0
) -> tuple[dict[Any, list[dict[str, Any]]], dict[Any, list[dict[str, Any]]]]:
    """Return the judged results of the package and of the engineer, by effect size."""
    jobs = [
        (size, kind, first_seed + s)
        for size in sizes
        for kind in KINDS
        if kind != "none"
        for s in range(n_seeds)
    ]
    jobs += [("none", "none", first_seed + s) for s in range(n_null)]
    ours: dict[Any, list[dict[str, Any]]] = {}
    theirs: dict[Any, list[dict[str, Any]]] = {}
    for size, kind, seed in jobs:
        case = make_case(kind, 0.0 if kind == "none" else float(size), seed)
        start = time.perf_counter()
        found = diagnose(case, seed)
        row = judge(case, found, time.perf_counter() - start)
        row |= {"covered": kind in found["set"], "set_size": len(found["set"])}
        ours.setdefault(size, []).append(row)
        start = time.perf_counter()
        by_hand = diagnose_by_hand(case.simulator, case.X, case.y, np.random.default_rng(seed))
        theirs.setdefault(size, []).append(judge(case, by_hand, time.perf_counter() - start))
    return ours, theirs


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sizes", type=float, nargs="*", default=[1, 2, 4])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--nulls", type=int, default=400)
    parser.add_argument("--first-seed", type=int, default=5000)
    given = parser.parse_args()
    ours, theirs = compare(given.sizes, given.seeds, given.nulls, given.first_seed)
    for name, rows in (("hybridsurrogate", ours), ("by hand", theirs)):
        print(f"--- {name}")
        print_rates(rows)
    for size, rows in ours.items():
        if size != "none":
            share = 100 * np.mean([row["covered"] for row in rows])
            mean = np.mean([row["set_size"] for row in rows])
            print(f"size {size}: 90 % sets cover {share:.1f} % with {mean:.2f} kinds on average")


if __name__ == "__main__":
    main()
