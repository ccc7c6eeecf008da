"""How often a hidden effect is named in counts and heavy-tailed data: blind cases, one table.

`python examples/studies/likelihood_scorecard.py --seeds 10 --nulls 100 --out likelihoods.csv`; the same
command carries an interrupted run on. An effect of size s has a root mean square of s standard
deviations of the noise; in counts the mean deviance of a row, as it is from what the simulation
says, is s squared.
"""

from __future__ import annotations

import argparse
import csv
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.optimize import brentq

import hybridsurrogate as hs

N_ROWS = 40
DATA = ("poisson 20", "poisson 3", "student-t")
KINDS = ("trend", "periodic", "step", "bump", "missing-input")
COLUMNS = ("data", "kind", "size", "seed", "verdict", "p_value", "leader", "credible", "seconds")


def decline(day: np.ndarray, start: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Return a quantity that declines by a constant rate."""
    return start * np.exp(-rate * day / 100)


def case(data: str, kind: str, size: float, seed: int) -> tuple[Any, np.ndarray, np.ndarray, str]:
    """Return simulator, X, y and the likelihood's name; the simulation does not know the effect."""
    random = np.random.default_rng([seed, DATA.index(data), round(100 * size), *kind.encode()])
    day = np.sort(random.uniform(0, 100, N_ROWS))
    other = random.normal(size=N_ROWS)
    level = {"poisson 20": 20.0, "poisson 3": 3.0, "student-t": 10.0}[data]
    simulator = hs.Simulator(
        decline,
        inputs={"day": (0, 100)},
        parameters={
            "start": hs.truncated_normal(1.3 * level, 0.3 * level, 0.2 * level, 3 * level),
            "rate": hs.truncated_normal(0.5, 0.2, 0.0, 1.2),
        },
        output="counts" if "poisson" in data else "level",
    )
    true = decline(day, random.normal(1.3, 0.15) * level, random.uniform(0.3, 0.7))
    shape = _effects(random)[kind](day, other) if kind != "none" else np.zeros(N_ROWS)
    shape = shape / max(float(np.sqrt(np.mean(shape**2))), 1e-300)
    X = np.column_stack([day, other])
    if data == "student-t":
        noise = 0.5
        y = true + size * noise * shape + noise * random.standard_t(4, N_ROWS)
        return simulator, X, y, "student-t"
    if size and _deviance(true, 30 * shape) < size**2:
        shape = -shape  # no decrease of a rate is as clear as that
    strength = brentq(lambda s: _deviance(true, s * shape) - size**2, 0, 30) if size else 0.0
    return simulator, X, random.poisson(true * np.exp(strength * shape)).astype(float), "poisson"


def _deviance(rate: np.ndarray, change: np.ndarray) -> float:
    """Return the mean Poisson deviance of rates that are changed by exp(change)."""
    return float(np.mean(2 * rate * (np.exp(change) * change - np.expm1(change))))


def _effects(random: np.random.Generator) -> dict[str, Callable[..., np.ndarray]]:
    place, sign = random.uniform(25, 75), random.choice([-1, 1])
    period, phase, width = random.uniform(12, 40), random.uniform(0, 6.28), random.uniform(4, 10)
    return {
        # what the decline cannot take up
        "trend": lambda day, _: sign * ((day - 50) / 50) ** 2,
        "periodic": lambda day, _: np.sin(2 * np.pi * day / period + phase),
        "step": lambda day, _: sign * (day >= place),
        "bump": lambda day, _: sign * np.exp(-0.5 * ((day - place) / width) ** 2),
        "missing-input": lambda _, other: sign * other,
    }


def diagnosed(data: str, kind: str, size: float, seed: int) -> dict[str, Any]:
    """Diagnose one case and return its row."""
    simulator, X, y, likelihood = case(data, kind, size, seed)
    model = hs.PowerScaledSurrogate(
        simulator,
        surrogate=hs.ExactSurrogate(),
        likelihood=likelihood,
        n_draws=200,
        random_state=seed,
    )
    start = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hs.HybridSurrogateWarning)
        found = hs.DiscrepancyDiagnosis(model, cv=None, random_state=seed).fit(X, y)
    shares = found.causes_[found.causes_["kind"] != "none"].groupby("kind")["probability"].sum()
    told = found.verdict_, found.p_value_, shares.idxmax(), "|".join(found.indistinguishable_)
    seconds = round(time.perf_counter() - start, 2)
    return dict(zip(COLUMNS, (data, kind, size, seed, *told, seconds), strict=True))


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """Return right first, coverage of the sets and false alarms for each kind of data and size."""
    out = []
    for (data, size), group in rows.groupby(["data", "size"]):
        wrong = group["verdict"] != "adequate"
        right = group["leader"] == group["kind"]
        covered = [k in c.split("|") for k, c in zip(group["kind"], group["credible"], strict=True)]
        hidden = size > 0
        out.append(
            {
                "data": data,
                "size": size,
                "cases": len(group),
                "found": np.mean(wrong) if hidden else np.nan,
                "right first": np.mean(right) if hidden else np.nan,
                "in the set": np.mean(covered) if hidden else np.nan,
                "false alarms": np.mean(wrong) if not hidden else np.nan,
                "seconds": group["seconds"].median(),
            }
        )
    return pd.DataFrame(out).round(3)


def main() -> None:
    """Run what is not there yet and print the table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--seeds", type=int, default=10)
    options.add_argument("--nulls", type=int, default=100)
    options.add_argument("--first-seed", type=int, default=0)
    options.add_argument("--data", nargs="+", default=list(DATA), choices=DATA)
    options.add_argument("--out", type=Path, default=Path("likelihoods.csv"))
    given = options.parse_args()
    first = given.first_seed
    todo = [
        (data, kind, size, seed)
        for seed in range(first, first + given.seeds)
        for data in given.data
        for size in (1.0, 2.0, 4.0)
        for kind in KINDS
    ]
    todo += [
        (data, "none", 0.0, seed)
        for seed in range(first, first + given.nulls)
        for data in given.data
    ]
    keys, there = list(COLUMNS[:4]), set()
    if given.out.exists():
        there = set(pd.read_csv(given.out)[keys].itertuples(index=False, name=None))
    with given.out.open("a", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        if not there:
            writer.writeheader()
        for one in todo:
            if one not in there:
                writer.writerow(diagnosed(*one))
                file.flush()
    print(table(pd.read_csv(given.out)).to_string(index=False))


if __name__ == "__main__":
    main()
