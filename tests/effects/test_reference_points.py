"""Where the simulation is right: at a column's mean, at zero, in one batch, after a jump."""

from __future__ import annotations

import re

import numpy as np
import pandas as pd
import pytest
from few_kinds import all_but

import hybridsurrogate as hs
from hybridsurrogate.catalogue import catalogue
from hybridsurrogate.diagnosis.answers.finding import form_of
from hybridsurrogate.effects.base import Context

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
    if name == "line right elsewhere":  # such as a temperature in a laboratory at 20 degrees
        z = rng.uniform(30, 50, len(T))
        return z, 0.04 * (z - 20)
    z = rng.uniform(0, 1, len(T))
    if name == "line from zero":
        return z, 0.8 * z
    if name == "line about the mean":
        return z, 0.8 * (z - z.mean())
    return z, 0.5 * (T < 3.1) if name == "before" else 0.5 * (T >= 3.1)


FEW = all_but("missing-input", "offset", "step", "trend", "interaction")


def diagnosed(hidden, seed, exclude=()):
    rng = np.random.default_rng(seed)
    column, added = truth(hidden, rng)
    y = decay(T, 4.6, 0.33) + added + 0.1 * rng.standard_normal(len(T))
    model = hs.PowerScaledSurrogate(
        SIMULATOR, surrogate=hs.ExactSurrogate(), n_draws=300, random_state=0
    )
    settings = {"exclude": exclude, "cv": None, "n_replicates": 39, "random_state": 0}
    diagnosis = hs.DiscrepancyDiagnosis(model, **settings)
    return diagnosis.fit(pd.DataFrame({"t": T, "z": column}), y)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("hidden", "kind", "target"),
    [
        ("two batches", "missing-input", "z"),
        ("three batches", "missing-input", "z"),
        ("line from zero", "missing-input", "z"),
        ("line about the mean", "missing-input", "z"),
        ("line right elsewhere", "missing-input", "z"),
        ("before", "step", "t"),
        ("after", "step", "t"),
    ],
)
def test_wherever_the_simulation_is_right(hidden, kind, target):
    found = [diagnosed(hidden, seed) for seed in range(4)]
    named = [(d.best_cause_.kind, d.best_cause_.target) for d in found]
    # a rival may come first by chance, but the truth is always among those that are left
    assert named.count((kind, target)) >= 3
    assert all(kind in d.indistinguishable_ for d in found)


def test_numbers_and_formula_from_zero():
    found = diagnosed("line from zero", 0, FEW)
    best = found.best_cause_
    assert found.extended_estimator_.effects[0].variant == "from zero"
    assert list(best.estimates) == ["slope"]
    assert best.estimates["slope"][0] == pytest.approx(0.8, abs=0.2)
    assert re.fullmatch(r"simulation \+ 0\.\d+ z", best.formula)
    assert best.latex.endswith(r"\text{z}")


def test_numbers_and_formula_of_a_line_that_is_right_elsewhere():
    found = diagnosed("line right elsewhere", 0, FEW)
    best = found.best_cause_
    assert found.extended_estimator_.effects[0].variant == "with offset"
    low, high = best.estimates["slope"][1:]
    assert low < 0.04 < high
    assert best.estimates["offset"][0] == pytest.approx(0.8, abs=0.1)
    assert re.fullmatch(r"simulation \+ 0\.\d+ \+ 0\.0\d+ \(z - \d+\.\d+\)", best.formula)
    z = np.array([20.0, 45.0])
    rows = pd.DataFrame({"t": [1.0, 1.0], "z": z})
    added = found.predict(rows)[1] - found.predict(rows)[0]
    assert added == pytest.approx(1.0, abs=0.3)


def test_numbers_of_batches_whose_mean_is_not_zero():
    found = diagnosed("three batches", 1, FEW)
    best = found.best_cause_
    assert found.extended_estimator_.effects[0].variant == "categorical with offset"
    assert [mean for mean, *_ in best.estimates.values()] == pytest.approx([0.2, 0.5, 0.8], abs=0.1)
    assert re.fullmatch(r"simulation \+ 0\.\d+ where z = 0, .*where z = 2", best.formula)
    rows = pd.DataFrame({"t": [1.0, 1.0], "z": [0.0, 2.0]})
    assert np.diff(found.predict(rows)) == pytest.approx(0.6, abs=0.12)


def test_an_offset_is_none_of_one_level():
    context = Context({"t": T, "z": np.arange(40) % 4.0}, 1, {}, {}, 1.0)
    for options in ({"shape": "quadratic"}, {"shape": "categorical", "level": 1.0}):
        with pytest.raises(ValueError, match="or 'categorical' without a level"):
            hs.MissingInput("z", offset=True, **options).prepare(context)


def test_beside_other_causes_an_offset_is_one_of_its_own():
    context = Context({"t": T, "z": T + 30}, 1, {}, {}, 1.0)
    for alone in (True, False):
        forms = [form_of(cause) for cause in catalogue(context, alone=alone)[0]]
        assert ("missing-input: with offset" in forms) is alone


def beam(x, load, stiffness):
    """A deflection, which is zero without a load and where the beam is held."""
    return load * x**2 * (3 - x) / stiffness


@pytest.mark.slow
def test_a_product_from_zero():
    simulator = hs.Simulator(
        beam, {"x": (0, 1), "load": (0, 10)}, {"stiffness": hs.truncated_normal(4, 0.5, 2, 6)}
    )
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=300, random_state=0
    )
    found = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        X = pd.DataFrame({"x": rng.uniform(0.1, 1, 48), "load": rng.uniform(0, 8, 48)})
        y = beam(X["x"], X["load"], 4.2) + 0.15 * X["x"] * X["load"]
        y += 0.05 * rng.standard_normal(48)
        found.append(hs.DiscrepancyDiagnosis(model, cv=None, random_state=0).fit(X, y))
    assert [d.best_cause_.kind for d in found].count("interaction") >= 3
    assert all("interaction" in d.indistinguishable_ for d in found)
    slopes = [
        d.best_cause_.estimates["slope"]
        for d in found
        if d.extended_estimator_.effects[0].variant == "from zero"
    ]
    assert len(slopes) >= 3
    assert all(mean == pytest.approx(0.15, abs=high - low) for mean, low, high in slopes)


def test_a_jump_that_ends():
    before = hs.Step("t", before=True)
    # the amplitude is the change at the place
    rows = {"t": np.array([1.0, 4.0])}
    assert before.columns(rows, {"location": 2.5}).ravel().tolist() == [-1, 0]
    prepared = before.prepare(Context({"t": T}, 1, {}, {}, 1.0))
    formula = prepared.formula({"location": 2.5, "amplitude": 1})
    assert formula == "simulation - 1 where t < 2.5"
    assert "< 2.5" in prepared.latex({"location": 2.5, "amplitude": 1})


@pytest.mark.parametrize(
    ("z", "weighed"),
    [
        (np.linspace(0, 3, 40), True),
        (np.linspace(0.5, 3, 40), True),
        (np.linspace(-3, 0, 40), True),
        (np.linspace(2, 3, 40), False),  # from zero it would be nearly constant
        (np.linspace(-1, 3, 40), False),  # its zero is no beginning
    ],
)
def test_columns_that_begin_at_zero(z, weighed):
    context = Context({"t": T, "z": z}, 1, {}, {}, 1.0)
    forms = [form_of(cause) for cause in catalogue(context)[0]]
    assert ("missing-input: from zero" in forms) is weighed
