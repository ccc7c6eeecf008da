"""A simulation that is too slow for a search is told before the search."""

import time
import warnings
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from tide import problem_of

import hybridsurrogate as hs
from hybridsurrogate.diagnosis import cost

FRAME = pd.DataFrame({"t": np.linspace(0, 1, 10)})
SLOPE = {"slope": hs.truncated_normal(1, 1, -3, 5)}


def line(t, slope):
    return slope * t


def slow_line(t, slope):
    time.sleep(0.001 * np.size(t))  # 10 ms for a set of parameters
    return slope * t


def timed(function):
    simulator = hs.Simulator(function, {"t": (0, 1)}, SLOPE)
    return problem_of(FRAME, np.zeros(len(FRAME)), simulator)


def test_a_slow_simulation_is_told(monkeypatch):
    monkeypatch.setattr(cost, "_TIMED", (2, 3))
    with pytest.warns(hs.DiagnosisWarning, match=r"ms for one set.*minutes.*surrogate=Kriging"):
        cost.warn_if_slow(timed(slow_line))


def test_a_fast_simulation_is_not():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        cost.warn_if_slow(timed(line))


def test_what_costs_the_same_for_many_is_timed_with_many():
    def overhead(t, slope):
        time.sleep(0.02)
        return slope * t

    assert cost.seconds_a_run(timed(overhead)) < 0.01


def test_an_emulator_costs_no_runs():
    problem = timed(slow_line)
    runs = hs.Simulator(line, {"t": (0, 1)}, SLOPE).run(20, random_state=0)
    model = hs.PowerScaledSurrogate(runs, hs.PolynomialChaos(2), n_draws=50, random_state=0)
    told = model.fit(FRAME, np.linspace(0, 1, 10) + 0.01 * np.cos(np.arange(10)))
    emulated = replace(problem, model=told.posterior_.model)
    assert cost.seconds_a_run(emulated) == 0
