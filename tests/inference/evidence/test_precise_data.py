"""Fits that a climb from afar misses: places of jumps, and measurements that are very precise."""

from __future__ import annotations

import numpy as np
import pytest
from few_kinds import all_but

import hybridsurrogate as hs

pytestmark = pytest.mark.numbers


def diagnosed(simulator, t, y, exclude=()):
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=300, random_state=0
    )
    settings = {"exclude": exclude, "cv": None, "n_replicates": 39, "random_state": 0}
    return hs.DiscrepancyDiagnosis(model, **settings).fit(t[:, None], y)


def switched(t, level, jump, where):
    return level + jump * (t >= where)


SWITCH = hs.Simulator(
    switched,
    inputs={"t": (0, 10)},
    parameters={
        "level": hs.truncated_normal(5, 1, 2, 8),
        "jump": hs.truncated_normal(2, 0.5, 0.5, 4),
        "where": hs.truncated_normal(5, 1.5, 1, 9),
    },
)


@pytest.mark.slow
def test_a_simulation_whose_parameter_is_the_place_of_a_jump():
    """Its output has no slope in that parameter; nothing is hidden."""
    alarms = 0
    for seed in range(5):
        rng = np.random.default_rng(seed)
        t = np.sort(rng.uniform(0, 10, 40))
        numbers = rng.normal(5, 0.5), rng.normal(2, 0.3), rng.uniform(3, 7)
        y = switched(t, *numbers) + 0.3 * rng.standard_normal(40)
        found = diagnosed(SWITCH, t, y)
        alarms += found.verdict_ != "adequate"
        # what looked wrong was the fit: it is as close as the estimator's
        assert (
            found.search_.candidates[0].fit.sigma < 1.1 * found.estimator_.posterior_.sigma.mean()
        )
    # at a rate of 5 % more than two of five have a chance of one in 860
    assert alarms <= 2


@pytest.mark.slow
def test_a_step_that_was_found_is_not_found_again():
    rng = np.random.default_rng(1)
    t = np.sort(rng.uniform(0, 10, 50))
    simulator = hs.Simulator(
        lambda t, a, b: a + b * t,
        inputs={"t": (0, 10)},
        parameters={"a": hs.truncated_normal(1, 1, -2, 4), "b": hs.truncated_normal(0, 1, -3, 3)},
    )
    y = 1 + 0.2 * t + 1.5 * (t >= 4) + 0.3 * rng.standard_normal(50)
    first = diagnosed(simulator, t, y)
    assert first.best_cause_.kind == "step"
    assert diagnosed(first.extended_simulator_, t, y).verdict_ == "adequate"


DECAY = hs.Simulator(
    lambda t, a, k: a * np.exp(-k * t),
    inputs={"t": (0, 10)},
    parameters={
        "a": hs.truncated_normal(5, 1, 1, 9),
        "k": hs.truncated_normal(0.3, 0.1, 0.05, 0.8),
    },
)


@pytest.mark.parametrize("noise", [1e-2, 1e-3, 1e-5])
def test_a_plain_wave_in_precise_data_is_no_overtone(noise):
    t = np.linspace(0, 10, 40)
    rng = np.random.default_rng(1)
    y = 4.6 * np.exp(-0.33 * t) + 0.3 * np.sin(2 * t) + noise * rng.standard_normal(40)
    few = all_but("periodic", "step", "trend", "bump")
    best = diagnosed(DECAY, t, y, few).best_cause_
    assert best.kind == "periodic"
    assert best.estimates["period"][0] == pytest.approx(np.pi, abs=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 5])
def test_two_causes_of_one_curve_are_equal_in_precise_data(seed):
    """Late by a lag and larger by a factor are the same for an exponential."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 10, 40)
    y = 1.9 * 5.2 * np.exp(-0.33 * t) + 1e-4 * rng.standard_normal(40)
    found = diagnosed(DECAY, t, y)
    # nor is either separated from the amplitude beyond its prior, which comes first
    assert found.best_cause_.kind == "narrow-prior"
    assert {"gain", "delay"} <= {*found.best_cause_.same_curve}
    told = found.causes_.set_index("kind").log_evidence
    assert told["gain"] > 100
    assert told["gain"] == pytest.approx(told["delay"], abs=3)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("form", "row", "noise"), [("step", 22, 1e-2), ("drift", 12, 1e-3)])
def test_a_jump_between_two_rows_close_together(form, row, noise, seed):
    """One hundredth of the mean distance apart: no grid over time would have a place there."""
    rng = np.random.default_rng(seed)
    t = np.sort(rng.uniform(0, 10, 40))
    t[row + 1] = t[row] + 0.0025
    after = t > t[row]
    y = 4.6 * np.exp(-(0.33 + 0.1 * after * (form == "drift")) * t) + 0.5 * after * (form == "step")
    best = diagnosed(DECAY, t, y + noise * rng.standard_normal(40)).best_cause_
    assert best.kind == {"step": "step", "drift": "parameter-drift"}[form]
    _, low, high = best.estimates["location"]
    assert t[row] < low < high < t[row + 1]
