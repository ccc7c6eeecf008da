import pickle

import numpy as np
import pytest
from scipy.optimize import curve_fit

from hybridsurrogate.datasets import load_mauna_loa_co2, load_nile, make_log_sin


def test_log_sin_is_the_published_case_study():
    data = make_log_sin(random_state=0)
    np.testing.assert_allclose(data.X[:, 0], np.linspace(1, 100, 30))
    assert data.simulation.n_runs == 100
    assert data.simulation.input_ranges == {"x": (1, 200)}
    assert data.simulation.parameter_ranges["omega"] == pytest.approx((0.6, 1.4))
    # two rows of the authors' test sets
    for x, mu in [(10.168261639598374, 3.9077455404075971), (188.11578659436026, 8.1372030152898)]:
        process = data.simulator([x], [1.0]) + np.sin(0.05 * x)
        np.testing.assert_allclose(process, mu, rtol=1e-12)


@pytest.mark.parametrize(("word", "low", "high"), [("in", 1, 100), ("out", 100, 200)])
def test_log_sin_test_sets(word, low, high):
    data = make_log_sin(n_test=4000, random_state=1)
    X, mu, y = data[f"X_{word}"], data[f"mu_{word}"], data[f"y_{word}"]
    assert X.shape == (4000, 1)
    assert low <= X.min() < low + 1
    assert high - 1 < X.max() <= high
    truth = data.simulator(X, np.ones(4000)) + np.sin(0.05 * X[:, 0])
    np.testing.assert_allclose(mu, truth)
    assert np.std(y - mu) == pytest.approx(0.2, rel=0.05)


def test_log_sin_repeats_with_its_seed():
    one, two, other = (make_log_sin(random_state=seed) for seed in (5, 5, 6))
    np.testing.assert_array_equal(one.y, two.y)
    np.testing.assert_array_equal(one.simulation.y, two.simulation.y)
    assert not np.array_equal(one.y, other.y)


@pytest.mark.parametrize(
    ("load", "n_rows", "start", "sd"),
    [(load_mauna_loa_co2, 521, (280, 35, 0.02), 2.2), (load_nile, 100, (1000,), 169)],
)
def test_simulation_follows_all_but_the_hidden_cause(load, n_rows, start, sd):
    data = load()
    assert data.data.shape == (n_rows, 1)
    assert list(data.data.columns) == list(data.simulator.input_names) == ["year"]
    assert data.target.name == data.simulator.output
    low, high = data.simulator.input_ranges["year"]
    assert data.data["year"].between(low, high).all()
    assert "public domain" in data.DESCR
    best, _ = curve_fit(data.simulator.function, data.data["year"], data.target, start)
    for value, prior in zip(best, data.simulator.parameters.values(), strict=True):
        assert 0.01 < prior.cdf(value) < 0.99
    residual = data.target - data.simulator(data.data, best * np.ones((n_rows, 1)))
    assert residual.std() == pytest.approx(sd, rel=0.01)


@pytest.mark.parametrize("make", [make_log_sin, load_mauna_loa_co2, load_nile])
def test_simulators_can_be_pickled(make):
    simulator = make().simulator
    assert repr(pickle.loads(pickle.dumps(simulator))) == repr(simulator)
    assert simulator.run(16, random_state=0).n_runs == 16
