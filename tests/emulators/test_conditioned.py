"""The simulation as its runs tell it, in closed forms and on runs that it has not seen."""

import numpy as np
import pytest
from hidden_effects.simulations import SIMULATIONS
from scipy import stats
from scipy.optimize import check_grad
from sklearn.gaussian_process.kernels import Matern

import hybridsurrogate as hs
from hybridsurrogate.datasets import make_log_sin
from hybridsurrogate.emulators.conditioned import KrigedBasis, krige, through_runs
from hybridsurrogate.model.statistics import emulator_posterior, statistics
from hybridsurrogate.surrogates import Domain
from hybridsurrogate.surrogates.emulation.covariance import (
    Apart,
    Covariance,
    _badness,
    alike,
    bent,
    weighted,
)


def trained(simulator, n_runs, degree, prior=None, random_state=0):
    return through(simulator.run(n_runs, random_state=random_state), degree, prior)


def through(runs, degree, prior=None):
    """Return runs, the polynomial, what the runs say of its coefficients, and the kriged basis."""
    ranges = [np.array([*r.values()]) for r in (runs.input_ranges, runs.parameter_ranges)]
    domain = Domain(*ranges, float(runs.y.mean()), float(runs.y.std()))
    basis = hs.PolynomialChaos(degree, prior).build(domain)
    rows = statistics(
        basis.features(runs.X, runs.omega), runs.y - basis.known(runs.X, runs.omega), 1.0
    )
    emulator = emulator_posterior(basis, rows)
    return runs, basis, emulator, krige(basis, emulator, runs, runs.y)[0]


def wave(t, x, a):
    return np.sin(2 * t) + 0.1 * a * x


INPUTS, PARAMETERS = {"t": (0, 4), "x": (-1, 1)}, {"a": stats.uniform(10, 10)}


@pytest.fixture(scope="module")
def simulator():
    return hs.Simulator(wave, INPUTS, PARAMETERS)


def test_correlations_are_those_of_scikit_learn():
    rng = np.random.default_rng(0)
    a, b, lengths = rng.uniform(size=(5, 3)), rng.uniform(size=(4, 3)), np.array([0.3, 1.0, 5.0])
    ours = alike(Apart.of(a / lengths), Apart.of(b / lengths))
    np.testing.assert_allclose(ours, Matern(lengths, nu=2.5)(a, b), rtol=1e-7)


def test_weighed_correlations_and_their_slopes(monkeypatch):
    monkeypatch.setattr("hybridsurrogate.numerics.linear_algebra.blocks.__defaults__", (20,))
    rng = np.random.default_rng(0)
    a, others, weights = rng.normal(size=(9, 3)), Apart.of(rng.normal(size=(6, 3))), np.arange(6.0)
    value, slopes = weighted(Apart.of(a), others, np.column_stack([weights, weights[::-1]]))
    np.testing.assert_allclose(value[:, 1], alike(Apart.of(a), others) @ weights[::-1])
    value, slopes = value[:, 0], slopes[:, 0]
    np.testing.assert_allclose(value, alike(Apart.of(a), others) @ weights)
    for k, move in enumerate(1e-6 * np.eye(3)):
        ahead, behind = (alike(Apart.of(a + sign * move), others) @ weights for sign in (1, -1))
        np.testing.assert_allclose(slopes[:, k], (ahead - behind) / 2e-6, atol=1e-7)
    # where they meet a correlation is flat
    _, flat = weighted(Apart.of(a[:1]), Apart.of(a[:1]), np.ones((1, 1)))
    np.testing.assert_allclose(flat, 0, atol=1e-7)


def test_a_bend_is_a_logarithm_and_none_is_straight():
    x = np.linspace(0, 1, 5)[:, None]
    np.testing.assert_allclose(bent(x, np.zeros(1)), 2 * x - 1, atol=1e-6)
    # of the distance from a source, from 1 to 60 and from 60 to 1
    near_first = 2 * np.log(1 + 59 * x) / np.log(60) - 1
    np.testing.assert_allclose(bent(x, np.full(1, np.log(60))), near_first, atol=1e-12)
    near_last = 1 - 2 * np.log(60 - 59 * x) / np.log(60)
    np.testing.assert_allclose(bent(x, np.full(1, -np.log(60))), near_last, atol=1e-12)


