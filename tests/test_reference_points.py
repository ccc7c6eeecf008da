"""Where the simulation is right: at a column's mean, at zero, in one batch, after a jump."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

import hybridsurrogate as hs

T = np.linspace(0.2, 10, 40)


def decay(t, a, k):
    """A simulation without a parameter that sets its level."""
    return a * np.exp(-k * t)


SIMULATOR = hs.Simulator(
    decay,
    inputs={"t": (0, 10)},
    parameters={
        "a": hs.truncated_normal(5, 1, 1, 9),
        "k": hs.truncated_normal(0.3, 0.1, 0.05, 0.8),
    },
)


def truth(name, rng):
    """Return the extra column and what it adds."""
    if name == "two batches":
        batch = rng.integers(0, 2, len(T)).astype(float)
        return batch, 0.4 * batch
    if name == "three batches":
        batch = rng.integers(0, 3, len(T)).astype(float)
        return batch, np.array([0.2, 0.5, 0.8])[batch.astype(int)]
    z = rng.uniform(0, 1, len(T))
    if name == "line from zero":
        return z, 0.8 * z
    if name == "line about the mean":
        return z, 0.8 * (z - z.mean())
    return z, 0.5 * (T < 3.1) if name == "before" else 0.5 * (T >= 3.1)


def diagnosed(hidden, seed):
    rng = np.random.default_rng(seed)
    column, added = truth(hidden, rng)
    y = decay(T, 4.6, 0.33) + added + 0.1 * rng.standard_normal(len(T))
    model = hs.PowerScaledSurrogate(
        SIMULATOR, surrogate=hs.ExactSurrogate(), n_draws=300, random_state=0
    )
    diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, random_state=0)
    return diagnosis.fit(pd.DataFrame({"t": T, "z": column}), y)


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize(
    ("hidden", "kind", "target"),
    [
        ("two batches", "missing-input", "z"),
        ("three batches", "missing-input", "z"),
        ("line from zero", "missing-input", "z"),
        ("line about the mean", "missing-input", "z"),
        ("before", "step", "t"),
        ("after", "step", "t"),
    ],
)
def test_wherever_the_simulation_is_right(hidden, kind, target, seed):
    best = diagnosed(hidden, seed).best_cause_
    assert (best.kind, best.target) == (kind, target)


def test_numbers_and_formula_of_a_level_of_its_own():
    found = diagnosed("line from zero", 0)
    best = found.best_cause_
    assert found.extended_estimator_.effects[0].variant == "with level"
    assert best.estimates["slope"][0] == pytest.approx(0.8, abs=0.2)
    # right at zero: half of the slope is missing at the mean
    assert best.estimates["level"][0] == pytest.approx(0.4, abs=0.1)
    assert "simulation + 0.4" in best.formula
    assert r"\text{simulation} + 0.4" in best.latex
    before = hs.Step("t", before=True)
    assert before.columns({"t": np.array([1.0, 4.0])}, {"location": 2.5}).ravel().tolist() == [1, 0]


def test_one_level_has_no_mean():
    cause = hs.MissingInput("z", "categorical", level=1.0, centered=False)
    model = hs.PowerScaledSurrogate(
        SIMULATOR, surrogate=hs.ExactSurrogate(), effects=(cause,), random_state=0
    )
    with pytest.raises(ValueError, match="leave centered=True"):
        model.fit(pd.DataFrame({"t": T, "z": np.arange(40) % 2}), decay(T, 4.6, 0.33))
