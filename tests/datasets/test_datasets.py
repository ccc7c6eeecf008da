import pickle
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import curve_fit
from shared_files import ReferenceCase, needs_reference

import hybridsurrogate as hs
from hybridsurrogate import datasets
from hybridsurrogate.datasets import (
    load_mauna_loa_co2,
    load_nile,
    load_nist_chwirut1,
    load_nist_enso,
    make_log_sin,
    make_sir,
)
from hybridsurrogate.datasets.sir import infected


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
    ("t", "contact_rate", "recovery_rate"),
    [(14, 3, 0.3), (14, 3, 0.9), (14, 1, 0.9), (1, 2, 0.55), (7.5, 1.6, 0.7), (20, 3, 0.3)],
)
def test_infected_agrees_with_an_adaptive_solver(t, contact_rate, recovery_rate):
    def rates(_, state):
        susceptible, ill = state
        new = contact_rate * susceptible * ill / 763
        return [-new, new - recovery_rate * ill]

    solved = solve_ivp(rates, (0, t), [762, 1], method="DOP853", rtol=1e-12, atol=1e-10)
    number = infected(t, contact_rate, recovery_rate)
    assert number.shape == ()
    assert number == pytest.approx(solved.y[1, -1], rel=1e-8)


def test_infected_has_the_closed_form_of_an_epidemic_without_recovery():
    # di/dt = contact_rate i (1 - i): logistic growth from 1 / 763
    t = np.linspace(0, 14, 50)
    np.testing.assert_allclose(infected(t, 1.5, 0.0), 763 / (1 + 762 * np.exp(-1.5 * t)))


def test_infected_does_one_row_as_it_does_many():
    rng = np.random.default_rng(0)
    rows = rng.uniform((1, 1, 0.3), (14, 3, 0.9), (40, 3))
    together = infected(*rows.T)
    alone = np.concatenate([infected(*row[:, None]) for row in rows])
    np.testing.assert_allclose(together, alone, rtol=1e-12)


@needs_reference
def test_sir_is_the_published_case_study():
    case = ReferenceCase("case2")
    data = make_sir(random_state=0)
    np.testing.assert_allclose(data.X, case.X)
    assert data.simulation.n_runs == len(case.tables["sim"])
    assert data.simulation.input_ranges == {"t": case.x_range}
    assert data.simulation.parameter_ranges["contact_rate"] == pytest.approx(case.omega_range)
    prior, published = data.simulator.parameters["contact_rate"], case.omega_prior
    np.testing.assert_allclose(prior.ppf([0.1, 0.5, 0.9]), published.ppf([0.1, 0.5, 0.9]))
    runs = case.tables["sim"]
    simulated = data.simulator(runs["x"], runs["omega"])
    np.testing.assert_allclose(simulated, runs["I"] + 1, rtol=1e-8)
    np.testing.assert_allclose(data.simulator_fixed(runs["x"], runs["omega"]), simulated)
    # the authors' runs are whole numbers, rounded up or down at random
    assert (np.abs(simulated - runs["y"]) < 1).all()
    for name in ("real", "oos", "ood"):
        table = case.tables[name]
        truth = data.simulator(table["x"], np.tile([1.6, 0.7], (len(table), 1)))
        np.testing.assert_allclose(truth, table["mu"], rtol=1e-8)


@pytest.mark.parametrize(("word", "low", "high"), [("in", 1, 7.5), ("out", 7.5, 14)])
@pytest.mark.parametrize("add_one", [True, False])
def test_sir_test_sets(word, low, high, add_one):
    data = make_sir(n_test=8000, add_one=add_one, random_state=1)
    X, mu, y = data[f"X_{word}"], data[f"mu_{word}"], data[f"y_{word}"]
    assert X.shape == (8000, 1)
    assert low <= X.min() < low + 0.1
    assert high - 0.1 < X.max() <= high
    np.testing.assert_allclose(mu, data.simulator(X, np.tile([1.6, 0.7], (8000, 1))))
    number, counts = mu - add_one, y - add_one
    np.testing.assert_allclose(number, infected(X[:, 0], 1.6, 0.7))
    assert (counts == np.round(counts)).all()
    assert counts.min() >= 0
    error = (counts - number) / np.sqrt(number + number**2 / 5)
    # of 8000 standardised errors, whose kurtosis is about 5
    assert error.mean() == pytest.approx(0, abs=0.04)
    assert np.mean(error**2) == pytest.approx(1, abs=0.1)


def test_sir_simulation_assumes_a_slow_recovery():
    data = make_sir(random_state=0)
    assert data.simulator.assumed["recovery_rate"].value == 0.55
    assert data.simulation.parameter_ranges["recovery_rate"] == pytest.approx((0.3, 0.9))
    np.testing.assert_allclose(
        data.simulator([3.0, 9.0], [2.0, 1.2]), infected([3, 9], [2.0, 1.2], 0.55) + 1
    )


def test_sir_has_the_published_runs_beside_those_for_a_diagnosis():
    data = make_sir(n_runs=64, random_state=0)
    runs, simulator = data.simulation_fixed, data.simulator_fixed
    assert runs.n_runs == 64
    assert list(runs.parameter_ranges) == ["contact_rate"]
    assert runs.assumed == simulator.assumed == {}
    assert runs.input_ranges == data.simulation.input_ranges
    expected = infected(runs.X[:, 0], runs.omega[:, 0], 0.55) + 1
    np.testing.assert_allclose(runs.y, expected)
    # the simulator says the same as the other at its assumed value
    np.testing.assert_allclose(simulator([3.0], [2.0]), data.simulator([3.0], [2.0]))
    np.testing.assert_allclose(simulator(runs.X, runs.omega), runs.y)


