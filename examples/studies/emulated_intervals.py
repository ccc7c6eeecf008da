"""Whether intervals of a hidden cause hold the truth where the simulation is known from runs.

``python -m examples.studies.emulated_intervals --seeds 40`` prints a line a case, and the share at the end:
whether the 90 % interval holds the truth over Kriging and over polynomials, and how wide these are
beside the interval with the simulation itself.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from pathlib import Path
from typing import NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))

from hidden_effects.cases import make_case

import hybridsurrogate as hs

# the kind, the word of the estimate and that of the truth
NUMBERS = (
    ("offset", "amplitude", "value"),
    ("step", "location", "location"),
    ("step", "amplitude", "value"),
    ("trend", "slope", "slope"),
)
MAKERS = {"offset": lambda name: hs.Offset(), "step": hs.Step, "trend": hs.Trend}


class Interval(NamedTuple):
    """A number that was hidden, and what is told of it."""

    truth: float
    low: float
    high: float

    @property
    def holds(self):
        return self.low <= self.truth <= self.high

    @property
    def width(self):
        return self.high - self.low


def intervals(number, seed, surrogates, n_runs=100):
    """Return an interval a surrogate of 40 rows of a case with an effect of twice the noise."""
    kind, word, key = number
    case = make_case(kind, 2.0, seed, 40)
    cause = MAKERS[kind](case.truth.get("target", case.simulator.input_names[0]))
    runs = case.simulator.run(n_runs, random_state=seed)
    out = []
    for surrogate in surrogates:
        known = case.simulator if isinstance(surrogate, hs.ExactSurrogate) else runs
        model = hs.PowerScaledSurrogate(
            known, surrogate, effects=[cause], n_draws=200, random_state=0
        ).fit(case.X, case.y)
        ends = np.quantile(model.posterior_.estimates(0)[word], [0.05, 0.95])
        out.append(Interval(case.truth[key], *ends))
    return out


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--first-seed", type=int, default=5200)
    chosen = parser.parse_args(arguments)
    warnings.simplefilter("ignore", hs.HybridSurrogateWarning)
    surrogates = (hs.Kriging(), hs.PolynomialChaos(), hs.ExactSurrogate())
    holds = []
    for seed in range(chosen.first_seed, chosen.first_seed + chosen.seeds):
        for number in NUMBERS:
            found = intervals(number, seed, surrogates)
            holds.append([one.holds for one in found])
            widths = [one.width / found[-1].width for one in found[:-1]]
            words = "  ".join(
                f"{name} {'holds' if one.holds else 'misses'}"
                for name, one in zip(("Kriging", "polynomials", "exact"), found, strict=True)
            )
            print(f"{number[0]:7}{number[1]:10}{seed}  {words}  {np.round(widths, 2)}", flush=True)
    share = 100 * np.mean(holds, axis=0)
    print(
        f"{len(holds)} cases: Kriging {share[0]:.0f} %, polynomials {share[1]:.0f} %, exact ",
        end="",
    )
    print(f"{share[2]:.0f} % hold")


if __name__ == "__main__":
    main()
