"""How often a diagnosis is right.

`python -m examples.studies.hidden_effects.rates` prints it for what an engineer does by hand.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from .by_hand import diagnose_by_hand
from .cases import Case, make_case, same_curve
from .forms import KINDS
from .simulations import Array


def _rmse(a: Array, b: Array) -> float:
    return float(np.sqrt(np.mean((a - b) ** 2)))


def judge(case: Case, found: dict[str, Any], seconds: float) -> dict[str, Any]:
    """Compare one diagnosis with the truth of its case."""
    kind = case.truth["kind"]
    return {
        "simulation": case.simulator.name,
        "truth": kind,
        "found": found["kind"],
        "exact": found["kind"] == kind,
        "equivalent": same_curve(case, kind, found["kind"]),
        "ratio": _rmse(found["predict"](case.X_out), case.mu_out)
        / _rmse(found["predict_none"](case.X_out), case.mu_out),
        "seconds": seconds,
    }


def by_hand_rates(
    sizes: Sequence[float] = (1, 2, 4), n_seeds: int = 15, n_null: int = 200, first_seed: int = 0
) -> dict[Any, list[dict[str, Any]]]:
    """Diagnose ``n_seeds`` cases of every kind and size, and ``n_null`` in which nothing is wrong.

    Returns
    -------
    dict
        Size, or "none", to a list with one row of results for each case.
    """

    rows: dict[Any, list[dict[str, Any]]] = {}
    jobs = [
        (size, kind, first_seed + s) for size in sizes for kind in KINDS for s in range(n_seeds)
    ]
    jobs += [("none", "none", first_seed + s) for s in range(n_null)]
    for size, kind, seed in jobs:
        case = make_case(kind, 0.0 if kind == "none" else size, seed)
        start = time.perf_counter()
        found = diagnose_by_hand(case.simulator, case.X, case.y, np.random.default_rng(seed))
        rows.setdefault(size, []).append(judge(case, found, time.perf_counter() - start))
    return rows


def print_rates(rows: dict[Any, list[dict[str, Any]]]) -> None:
    """Print the table of rates, then the rate by kind, then who was mistaken for whom."""
    print("size   cases  right first  with the same curve  out-of-range RMSE  seconds")
    for size, found in rows.items():
        share = [100 * np.mean([row[word] for row in found]) for word in ("exact", "equivalent")]
        ratio, seconds = (np.median([row[word] for row in found]) for word in ("ratio", "seconds"))
        print(
            f"{size!s:5} {len(found):6} {share[0]:11.1f}% {share[1]:19.1f}% {ratio:18.3f} "
            f"{seconds:8.2f}"
        )
    if "none" in rows:
        wrong = np.mean([not row["exact"] for row in rows["none"]])
        print(f"false alarms on none: {100 * wrong:.1f}% of {len(rows['none'])}")
    for kind in KINDS:
        parts = []
        for size, found in rows.items():
            mine = [row for row in found if row["truth"] == kind]
            if mine:
                parts.append(f"{size}: {100 * np.mean([row['equivalent'] for row in mine]):5.1f}%")
        print(f"{kind:16} " + "  ".join(parts))
    confused: dict[tuple[Any, str, str], int] = {}
    for size, found in rows.items():
        for row in found:
            if not row["equivalent"]:
                key = (size, row["truth"], row["found"])
                confused[key] = confused.get(key, 0) + 1
    most = sorted(confused.items(), key=lambda item: -item[1])[:20]
    for (size, truth, kind), count in most:
        print(f"  size {size}: {truth} taken for {kind}, {count} times")


def main() -> None:
    """Print the rates."""
    parser = argparse.ArgumentParser(description="Rates of what an engineer does by hand.")
    parser.add_argument("--sizes", type=float, nargs="+", default=[1, 2, 4])
    parser.add_argument("--seeds", type=int, default=15)
    parser.add_argument("--nulls", type=int, default=200)
    parser.add_argument("--first-seed", type=int, default=0)
    given = parser.parse_args()
    print_rates(by_hand_rates(given.sizes, given.seeds, given.nulls, given.first_seed))


if __name__ == "__main__":
    main()
