"""Batches that differ in one parameter: is it found, and is its spread told right?

``python -m examples.studies.experiments --rows rows.csv`` prints the table of
`docs/evidence/experiments.md`. Each finished case is a row of the file, and a stopped run goes on
with those that are left. 10 batches of 12 rows, a column that numbers them, and one parameter of
the simulation that differs between them by as much as gives an effect of 1 or 2 times the noise;
without a difference whatever is found is a false alarm. Gaps: the numbers of the batches have some,
as those of subjects do, and are declared. Curves: no parameter differs, but each batch strays by a
cubic of its own. Declared: ``by_experiment`` names the parameter, and nothing else is wrong."""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
from joblib import Parallel, delayed
from numpy.polynomial.legendre import legval
from scipy import stats

import hybridsurrogate as hs

BATCHES, ROWS, NOISE = 10, 12, 0.05


def decay(x, rate, level):
    return level * np.exp(-rate * x)


def wave(x, mean, height, speed):
    return mean + height * np.sin(speed * x)


DECAY = hs.Simulator(
    decay,
    inputs={"x": (0, 4)},
    parameters={"rate": stats.lognorm(0.5, scale=0.5), "level": stats.norm(3, 1)},
)
WAVE = hs.Simulator(
    wave,
    inputs={"x": (0, 4)},
    parameters={
        "mean": stats.norm(1, 1),
        "height": stats.norm(1, 0.5),
        "speed": stats.lognorm(0.3, scale=1.5),
    },
)
# simulation, the true parameters, and the one that differs
SETTINGS = (
    (DECAY, {"rate": 0.5, "level": 3.0}, "rate"),
    (DECAY, {"rate": 0.5, "level": 3.0}, "level"),
    (WAVE, {"mean": 1.2, "height": 1.1, "speed": 1.4}, "speed"),
)


def make_batches(seed, size):
    """Return simulation, rows, outputs and the name of the parameter that differs."""
    simulator, truth, target = SETTINGS[seed % len(SETTINGS)]
    rng = np.random.default_rng(seed)
    x = rng.uniform(0, 4, (BATCHES, ROWS))
    u = rng.standard_normal(BATCHES)

    def outputs(spread):
        values = truth[target] * (1 + spread * u)
        values = values if target == "level" else np.maximum(values, 1e-3)
        return simulator.simulator.function(x, **{**truth, target: values[:, None]})

    def effect(spread):
        change = outputs(spread) - outputs(0.0)
        return np.sqrt(np.mean((change - change.mean()) ** 2)) / NOISE

    low, high = 0.0, 1.0
    for _ in range(50):
        middle = (low + high) / 2
        low, high = (middle, high) if effect(middle) < size else (low, middle)
    y = outputs(low) + NOISE * rng.standard_normal(x.shape)
    batch = np.repeat(np.arange(1, BATCHES + 1), ROWS)
    return simulator, pd.DataFrame({"x": x.ravel(), "batch": batch}), y.ravel(), target


def make_curves(seed, size):
    """Return the same where each batch strays by a cubic of its own, ``size`` times the noise."""
    simulator, truth, _ = SETTINGS[seed % len(SETTINGS)]
    rng = np.random.default_rng([77, seed])
    x = rng.uniform(0, 4, (BATCHES, ROWS))
    # of level, slope, bend and twist
    heights = rng.standard_normal((4, BATCHES)) * np.array([[0.3], [1.0], [1.0], [0.6]])
    curves = np.stack([legval(x[k] / 2 - 1, heights[:, k]) for k in range(BATCHES)])
    curves *= size * NOISE / np.sqrt(np.mean(curves**2))
    y = simulator.simulator.function(x, **truth) + curves + NOISE * rng.standard_normal(x.shape)
    batch = np.repeat(np.arange(1, BATCHES + 1), ROWS)
    return simulator, pd.DataFrame({"x": x.ravel(), "batch": batch}), y.ravel(), "x"