@pytest.mark.parametrize("bends", [[0.5, -2.0], [2e-6, 1e-3]])
def test_slopes_of_the_likelihood(bends):
    rng = np.random.default_rng(0)
    given = (
        rng.uniform(size=(20, 2)),
        np.eye(20),
        rng.standard_normal((20, 2)),
        np.array([1.0, 0.3]),
    )
    z = np.array([0.3, -0.5, -3.0, 0.2, *bends])

    def value(at):
        return _badness(at, *given)[0]

    def slopes(at):
        return _badness(at, *given)[1]

    assert check_grad(value, slopes, z, epsilon=1e-6) < 2e-3 * np.linalg.norm(slopes(z))


def locally(misfits, coordinates):
    """Return how much larger errors are at runs in order: two runs' worth of belief in none."""
    squares, factors = misfits[np.argsort(coordinates)], []
    for k in range(len(squares)):
        weights = [np.exp(-abs(k - other) / 3) for other in range(len(squares))]
        factors.append(np.sqrt(max(1.0, (2 + weights @ squares) / (2 + sum(weights)))))
    return factors


@pytest.mark.parametrize(
    ("degree", "coefficients"), [(1, None), (5, None), (1, stats.norm(2, 1)), (5, stats.norm(2, 1))]
)
def test_output_and_error_are_those_of_dense_gaussians(simulator, degree, coefficients):
    # 40 runs, and 4 or 56 terms
    runs, basis, _, kriged = trained(simulator, 40, degree, coefficients)
    rng = np.random.default_rng(1)
    X, omega = rng.uniform([0, -1], [4, 1], (12, 2)), np.full((12, 1), 13.0)
    told = kriged.process.covariance
    points = np.vstack([np.hstack([runs.X, runs.omega]), np.hstack([X, omega])])
    unit = (points - [0, -1, 10]) / [4, 2, 10]
    prior = Matern(told.lengths, nu=2.5)(bent(unit, told.bends))
    features = np.vstack([basis.features(runs.X, runs.omega), basis.features(X, omega)])
    if told.share:
        terms = features * basis.coefficient_sd
        prior += told.share * terms @ terms.T / np.mean(np.sum(terms[:40] ** 2, axis=1))
    noisy = prior[:40, :40] + told.nugget * np.eye(40)
    gain = np.linalg.solve(noisy, prior[:40, 40:]).T
    known = np.append(basis.known(runs.X, runs.omega), basis.known(X, omega))
    known += features @ basis.coefficient_mean
    mean = known[40:] + gain @ (runs.y - known[:40])
    output = kriged.output(X, omega, np.empty(0))
    np.testing.assert_allclose(output, mean, atol=1e-4 * np.std(runs.y))
    rest, misfits = runs.y - known[:40], []
    for k in range(40):  # each run foreseen from the others, in units of its own sd
        others = np.arange(40) != k
        weight = np.linalg.solve(noisy[np.ix_(others, others)], noisy[others, k])
        spread = noisy[k, k] - weight @ noisy[others, k]
        misfits.append((rest[k] - weight @ rest[others]) ** 2 / spread)
    variance = max(np.mean(misfits), rest @ np.linalg.solve(noisy, rest) / 40)
    misfits = np.array(misfits) / variance
    assert kriged.sd**2 == pytest.approx(variance, rel=1e-3)
    # larger where the runs around were foreseen worse: along each axis by ranks of the runs
    axes = zip(bent(unit[40:], told.bends).T, bent(unit[:40], told.bends).T, strict=True)
    larger = np.max([np.interp(new, np.sort(old), locally(misfits, old)) for new, old in axes], 0)
    expected = np.outer(larger, larger) * variance * (prior[40:, 40:] - gain @ prior[:40, 40:])
    factor = kriged.error(X, omega)
    spread = np.max(np.diagonal(expected))
    np.testing.assert_allclose(factor @ factor.T, expected, atol=3e-4 * spread)


def test_pairs_are_rows(simulator):
    for degree in (1, 5):
        *_, kriged = trained(simulator, 60, degree)
        X, omega = np.array([[0.5, 0.2], [3.0, -0.8], [9.0, 0.0]]), np.array([[11.0], [19.0]])
        rows, points = np.tile(X, (2, 1)), np.repeat(omega, 3, axis=0)
        pairs = kriged.outer_output(X, omega, np.empty(0))
        close = {"rtol": 0, "atol": 1e-8}
        np.testing.assert_allclose(pairs.ravel(), kriged.known(rows, points), **close)
        known, features = kriged.outer(X, omega)
        np.testing.assert_allclose(known, pairs, **close)
        assert features.shape == (2, 3, 0)


