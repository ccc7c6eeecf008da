"""Italy's first wave of COVID-19: what weight does an SIR model deserve, and what does it miss?

Data: Dipartimento della Protezione Civile, CC-BY-4.0; confirmed minus recovered per 100,000.
Usage: ``python examples/italy_covid.py [FOLDER] [--fast]``; FOLDER holds italy_covid19_wave1.csv.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

import numpy as np
import pandas as pd

import hybridsurrogate as hs
from hybridsurrogate.scoring import rmse

FILE = "italy_covid19_wave1.csv"
N_TRAIN, N_TEST = 60, 14
PER = 100_000.0


def slopes(t, state, contact_rate, recovery_rate):
    """Return the slopes of susceptible and infected per 100,000 of an SIR epidemic."""
    new = contact_rate * state[0] * state[1] / PER
    return np.stack([-new, new - recovery_rate * state[1]])


def find_data(folder: str | None) -> Path:
    """Return the folder with the data: the given one, the environment's, or the shared one."""
    shared = Path(__file__).resolve().parents[2] / "shared" / "data"
    for place in (folder, os.environ.get("HYBRIDSURROGATE_DATA"), shared):
        if place and (Path(place) / FILE).exists():
            return Path(place)
    sys.exit(f"{FILE} was not found: name the folder that holds it.")


def main() -> None:
    """Scan beta for both schemes, then diagnose."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?")
    parser.add_argument("--fast", action="store_true", help="few runs, draws and betas")
    given = parser.parse_args()
    frame = pd.read_csv(find_data(given.folder) / FILE, comment="#")
    t = frame["day"].to_numpy(dtype=float)[:, None] + 1
    y = frame["conf_minus_rec_per_100k"].to_numpy(dtype=float)
    train, test = slice(0, N_TRAIN), slice(N_TRAIN, N_TRAIN + N_TEST)

    simulator = hs.OdeSimulator(
        slopes,
        initial_state=[PER - y[0], y[0]],
        # one person in Italy is 1.7e-3 per 100,000: no less
        observe=lambda state: np.maximum(state[1], 1e-3),
        inputs={"t": (1, 74)},
        parameters={
            "contact_rate": hs.truncated_normal(0.3, 0.1, 0.1, 1.3),
            "recovery_rate": hs.truncated_normal(0.2, 0.1, 0.1, 0.6),
        },
        states=("susceptible", "infected"),
        output="infected per 100,000",
        max_step=1.0 if given.fast else 0.5,
    )
    simulation = simulator.run(200 if given.fast else 1000, random_state=0)
    settings = {
        "surrogate": hs.PolynomialChaos(degree=5),
        "likelihood": "lognormal",
        "n_draws": 200 if given.fast else 1000,
        "random_state": 0,
    }
    betas = (0.0, 0.5, 1.0) if given.fast else np.round(np.linspace(0, 1, 11), 2)
    rows = []
    for scheme in (hs.PowerScaledSurrogate, hs.PredictiveWeightedSurrogate):
        for beta in betas:
            model = scheme(simulation, beta=float(beta), **settings).fit(t[train], y[train])
            draws = model.sample_predictive_mean(t[test])
            # the measured values stand in for the truth, which nobody knows
            score = model.score(t[test], y[test])
            rows.append((scheme.__name__, float(beta), score, rmse(draws, y[test])))
    table = pd.DataFrame(rows, columns=["scheme", "beta", "ELPD per day", "RMSE per 100,000"])
    print(f"Days {N_TRAIN + 1} to {N_TRAIN + N_TEST}, from the {N_TRAIN} days before:")
    print(table.to_string(index=False, float_format="%.3g"))
    best = table.loc[table.groupby("scheme")["ELPD per day"].idxmax()]
    print("\nBest beta of each scheme:")
    print(best.to_string(index=False, float_format="%.3g"))

    # the diagnosis asks the equations themselves, so that their rates may change inside
    model = hs.PowerScaledSurrogate(
        simulator, **{**settings, "surrogate": hs.ExactSurrogate(), "n_draws": 1000}
    )
    diagnosis = hs.DiscrepancyDiagnosis(
        model, cv=None, n_replicates=50 if given.fast else 200, random_state=0
    ).fit(t[train], y[train])
    print()
    print(diagnosis.verdict_, diagnosis.best_cause_.formula)
    for name, fitted in {
        "without the cause": diagnosis.estimator_,
        "with the cause": diagnosis.extended_estimator_,
    }.items():
        error = rmse(fitted.sample_predictive_mean(t[test]), y[test])
        score = fitted.score(t[test], y[test])
        print(f"{name}: ELPD per day {score:.2f}, RMSE per 100,000 {error:.1f}")
    if not given.fast:
        print(diagnosis.report(test=(t[test], y[test])))


if __name__ == "__main__":
    main()
