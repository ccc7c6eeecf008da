"""A simulation that is too slow for a search is told before the search."""

import pickle
import warnings
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from tide import problem_of

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.checks import simulation

FRAME = pd.DataFrame({"t": np.linspace(0, 1, 10)})
SLOPE = {"slope": hs.truncated_normal(1, 1, -3, 5)}


def line(t, slope):
    return slope * t


class Clock:
    """Stands still, but for the simulations."""

    now = 0.0

    def __call__(self):
        return self.now

    def simulation(self, seconds, each):
        """Return a line that takes some seconds a call and some a row."""

        def timed_line(t, slope):
            self.now += seconds + each * np.size(t)
            return line(t, slope)

        return timed_line


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(simulation, "perf_counter", clock)
    return clock


def timed(function):
    simulator = hs.Simulator(function, {"t": (0, 1)}, SLOPE)
    return problem_of(FRAME, np.zeros(len(FRAME)), simulator)


def test_a_slow_simulation_is_told(clock):
    slow = clock.simulation(0, 0.001)
    # ten rows of a millisecond
    assert simulation.seconds_a_run(timed(slow)) == pytest.approx(0.01)
    with pytest.warns(hs.DiagnosisWarning, match=r" 10 ms for one.* 5 minutes.*surrogate=Kriging"):
        simulation.warn_if_slow(timed(slow))


def test_the_estimate_counts_the_folds_and_the_rows(clock):
    """It said 5 minutes or much more: five folds take three to four times as long again."""
    slow = timed(clock.simulation(0, 0.001))
    with pytest.warns(hs.DiagnosisWarning, match=r"128,000 of them, 1,280,000 rows: about 21 min"):
        simulation.warn_if_slow(slow, 5)


def test_a_second_estimate_is_not_one_of_known_outputs():
    def slow_line(t, slope):
        clock.now += 0.001
        return slope * t

    clock = Clock()
    simulator = hs.Simulator(slow_line, {"t": (0, 1)}, SLOPE, vectorized=False)
    problem = problem_of(FRAME, np.zeros(len(FRAME)), simulator)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(simulation, "perf_counter", clock)
        assert [simulation.seconds_a_run(problem) for _ in range(2)] == pytest.approx([0.01, 0.01])


def test_a_fast_simulation_is_not(clock):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        simulation.warn_if_slow(timed(clock.simulation(0, 0.0004)))


def test_what_costs_the_same_for_many_is_timed_with_many(clock):
    assert simulation.seconds_a_run(timed(clock.simulation(0.2, 0))) < 0.001


def test_an_emulator_costs_no_runs():
    problem = timed(line)
    runs = hs.Simulator(line, {"t": (0, 1)}, SLOPE).run(20, random_state=0)
    model = hs.PowerScaledSurrogate(runs, hs.PolynomialChaos(2), n_draws=50, random_state=0)
    told = model.fit(FRAME, np.linspace(0, 1, 10) + 0.01 * np.cos(np.arange(10)))
    emulated = replace(problem, model=told.posterior_.model)
    assert simulation.seconds_a_run(emulated) == 0


def test_what_ran_lately_is_not_run_again():
    calls = []

    def counted(t, slope):
        calls.append(len(t))
        t *= 1.0  # a simulation may use its arguments up
        return line(t, slope)

    simulate = timed(counted).model.basis.simulate
    X, omega = np.linspace(0, 1, 6)[:, None], np.full((6, 1), 2.0)
    first, n = simulate(X, omega), len(calls)
    first[:] = np.nan
    np.testing.assert_array_equal(simulate(X, omega), 2 * X[:, 0])
    assert len(calls) == n
    simulate(X, omega + 1)
    assert len(calls) == n + 1
    again = pickle.loads(pickle.dumps(timed(line).model.basis.simulate))
    np.testing.assert_array_equal(again(X, omega), 2 * X[:, 0])