@pytest.mark.parametrize("degree", [1, 5])
def test_short_moves_are_followed_along_slopes(simulator, degree):
    """Of inputs and parameters, at the end of what was simulated and beyond it too."""
    *_, kriged = trained(simulator, 60, degree)
    rng = np.random.default_rng(0)
    X = rng.uniform((-0.5, -1), (4.5, 1), size=(2, 1, 9, 2)) + 1e-5 * rng.normal(size=(2, 4, 9, 2))
    omega = rng.uniform(9, 21, size=(2, 1, 9, 1)) + 1e-4 * rng.normal(size=(2, 4, 9, 1))
    X[0, :, 0, 0], X[0, :, 1, 0] = [0, -1e-5, 0, 1e-5], [4, 4 + 1e-5, 4 - 1e-5, 4]
    X, omega = X.reshape(72, 2), omega.reshape(72, 1)
    close = kriged.output_close_by(X, omega, np.empty(0), (2, 4, 9)).reshape(2, 4, 9)
    moved = kriged.known(X, omega).reshape(2, 4, 9)
    np.testing.assert_allclose(close[:, 0], moved[:, 0], atol=1e-9)
    changes = moved - moved[:, :1]
    np.testing.assert_allclose(close - close[:, :1], changes, atol=1e-3 * np.abs(changes).max())


@pytest.mark.parametrize("name", sorted(SIMULATIONS))
def test_new_runs_are_met_within_the_error(name):
    # up to 252 terms: more than runs, so that the polynomial alone says anything between them
    simulator = SIMULATIONS[name]
    _, basis, emulator, kriged = trained(simulator, 150, 5)
    new = simulator.run(300, random_state=1)
    missed = kriged.output(new.X, new.omega, np.empty(0)) - new.y
    alone = basis.output(new.X, new.omega, emulator.mean) - new.y
    assert np.sqrt(np.mean(missed**2)) < 0.4 * np.sqrt(np.mean(alone**2))
    sd = np.sqrt(np.sum(kriged.error(new.X, new.omega) ** 2, axis=1))
    # an error told too small is blamed on the simulation, one too large hides effects
    apart = np.sqrt(np.mean((missed / sd) ** 2))
    assert apart < 2.0
    if name in ("cooling", "slow_growth"):
        # smoother than the process, which is surer there than it says
        assert np.sqrt(np.mean(sd**2)) < 0.45 * np.sqrt(np.mean(alone**2))
    else:
        assert apart > 0.4


def sound_level(distance, humidity, temperature, power, absorption):
    drier = (1 + 0.02 * (temperature - 20)) * (1 - 0.005 * (humidity - 50))
    return power - 11 - 20 * np.log10(distance) - absorption * distance * drier


@pytest.mark.slow
def test_a_steep_end_is_met_within_the_error():
    inputs = {"distance": (1, 60), "humidity": (20, 90), "temperature": (0, 35)}
    parameters = {"power": stats.norm(90, 3), "absorption": stats.norm(0.05, 0.015)}
    simulator = hs.Simulator(sound_level, inputs, parameters)
    # no run lies at the source itself, where one in 256 tells most
    X, omega = np.array([[1.0, 50, 20], [1.0, 30, 10]]), np.array([[91, 0.06], [88, 0.04]])
    truth = sound_level(*X.T, *omega.T)
    apart = []
    for seed in range(5):
        kriged = through(simulator.run(256, random_state=seed, ends=0), 4)[-1]
        sd = np.sqrt(np.sum(kriged.error(X, omega) ** 2, axis=1))
        assert np.all(sd < 0.5)
        apart.append((kriged.known(X, omega) - truth) / sd)
    assert np.sqrt(np.mean(np.square(apart))) < 2


@pytest.mark.parametrize("seed", [1, 7])
def test_what_swings_along_one_input_is_followed_from_few_runs(seed):
    """Its likelihood has two peaks, and at the lower one the mean is foreseen as well."""
    simulator = SIMULATIONS["pendulum"]
    kriged = trained(simulator, 100, 3, random_state=seed)[-1]
    new = simulator.run(400, random_state=99)
    missed = kriged.known(new.X, new.omega) - new.y
    assert np.sqrt(np.mean(missed**2)) < 0.75 * np.std(new.y)


