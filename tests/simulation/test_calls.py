"""Functions of numbers, functions that fail for some rows, and outputs that are known already."""

import math
import pickle
import time
import warnings

import numpy as np
import pytest

import hybridsurrogate as hs
from hybridsurrogate.simulation import evaluation
from hybridsurrogate.simulation.evaluation import OutputCache

INPUTS, RATE = {"t": (0, 10)}, {"rate": hs.truncated_normal(0.5, 0.2, 0.1, 1)}
T, OMEGA = np.array([0.5, 2.0, 4.0, 8.0]), np.array([0.2, 0.4, 0.6, 0.8])


def scalar(t, rate):
    if t < 1:
        return 1.0
    return math.exp(-rate * (t - 1))


EXACT = np.exp(-OMEGA * np.maximum(T - 1, 0))


def branching(t, rate):
    return t if t > rate else 0 * rate


def constant(t, rate):
    return 3.0


def table(t, rate):
    return {1: 2.0, 2: 3.0}[round(t)]


@pytest.mark.parametrize("function", [scalar, branching, constant])
def test_a_function_of_numbers_is_called_row_by_row_with_one_warning(function):
    """It was a TypeError of numpy: "only length-1 arrays can be converted"."""
    simulator = hs.Simulator(function, INPUTS, RATE)
    with pytest.warns(hs.RowByRowWarning, match=r"np\.exp for math\.exp") as caught:
        found = simulator(T, OMEGA)
    assert caught[0].filename == __file__
    np.testing.assert_allclose(found, [function(t, rate) for t, rate in zip(T, OMEGA, strict=True)])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        simulator(T, OMEGA)
    assert not simulator.vectorized
    assert not pickle.loads(pickle.dumps(simulator)).vectorized


def test_runs_of_a_function_of_numbers():
    simulator = hs.Simulator(scalar, INPUTS, RATE)
    with pytest.warns(hs.RowByRowWarning):
        simulation = simulator.run(16, random_state=0)
    exact = [
        scalar(t, rate) for t, rate in zip(simulation.X[:, 0], simulation.omega[:, 0], strict=True)
    ]
    np.testing.assert_allclose(simulation.y, exact)


def test_a_mistake_in_a_function_comes_through():
    def mistaken(t, rate):
        return undefined_name * t  # noqa: F821

    with pytest.raises(NameError, match="undefined_name"):
        hs.Simulator(mistaken, INPUTS, RATE)(T, OMEGA)


def test_an_array_function_that_fails_for_some_rows_keeps_the_others():
    calls = []

    def fails(t, rate):
        calls.append(len(t))
        if np.any(rate > 0.9):
            raise ValueError("no solution")
        return rate * t

    simulator = hs.Simulator(fails, INPUTS, RATE)
    rate = np.full(512, 0.5)
    rate[77] = 0.95
    found = simulator(np.ones(512), rate)
    assert np.flatnonzero(np.isnan(found)).tolist() == [77]
    np.testing.assert_allclose(np.delete(found, 77), 0.5)
    # halved ten times, not 512 calls
    assert len(calls) < 25
    with pytest.warns(hs.FailedRunsWarning, match="ValueError: no solution"):
        simulator.run(64, random_state=0)


def test_numbers_are_those_of_python_unless_these_fail():
    """Python's numbers are three times as quick; numpy's divide by zero and know methods."""
    simulator = hs.Simulator(lambda t, rate: 1 / (t - 2), INPUTS, RATE, vectorized=False)
    with np.errstate(divide="ignore"):
        np.testing.assert_array_equal(simulator(T, OMEGA)[:2], [1 / -1.5, np.inf])
    clipped = hs.Simulator(lambda t, rate: t.clip(1, 3), INPUTS, RATE, vectorized=False)
    np.testing.assert_array_equal(clipped(T, OMEGA), [1, 2, 3, 3])
    root = hs.Simulator(lambda t, rate: (t - 3) ** 0.5, INPUTS, RATE, vectorized=False)
    with np.errstate(invalid="ignore"):
        np.testing.assert_array_equal(root(T, OMEGA), [np.nan, np.nan, 1, 5**0.5])


def test_what_surrounds_a_call_costs_less_than_three_microseconds():
    """It was 30: a task of joblib for each row."""
    simulator = hs.Simulator(lambda t, rate: t, INPUTS, RATE, vectorized=False)
    X, omega = np.ones((20_000, 1)), np.ones((20_000, 1))
    seconds = []
    for _ in range(5):
        start = time.process_time()
        simulator(X, omega)
        seconds.append(time.process_time() - start)
    assert min(seconds) < 3e-6 * 20_000