def diagnosed(what, seed, size):
    """Return a row of the table of cases."""
    declared, curves = what == "declared", what.startswith("curves")
    simulator, X, y, target = (make_curves if curves else make_batches)(seed, size)
    if what.startswith("gaps"):
        numbers = 300 + np.cumsum(np.random.default_rng(seed).integers(1, 20, BATCHES))
        X = X.assign(batch=numbers[X.batch - 1])
    options = {"experiment": "batch", "by_experiment": {target: "spread"}} if declared else {}
    if what.startswith("gaps"):  # else they were a quantity
        options = {"experiment": "batch"}
    model = hs.PowerScaledSurrogate(simulator, hs.ExactSurrogate(), random_state=0, **options)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hs.HybridSurrogateWarning)
        diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, random_state=0).fit(X, y)
    first = diagnosis.causes_[diagnosis.causes_.kind != "none"].iloc[0]
    kind = "curve-by-experiment" if curves else "parameter-by-experiment"
    right = first.kind == kind and first.target == target
    return {
        "what": what,
        "seed": seed,
        "verdict": diagnosis.verdict_,
        "right_first": right,
    }


def covered(seed, spread=0.15):
    """Return whether 90 % intervals of spread and mean hold the truth, as a row."""
    rng = np.random.default_rng(1000 + seed)
    rates = np.maximum(0.5 + spread * rng.standard_normal(BATCHES), 0.01)
    x = rng.uniform(0, 4, (BATCHES, ROWS))
    y = decay(x, rates[:, None], 3.0) + NOISE * rng.standard_normal(x.shape)
    X = pd.DataFrame({"x": x.ravel(), "batch": np.repeat(np.arange(BATCHES), ROWS)})
    model = hs.PowerScaledSurrogate(
        DECAY,
        hs.ExactSurrogate(),
        experiment="batch",
        by_experiment={"rate": "spread"},
        random_state=0,
    ).fit(X, y.ravel())
    told = model.posterior_.estimates(0)["spread"], model.posterior_.values[:, 0]
    ends = [np.quantile(values, [0.05, 0.95]) for values in told]
    holds = [low <= true <= high for true, (low, high) in zip((spread, 0.5), ends, strict=True)]
    return {"what": "interval", "seed": seed, "spread_held": holds[0], "mean_held": holds[1]}


def summary(rows):
    """Return the table, in Markdown."""
    lines = ["| cases | number | right first | adequate | named |", "|---|---|---|---|---|"]
    cases = rows[rows.what != "interval"]
    for what, some in cases.groupby("what"):
        shares = (
            some.right_first.astype(float).mean(),
            *((some.verdict == word).mean() for word in ("adequate", "named")),
        )
        first, *others = (f"{100 * share:.0f} %" for share in shares)
        found = "-" if what == "declared" or what.endswith(" 0") else first
        lines.append(f"| {what} | {len(some)} | {found} | {' | '.join(others)} |")
    held = rows[rows.what == "interval"]
    if len(held):
        lines.append("")
        lines.append(
            f"Of {len(held)} declared data sets 90 % intervals hold the spread in "
            f"{100 * held.spread_held.astype(float).mean():.0f} % and the mean in "
            f"{100 * held.mean_held.astype(float).mean():.0f} %."
        )
    return "\n".join(lines)


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--cases", type=int, default=60, help="of each size, and declared")
    parser.add_argument("--nulls", type=int, default=100)
    parser.add_argument("--intervals", type=int, default=200)
    parser.add_argument("--rows", type=Path, default=None, help="CSV that keeps finished cases")
    parser.add_argument("--jobs", type=int, default=1)
    chosen = parser.parse_args(arguments)
    wanted = {f"size {size:g}": (size, chosen.cases) for size in (1.0, 2.0)}
    wanted |= {"size 0": (0.0, chosen.nulls), "declared": (2.0, chosen.cases)}
    wanted |= {"gaps, size 2": (2.0, chosen.cases), "gaps, size 0": (0.0, chosen.nulls)}
    wanted |= {f"curves, size {size:g}": (size, chosen.cases) for size in (1.0, 2.0)}
    tasks = {
        (what, k): delayed(diagnosed)(what, k, size)
        for what, (size, number) in wanted.items()
        for k in range(number)
    }
    tasks |= {("interval", k): delayed(covered)(k) for k in range(chosen.intervals)}
    rows = []
    if chosen.rows is not None and chosen.rows.exists():
        rows = pd.read_csv(chosen.rows).to_dict("records")
    done = {(row["what"], row["seed"]) for row in rows}
    left = [task for key, task in tasks.items() if key not in done]
    for row in Parallel(n_jobs=chosen.jobs, return_as="generator")(left):
        rows.append(row)
        if chosen.rows is not None:
            pd.DataFrame(rows).to_csv(chosen.rows, index=False)
    print(summary(pd.DataFrame(rows)))


if __name__ == "__main__":
    main()