def test_sir_rounds_the_published_runs_up_or_down_at_random():
    data = make_sir(n_runs=1024, round_counts=True, random_state=0)
    runs = data.simulation_fixed
    exact = infected(runs.X[:, 0], runs.omega[:, 0], 0.55) + 1
    assert (runs.y == np.round(runs.y)).all()
    error = runs.y - exact
    assert np.abs(error).max() < 1
    # up with the probability of the fraction: unbiased, and not always to the nearest
    assert np.abs(error).max() > 0.6
    assert error.mean() == pytest.approx(0, abs=4 * 0.5 / np.sqrt(1024))


def test_sir_rounds_what_the_simulation_says():
    data = make_sir(add_one=False, round_counts=True, random_state=0)
    exact = make_sir(add_one=False, random_state=0)
    np.testing.assert_array_equal(data.simulation.y, np.round(exact.simulation.y))
    np.testing.assert_array_equal(data.y, exact.y)
    # runs and counts are such as a likelihood of counts takes
    hs.NegativeBinomial().check(data.simulation.y)
    hs.NegativeBinomial().check(data.y)


def test_sir_repeats_with_its_seed():
    one, two, other = (make_sir(random_state=seed) for seed in (5, 5, 6))
    np.testing.assert_array_equal(one.y, two.y)
    np.testing.assert_array_equal(one.simulation.y, two.simulation.y)
    assert not np.array_equal(one.y, other.y)


@pytest.mark.parametrize(
    ("load", "n_rows", "start", "low_sd", "high_sd"),
    [
        (load_mauna_loa_co2, 521, (280, 35, 0.02), 2.178, 2.222),
        (load_nile, 100, (1000,), 167.3, 170.7),
        # more than NIST's certified residual with the cause, less than the data's own
        (load_nist_chwirut1, 214, (100, 0.5), 3.3616673688, 23),
        (load_nist_enso, 168, (10, 1, 1), 2.2269642403, 3.3),
    ],
)
def test_simulation_follows_all_but_the_hidden_cause(load, n_rows, start, low_sd, high_sd):
    data = load()
    assert data.data.shape == (n_rows, 1)
    (name,) = data.simulator.input_names
    assert list(data.data.columns) == [name]
    assert list(data.frame.columns) == [name, data.target.name]
    assert data.target.name == data.simulator.output
    low, high = data.simulator.input_ranges[name]
    assert data.data[name].between(low, high).all()
    assert "public domain" in data.DESCR
    best, _ = curve_fit(data.simulator.function, data.data[name], data.target, start)
    for value, prior in zip(best, data.simulator.parameters.values(), strict=True):
        assert 0.01 < prior.cdf(value) < 0.99
    residual = data.target - data.simulator(data.data, best * np.ones((n_rows, 1)))
    assert low_sd < residual.std() < high_sd


def test_chwirut1_has_the_certified_fit():
    data = load_nist_chwirut1()

    def response(x, b1, b2, b3):
        return np.exp(-b1 * x) / (b2 + b3 * x)

    x, y = data.data["distance"].to_numpy(), data.target.to_numpy()
    best, _ = curve_fit(response, x, y, (0.15, 0.008, 0.010))
    certified = [0.19027818370, 0.0061314004477, 0.010530908399]
    np.testing.assert_allclose(best, certified, rtol=1e-4)
    assert np.sum((y - response(x, *certified)) ** 2) == pytest.approx(2384.4771393, rel=1e-9)


def test_enso_has_the_certified_fit():
    data = load_nist_enso()
    month, y = data.data["month"].to_numpy(), data.target.to_numpy()
    np.testing.assert_array_equal(month, np.arange(1, 169))
    # linear once the two periods have their certified values
    angles = 2 * np.pi * month[:, None] / np.array([12, 44.311088700, 26.887614440])
    columns = np.column_stack([np.ones(168), np.cos(angles), np.sin(angles)])
    best, squares, *_ = np.linalg.lstsq(columns, y, rcond=None)
    # mean, three cosines, three sines
    certified = [10.510749193, 3.0762128085, -1.6231428586, 0.21232288488]
    certified += [0.53280138227, 0.52554493756, 1.4966870418]
    np.testing.assert_allclose(best, certified, rtol=1e-5)
    assert squares[0] == pytest.approx(788.53978668, rel=1e-9)


@pytest.mark.parametrize("name", [n for n in datasets.__all__ if not n.startswith("fetch")])
def test_descriptions_name_source_licence_and_units(name):
    described = getattr(datasets, name)().DESCR
    for word in ("Source: ", "Licence: ", "Units: "):
        assert described.count(word) == 1, word


def test_packaged_tables_name_their_source():
    folder = Path(datasets.__file__).parent / "data"
    for path in folder.glob("*.csv"):
        head = path.read_text(encoding="utf-8").splitlines()[:3]
        assert [line.split(":")[0] for line in head[1:]] == ["# source", "# licence"]
        assert "public domain" in head[2]


@pytest.mark.parametrize(
    "make",
    [
        make_log_sin,
        make_sir,
        load_mauna_loa_co2,
        load_nile,
        load_nist_chwirut1,
        load_nist_enso,
    ],
)
def test_simulators_can_be_pickled(make):
    simulator = make().simulator
    assert repr(pickle.loads(pickle.dumps(simulator))) == repr(simulator)
    assert simulator.run(16, random_state=0).n_runs == 16
