"""Rates that `detectability` predicts of planned rows, against those of whole diagnoses.

Usage: ``python examples/studies/planned_rates.py ROWS [--seeds 64] [--first-seed 970000]``. ROWS is a file
of JSON lines, to which data sets are added until all are there: a run that was stopped goes on. Data
sets are of two sorts: "planned" ones, simulated as `detectability` does, and "blind" ones, the cases
of the scorecard. Each is diagnosed, and evaluated by the linearised evidence around the true
parameters: the very same measurements, so that no prior of a cause is a reason for a difference.
"""

from __future__ import annotations

import argparse
import json
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from hidden_effects.cases import FORMS, InfeasibleError, draw_setting, make_case
from hidden_effects.simulations import SIMULATIONS

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.planning.detectability import place_at
from hybridsurrogate.diagnosis.search.simulated import NOTHING, Place, hidden, outcomes, shapes_of

SIZES, ROWS, RATE = (0.5, 1.0, 2.0, 4.0), 40, 0.05
# data sets without a cause, which say what is significant, and of each cause and size
_NULLS, _SETS = 300, 12
_DRAWS = 200


def model_of(simulator: Any, seed: int) -> hs.PowerScaledSurrogate:
    return hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=_DRAWS, random_state=seed
    )


def place_of(simulator: Any, X: Any, omega: Any, noise: float, seed: int) -> tuple[Place, float]:
    """Return the place of true parameters, and what T exceeds in 5 % of data sets there."""
    random = np.random.RandomState(seed)
    mu = simulator(X[:, : len(simulator.input_names)], np.tile(omega, (len(X), 1)))
    model = model_of(simulator, seed)
    place, _ = place_at(model, X, mu, np.array([noise]), (), (), random)
    zeros = np.zeros((_NULLS, len(X)))
    null = outcomes(place, place.responses(zeros, zeros + 1.0, random)).statistic
    return place, float(np.quantile(null, 1 - RATE, method="higher"))


def evaluated(place: Place, limit: float, responses: Any, kind: str) -> list[dict[str, Any]]:
    """Return what the linearised evidence says of data sets (m, n)."""
    found = outcomes(place, responses)
    detected = found.detected(limit, RATE)
    return [
        {
            "predicted": bool(detected[k]),
            "predicted_right": bool(detected[k] and found.kind[k] == kind),
            "predicted_kind": str(found.kind[k]) if detected[k] else NOTHING,
            "statistic": float(found.statistic[k] - limit),
            "predicted_none": float(found.none[k]),
        }
        for k in range(len(responses))
    ]


def diagnosed(simulator: Any, X: Any, y: Any, kind: str, seed: int) -> dict[str, Any]:
    """Return what a whole diagnosis says."""
    diagnosis = hs.DiscrepancyDiagnosis(
        model_of(simulator, seed), cv=None, false_alarm_rate=RATE, random_state=seed
    ).fit(X, y)
    first = diagnosis.best_cause_.kind
    return {
        "verdict": diagnosis.verdict_,
        "p": float(diagnosis.p_value_),
        "none": float(diagnosis.search_.probability[0]),
        "detected": first != NOTHING,
        "right": first == kind,
        "first": first,
    }


