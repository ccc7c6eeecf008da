"""Jumps and waves along a measured column that the simulation ignores, hidden and looked for."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

import hybridsurrogate as hs

N = 48
NOISE = 0.3
SIMULATION = hs.Simulator(
    lambda load, stiffness: load / stiffness,
    inputs={"load": (0, 10)},
    parameters={"stiffness": hs.truncated_normal(2.0, 0.5, 0.5, 5.0)},
    output="deflection",
)
HIDDEN = {
    "none": lambda day: 0.0,
    "step": lambda day: 0.8 * (day >= 31),
    "periodic": lambda day: 0.7 * np.sin(2 * np.pi * day / 7 + 1),
}


def diagnosed(hidden, seed):
    """Diagnose one measurement a day, loads in no order."""
    rng = np.random.default_rng(seed)
    day = np.arange(1.0, N + 1)
    frame = pd.DataFrame({"load": rng.permutation(np.linspace(0.5, 9, N)), "day": day})
    y = frame["load"] / 2.3 + HIDDEN[hidden](day) + NOISE * rng.standard_normal(N)
    model = hs.PowerScaledSurrogate(
        SIMULATION, surrogate=hs.ExactSurrogate(), n_draws=300, random_state=seed
    )
    return hs.DiscrepancyDiagnosis(model, cv=None, random_state=seed).fit(frame, y)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("hidden", HIDDEN)
def test_what_happens_from_day_to_day(hidden, seed):
    found = diagnosed(hidden, seed)
    if hidden == "none":
        assert found.verdict_ == "adequate"
        return
    best = found.best_cause_
    assert (found.verdict_, best.kind, best.target) == ("named", hidden, "day")
    # a jump of 2.7 noise sds may be a day or two off; a period is known to 0.07
    name, true, error = {"step": ("location", 30.5, 2), "periodic": ("period", 7, 0.25)}[hidden]
    assert best.estimates[name][0] == pytest.approx(true, abs=error)
    # the extended simulation asks for the day, too
    assert found.extended_simulator_.input_names == ("load", "day")
    # three and a half standard deviations of a difference of means
    size = {"step": 0.8, "periodic": 0.7}[hidden]
    assert best.estimates["amplitude"][0] == pytest.approx(size, abs=0.32)


@pytest.mark.slow
def test_both_at_once():
    """A weekly wave and a jump, one beside the other, over the same ignored column."""
    rng = np.random.default_rng(7)
    day = np.arange(1.0, 2 * N + 1)
    frame = pd.DataFrame({"load": rng.permutation(np.linspace(0.5, 9, 2 * N)), "day": day})
    curve = HIDDEN["step"](day - 20) + HIDDEN["periodic"](day)
    y = frame["load"] / 2.3 + curve + NOISE * rng.standard_normal(2 * N)
    model = hs.PowerScaledSurrogate(
        SIMULATION, surrogate=hs.ExactSurrogate(), n_draws=300, random_state=0
    )
    found = hs.DiscrepancyDiagnosis(model, cv=2, max_causes=2, random_state=0).fit(frame, y)
    assert {(cause.kind, cause.target) for cause in found.found_causes_} == {
        ("step", "day"),
        ("periodic", "day"),
    }
    # and each fold tells all that it chose
    assert found.gain_.kinds == ("periodic + step",) * 2