def test_names_in_another_order_and_several_outputs():
    def flow(rate, t):
        return {"b": rate, "a": t}

    simulator = hs.Simulator(flow, INPUTS, RATE, output=["a", "b"], vectorized=False)
    np.testing.assert_array_equal(simulator(T, OMEGA), np.column_stack([T, OMEGA]))


def test_many_rows_are_shared_by_processes_where_they_take_long():
    def slow(t, rate):
        time.sleep(0.01)
        if t > 9:
            raise ValueError("too late")
        return t * rate

    simulator = hs.Simulator(slow, INPUTS, RATE, vectorized=False)
    t = np.linspace(0, 10, 250)
    found = simulator(t, np.ones(250), n_jobs=2)
    np.testing.assert_allclose(found, np.where(t > 9, np.nan, t))


class TestOutputCache:
    def test_known_rows_are_not_called_again(self):
        asked = []

        def function(points):
            asked.append(len(points))
            return points.sum(axis=1)

        cache, random = OutputCache(), np.random.default_rng(0)
        points = random.normal(size=(1000, 3))
        for rows in (points, points[::-1], np.repeat(points[:10], 3, axis=0)):
            np.testing.assert_allclose(cache.outputs(function, rows), rows.sum(axis=1))
        assert asked == [1000]
        more = np.vstack([points, random.normal(size=(5, 3))])
        cache.outputs(function, more)
        assert asked == [1000, 5]

    def test_memory_is_bounded_and_nothing_wrong_comes_out(self):
        cache, random = OutputCache(n_bytes=4096), np.random.default_rng(1)
        for _ in range(50):
            points = random.integers(0, 40, size=(300, 2)).astype(float)
            found = cache.outputs(lambda rows: rows @ [100.0, 1.0], points)
            np.testing.assert_array_equal(found, points @ [100.0, 1.0])
        assert sum(part.nbytes for part in cache._table) <= 4096

    def test_memory_of_all_caches_is_bounded(self, monkeypatch):
        """A diagnosis of an ODE had a table for each cause in each fold, 8 GB together."""
        monkeypatch.setattr(evaluation, "_MAX_BYTES_OF_ALL", 3 * 4096)
        caches, points = [OutputCache(n_bytes=4096) for _ in range(9)], np.eye(3)
        for cache in [*caches, caches[0], caches[8]]:
            found = cache.outputs(lambda rows: rows.sum(axis=1), points)
            np.testing.assert_array_equal(found, points.sum(axis=1))
        kept = [k for k, cache in enumerate(caches) if cache._table is not None]
        assert kept == [0, 7, 8]

    def test_failed_rows_and_several_outputs(self):
        cache, asked = OutputCache(), []

        def function(points):
            asked.append(len(points))
            return np.column_stack([points[:, 0], np.full(len(points), np.nan)])

        for _ in range(2):
            found = cache.outputs(function, np.zeros((3, 2)))
            np.testing.assert_array_equal(found, [[0, np.nan]] * 3)
        assert asked == [1]
        assert pickle.loads(pickle.dumps(cache))._table is None


def test_a_search_calls_a_row_once():
    asked = []

    def counted(t, rate):
        asked.append((t, rate))
        return scalar(t, rate)

    simulator = hs.Simulator(counted, INPUTS, RATE, vectorized=False)
    t = np.linspace(0, 10, 12)
    y = np.exp(-0.5 * np.maximum(t - 1, 0)) + 0.05 * np.cos(9 * t)
    model = hs.PowerScaledSurrogate(simulator, surrogate=hs.ExactSurrogate(), random_state=0)
    model.fit(t[:, None], y)
    assert len(set(asked)) > 0.99 * len(asked)


@pytest.mark.parametrize(
    ("seconds", "calls"),
    [((0.0, 0.0, 0.0), 2), ((0.02, 0.02, 0.02), 1), ((0.02, 0.0, 0.02), 2)],
    ids=["quick", "slow", "has to wait twice"],
)
def test_a_quick_function_is_called_again_and_a_slow_one_is_not(monkeypatch, seconds, calls):
    clock = iter(np.cumsum(np.column_stack([np.zeros(3), seconds]).ravel()))
    monkeypatch.setattr(evaluation, "perf_counter", lambda: next(clock))
    cache, asked = OutputCache(), []

    def function(points):
        asked.append(len(points))
        return points.sum(axis=1)

    for _ in seconds:  # measured
        cache.outputs_if_slow(function, np.ones((2000, 2)))
    points = np.random.default_rng(0).normal(size=(2000, 3))
    asked.clear()
    for _ in range(2):
        found = cache.outputs_if_slow(function, points)
        np.testing.assert_allclose(found, points.sum(axis=1))
    # two rows may share a place in the table: the earlier one is called again
    assert round(sum(asked) / 2000) == calls
