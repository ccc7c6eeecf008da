"""Blind cases of jumps that come back and decay, of correlated noise, of other faults, of none.

A simulation of a straight fade. Jumps have separate sizes; their root mean square is the size of
the case, in standard deviations of the noise. `RecurringJumps` is compared with the catalogue.

    python examples/studies/recurring_jumps.py --cases 20 --first 880000
"""

from __future__ import annotations

import argparse
import warnings
from collections import Counter

import numpy as np
from scipy.stats import norm

import hybridsurrogate as hs

ROWS, NOISE, SIZE = 120, 0.01, 4.0
KINDS = ("jumps", "none", "correlated", "one step", "one decay", "episode")


def faded(cycle, start, fade):
    return start - fade * cycle


SIMULATOR = hs.Simulator(
    faded,
    inputs={"cycle": (1, ROWS)},
    parameters={"start": norm(2, 0.1), "fade": hs.truncated_normal(0.003, 0.002, 0, 0.02)},
)


def case(kind: str, seed: int):
    """Return cycles, measurements, and the places of the jumps."""
    rng = np.random.default_rng(seed)
    cycle = np.arange(1.0, ROWS + 1)
    places: list[float] = []
    noise = rng.normal(size=ROWS)
    added = np.zeros(ROWS)
    if kind == "jumps":
        n, scale = rng.integers(3, 9), rng.uniform(3, 15)
        places = sorted(rng.choice(np.arange(5.0, ROWS - 3), n, replace=False).tolist())
        sizes = rng.gamma(4, 1, n)
        sizes *= SIZE / np.sqrt(np.mean(sizes**2))
        for place, size in zip(places, sizes, strict=True):
            since = cycle - place
            added += np.where(since >= 0, size * np.exp(-np.maximum(since, 0) / scale), 0)
    elif kind == "correlated":
        length, share = rng.uniform(2, 10), rng.uniform(0.5, 0.95)
        for k in range(1, ROWS):
            keep = np.exp(-1 / length)
            added[k] = keep * added[k - 1] + np.sqrt(1 - keep**2) * rng.normal()
        added, noise = np.sqrt(share) * added, np.sqrt(1 - share) * noise
    elif kind != "none":
        place, size = rng.uniform(0.2, 0.7) * ROWS, SIZE * rng.choice([-1, 1])
        since = cycle - place
        if kind == "one step":
            added = size * (since >= 0)
        elif kind == "one decay":
            added = size * np.exp(-(cycle - 1) / rng.uniform(4, 20))
        else:
            added = size * ((since >= 0) & (since < rng.uniform(5, 30)))
    y = faded(cycle, 2 + 0.05 * rng.normal(), 0.003) + NOISE * (added + noise)
    return cycle, y, places


def main(argv: list[str] | None = None) -> None:
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--cases", type=int, default=20)
    asked.add_argument("--first", type=int, default=880000)
    asked.add_argument("--kinds", nargs="+", default=list(KINDS))
    given = asked.parse_args(argv)
    warnings.simplefilter("ignore")
    for kind in given.kinds:
        counts: Counter[str] = Counter()
        for k in range(given.cases):
            seed = given.first + 1000 * KINDS.index(kind) + k
            cycle, y, places = case(kind, seed)
            model = hs.PowerScaledSurrogate(
                SIMULATOR, surrogate=hs.ExactSurrogate(), n_draws=300, random_state=0
            )
            found = hs.DiscrepancyDiagnosis(
                model, causes=[hs.RecurringJumps("cycle")], cv=None, random_state=0
            ).fit(cycle[:, None], y)
            table = found.causes_.set_index("kind")["probability"]
            first = found.best_cause_
            counts[found.verdict_] += 1
            counts["alarm"] += found.p_value_ <= 0.05
            is_named = found.verdict_ in ("named", "nearest") and first.kind == "recurring-jumps"
            counts["jumps named"] += is_named
            counts["jumps first"] += first.kind == "recurring-jumps"
            counts["jumps in set"] += "recurring-jumps" in found.indistinguishable_
            at = []
            if first.kind == "recurring-jumps" and places:
                cause = next(e for e in _effects(found) if e.kind == "recurring-jumps")
                at = list(cause.places)
                near = sum(min(abs(p - q) for q in at) <= 1 for p in places)
                counts["places"] += len(places)
                counts["places within a row"] += near
                counts["further places"] += len(at) - near
            print(
                f"{seed} {kind:10} {found.verdict_:11} p {found.p_value_:.3f} {first.kind:16}"
                f" jumps {table['recurring-jumps']:.3f} {found.indistinguishable_}"
                f" {[int(p) for p in places]} {[int(p) for p in at]}",
                flush=True,
            )
        print(kind, given.cases, dict(counts), flush=True)


def _effects(found: hs.DiscrepancyDiagnosis):
    after = found.extended_estimator_
    return getattr(after, "estimators_", [after])[0].effects


if __name__ == "__main__":
    main()