def planned(seed: int, done: set[tuple[Any, ...]]) -> Iterator[dict[str, Any]]:
    """Yield data sets with causes drawn as for `detectability`, each kind in one size."""
    rng, random = np.random.default_rng([seed, 1]), np.random.RandomState(seed)
    simulator = SIMULATIONS[list(SIMULATIONS)[seed % len(SIMULATIONS)]]
    setting = draw_setting(simulator, ROWS, rng)
    noise = float(np.exp(rng.uniform(np.log(0.01), np.log(0.1)))) * setting.output_range
    place, limit = place_of(simulator, setting.X, setting.omega, noise, seed)
    for k, kind in enumerate(dict.fromkeys(cause.kind for cause in place.causes)):
        size = SIZES[(k + seed // len(SIMULATIONS)) % len(SIZES)]
        forms = [(c, shapes_of(place, c, random)) for c in place.causes if c.kind == kind]
        made = hidden(place, forms, size, 1 + _SETS, random)
        task = {"sort": "planned", "kind": kind, "size": size, "seed": seed}
        if made is None or tuple(task.values()) in done:
            continue
        # they come form by form
        responses = random.permutation(made[0])
        first, *others = evaluated(place, limit, responses, kind)
        rates = {
            "rate": float(np.mean([one["predicted"] for one in others])),
            "rate_right": float(np.mean([one["predicted_right"] for one in others])),
        }
        y = responses[0]
        found = diagnosed(simulator, setting.X, y, kind, seed)
        yield task | {"simulation": simulator.name} | first | rates | found | {"y": y.tolist()}


def blind(seed: int, done: set[tuple[Any, ...]]) -> Iterator[dict[str, Any]]:
    """Yield cases of the scorecard, each form in one size."""
    for k, form in enumerate(form for form in FORMS if form != NOTHING):
        size = SIZES[(k + seed) % len(SIZES)]
        task = {"sort": "blind", "kind": form, "size": size, "seed": seed}
        if tuple(task.values()) in done:
            continue
        try:
            case = make_case(form, size, seed, ROWS)
        except InfeasibleError:
            continue
        truth, simulator = case.truth, case.simulator
        constants = [simulator.assumed[name].value for name in simulator.assumed_names]
        omega = np.array([*truth["parameters"].values()][: len(simulator.parameter_names)])
        omega = np.append(omega, constants)
        place, limit = place_of(simulator, case.X, omega, truth["noise_sd"], seed)
        (first,) = evaluated(place, limit, case.y[None], truth["kind"])
        found = diagnosed(simulator, case.X, case.y, truth["kind"], seed)
        yield task | {"simulation": simulator.name} | first | found | {"y": case.y.tolist()}


SORTS = {"planned": planned, "blind": blind}


def rows_of(path: Path, sorts: list[str], first: int, seeds: int) -> pd.DataFrame:
    """Return the rows of all data sets; those that a file lacks are made and added to it."""
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    lines = [json.loads(line) for line in text.splitlines() if line.endswith("}")]
    done = {(row["sort"], row["kind"], row["size"], row["seed"]) for row in lines}
    with path.open("a", encoding="utf-8") as file, warnings.catch_warnings():
        warnings.simplefilter("ignore", hs.HybridSurrogateWarning)
        warnings.simplefilter("ignore", RuntimeWarning)
        for seed in range(first, first + seeds):
            for sort in sorts:
                for row in SORTS[sort](seed, done):
                    lines.append(row)
                    file.write(json.dumps(row) + "\n")
                    file.flush()
    return pd.DataFrame(lines)


NAMES = ["predicted", "detected", "predicted_right", "right"]


def compared(table: pd.DataFrame, by: list[str]) -> pd.DataFrame:
    """Return predicted and found rates of groups, with the standard error of their difference."""
    groups = table.groupby(by, sort=True)
    out = groups[NAMES].mean()
    out.insert(0, "sets", groups.size())
    for name, of in (NAMES[:2], NAMES[2:]):
        gap = table[name].astype(float) - table[of].astype(float)
        out[f"error_{of}"] = gap.groupby([table[key] for key in by]).sem()
    return out


def as_page(table: pd.DataFrame) -> str:
    """Return predicted and found rates of each kind and size as Markdown, in percent.

    Detected, and the right kind first: predicted / found of the same data sets.
    """
    table = table.assign(kind=table["kind"].str.partition(":")[0])
    lines = ["| kind | data sets |" + "".join(f" {size:g} |" for size in SIZES)]
    lines.append("| --- | ---: |" + " --- |" * len(SIZES))
    for kind, some in [*table.groupby("kind"), ("all", table)]:
        cells = []
        for size in SIZES:
            mean = some.loc[some["size"] == size, NAMES].mean() * 100
            words = [f"{mean[a]:.0f} / {mean[b]:.0f}" for a, b in (NAMES[:2], NAMES[2:])]
            cells.append(", ".join(words) if mean.notna().all() else "")
        lines.append(f"| {kind} | {len(some)} | {' | '.join(cells)} |")
    return "\n".join(lines)


def main(argv: list[str] | None = None) -> None:
    """Run what was asked for."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("rows", type=Path)
    asked.add_argument("--seeds", type=int, default=64)
    asked.add_argument("--first-seed", type=int, default=970_000)
    asked.add_argument("--sorts", nargs="+", choices=SORTS, default=list(SORTS))
    given = asked.parse_args(argv)
    table = rows_of(given.rows, given.sorts, given.first_seed, given.seeds)
    print(compared(table, ["sort", "size"]).round(3).to_string())
    print(as_page(table))


if __name__ == "__main__":
    main()
