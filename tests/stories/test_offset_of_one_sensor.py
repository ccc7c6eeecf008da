"""Outputs side by side, told apart by an input of few values, of which one is off."""

import numpy as np
import pandas as pd
import pytest

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.search.candidate import prior_odds


def reaction(t, sensor, amount, rate):
    """Return what is left at sensor 0, and what has formed at sensor 1."""
    left = amount * np.exp(-rate * t)
    return np.where(sensor == 1, amount - left, left)


REACTION = hs.Simulator(
    reaction,
    {"t": (0, 10), "sensor": (0, 1)},
    {
        "amount": hs.truncated_normal(5, 1, 2, 8),
        "rate": hs.truncated_normal(0.4, 0.1, 0.1, 0.9),
    },
)
ROWS = pd.DataFrame({"t": np.tile(np.linspace(0.2, 10, 20), 2), "sensor": np.repeat([0, 1], 20)})


def diagnose(amplitude, seed):
    y = reaction(ROWS.t, ROWS.sensor, 5.3, 0.45) + amplitude * (ROWS.sensor == 0)
    y = y + 0.2 * np.random.default_rng(seed).standard_normal(40)
    model = hs.PowerScaledSurrogate(
        REACTION, surrogate=hs.ExactSurrogate(), n_draws=100, random_state=0
    )
    return hs.DiscrepancyDiagnosis(model, cv=None, random_state=0).fit(ROWS, y)


@pytest.mark.slow
def test_the_sensor_that_is_off_is_named():
    found = [diagnose(-0.6, seed) for seed in range(10, 15)]
    at_sensor_0 = [
        d for d in found if "where sensor = 0" in d.best_cause_.formula and d.verdict_ == "named"
    ]
    assert len(at_sensor_0) >= 4
    for d in at_sensor_0:
        _, low, high = d.best_cause_.estimates["amplitude"]
        assert low - 0.1 < -0.6 < high + 0.1
        assert d.best_cause_.target == "sensor"
    report = str(at_sensor_0[0].report(full=True))
    assert "where sensor is 0" in report
    assert r"\mathbf{1}_{\text{sensor} = 0}" in report
    # there is no sensor between the two
    assert all(d.next_measurement_["sensor"] in (0, 1) for d in found)


def test_a_level_that_was_not_measured_has_no_offset():
    d = diagnose(-0.6, 10)
    effect = hs.Offset("sensor", level=0)
    model = hs.PowerScaledSurrogate(
        REACTION, surrogate=hs.ExactSurrogate(), effects=[effect], n_draws=100, random_state=0
    ).fit(ROWS, d.estimator_.measured_[1])
    plain = model.predict(pd.DataFrame({"t": [5.0, 5.0], "sensor": [0.0, 1.0]}))
    draws = model.posterior_.estimates(0)["amplitude"]
    simulated = reaction(5.0, np.array([0, 1]), *model.posterior_.values.mean(axis=0)[:2])
    assert plain[0] - simulated[0] == pytest.approx(draws.mean(), abs=0.1)
    assert plain[1] == pytest.approx(simulated[1], abs=0.1)


def test_levels_share_the_prior_of_one_form():
    """Four levels took four fifths of what an offset of all rows had: decay was named."""
    levels = [hs.Offset("sensor", level=level) for level in (0, 1, 2, 3)]
    odds = prior_odds([None, hs.Offset(), *levels, hs.Gain()])
    whole = odds[-1]
    assert odds[1] == pytest.approx(whole / 2)
    np.testing.assert_allclose(odds[2:-1], whole / 8)
    # half is on none, 2 % are kept for what has no name (docs/explanation/how_a_diagnosis_works.md)
    assert odds.sum() == pytest.approx(0.98)


def enzyme(substrate, inhibitor, fastest, half, inhibition):
    return fastest * substrate / (half * (1 + inhibitor / inhibition) + substrate)


@pytest.mark.slow
def test_an_offset_of_all_rows_is_as_probable_where_an_input_has_few_values():
    priors = {
        "fastest": hs.truncated_normal(100, 15, 50, 160),
        "half": hs.truncated_normal(2, 0.5, 0.5, 5),
        "inhibition": hs.truncated_normal(3, 1, 0.8, 8),
    }
    simulator = hs.Simulator(enzyme, {"substrate": (0.1, 20), "inhibitor": (0, 10)}, priors)
    named = []
    for seed in range(6):
        random = np.random.default_rng(seed)
        X = np.column_stack(
            [random.choice([0.25, 0.5, 1, 2, 5, 10, 20], 56), random.choice([0, 1, 3, 10], 56)]
        )
        true = random.normal([100, 2, 3], [10, 0.3, 0.5])
        y = enzyme(*X.T, *true) + 8 + random.normal(0, 3, 56)
        model = hs.PowerScaledSurrogate(
            simulator, surrogate=hs.ExactSurrogate(), n_draws=100, random_state=0
        )
        found = hs.DiscrepancyDiagnosis(model, cv=None, random_state=0).fit(X, y)
        assert "offset" in found.indistinguishable_
        named += [found.best_cause_.kind] if found.verdict_ == "named" else []
    # decay is a rival throughout, and was named
    assert set(named) <= {"offset"}