def test_terms_that_spoil_a_steep_end_are_left_out():
    """The logarithm of case study 1, whose first run lies at 1.7 to 2.8; noise there is 0.2."""
    missed, told = [], []
    for seed in range(6):
        case = make_log_sin(random_state=seed)
        kriged = through(case.simulation, 5)[-1]
        at = np.array([[1.0]]), np.array([[0.9]])
        missed.append((kriged.known(*at) - case.simulator(*at)).item())
        told.append(np.linalg.norm(kriged.error(*at)))
    assert np.all(np.abs(missed) < 0.2)
    assert np.sqrt(np.mean(np.square(missed) / np.square(told))) < 2


def test_runs_that_the_terms_follow_are_left_to_them():
    simulator = hs.Simulator(
        lambda t, a: 3 + a * t**2, {"t": (0, 2)}, {"a": hs.truncated_normal(1, 0.5, 0, 2)}
    )
    _, basis, _, kriged = trained(simulator, 30, 3)
    assert kriged is basis
    # ten terms meet ten runs whatever the simulation is
    *_, kriged = trained(hs.Simulator(wave, INPUTS, PARAMETERS), 10, 2)
    assert isinstance(kriged, KrigedBasis)


def test_runs_that_scatter_are_smoothed(simulator):
    runs = simulator.run(100, random_state=0)
    noisy = runs.y + 0.2 * np.random.default_rng(0).standard_normal(100)
    domain = Domain(np.array([[0, 4], [-1, 1]]), np.array([[10, 20]]), noisy.mean(), noisy.std())
    basis = hs.PolynomialChaos(1).build(domain)
    emulator = emulator_posterior(basis, None)
    kriged, _ = krige(basis, emulator, runs, noisy)
    told: Covariance = kriged.process.covariance
    assert kriged.sd * np.sqrt(told.nugget) == pytest.approx(0.2, rel=0.3)
    missed = kriged.output(runs.X, runs.omega, np.empty(0)) - runs.y
    assert np.sqrt(np.mean(missed**2)) < 0.15


def test_the_error_of_many_rows_needs_few_columns(simulator):
    *_, kriged = trained(simulator, 60, 1)
    X = np.column_stack([np.linspace(0, 4, 3000), np.zeros(3000)])
    factor = kriged.error(X, np.full((3000, 1), 14.0))
    assert factor.shape[1] < 150
    # as for the same rows among a few
    few = kriged.error(X[::300], np.full((10, 1), 14.0))
    expected = few @ few.T
    told = factor[::300] @ factor[::300].T
    np.testing.assert_allclose(told, expected, atol=1e-3 * expected.max())


def test_runs_in_order_are_used_from_everywhere(simulator):
    runs = simulator.run(900, random_state=0)
    order = np.argsort(runs.X[:, 0])
    runs = hs.SimulationData(
        runs.X[order], runs.omega[order], runs.y[order], inputs=INPUTS, parameters=PARAMETERS
    )
    domain = Domain(np.array([[0, 4], [-1, 1]]), np.array([[10, 20]]), runs.y.mean(), runs.y.std())
    basis = hs.PolynomialChaos(2).build(domain)
    kriged, _ = krige(basis, emulator_posterior(basis, None), runs, runs.y)
    assert len(kriged.weights) == 900
    new = simulator.run(200, random_state=1)
    missed = kriged.output(new.X, new.omega, np.empty(0)) - new.y
    assert np.sqrt(np.mean(missed**2)) < 0.01 * np.std(new.y)


def test_the_error_of_many_runs_is_that_of_some_and_the_mean_that_of_all(simulator):
    runs, *_, whole = trained(simulator, 60, 1)
    some = through_runs(whole.process, runs.X, runs.omega, runs.y, most_open=30)
    new = simulator.run(100, random_state=1)
    (mean, sd), (all_mean, all_sd) = (one.predict(new.X, new.omega) for one in (some, whole))
    np.testing.assert_allclose(mean, all_mean, rtol=1e-6, atol=1e-6)
    assert np.median(sd / all_sd) > 1
