"""The emulator of runs that are curves: exact at runs, right about its error between them."""

import numpy as np
import pytest
from scipy.stats import qmc, uniform

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.validation.beta_scan import has_weight
from hybridsurrogate.surrogates.emulation.covariance import (
    Covariance,
    Process,
    condensed,
    conditioned,
)
from hybridsurrogate.surrogates.emulation.curve_emulator import emulate_curves

T = np.linspace(0, 20, 60)


def oscillation(t, a, k, w):
    return a * np.exp(-k * t) * np.cos(w * t) + 0.3 * a


def growth(t, r, most, first):
    return most / (1 + (most / first - 1) * np.exp(-r * t))


def switch(t, steep, place, height):
    return height * np.tanh((t - place) * steep)


def saturation(t, a, b, start):
    return np.minimum(start + a * t / (1 + b * t), 2.0)


SIMULATIONS = {
    oscillation: [(1, 3), (0.05, 0.3), (0.5, 1.5)],
    growth: [(0.2, 1), (50, 150), (1, 10)],
    switch: [(0.3, 3), (5, 12), (1, 2)],
    saturation: [(0.1, 0.5), (0.1, 0.4), (0, 1)],
}


def drawn(ranges, n, seed):
    return qmc.scale(qmc.LatinHypercube(len(ranges), seed=seed).random(n), *np.transpose(ranges))


def each(t, points):
    """Return rows of all times for each run: inputs (n, 1), parameters (n, d)."""
    return np.tile(t, len(points))[:, None], np.repeat(points, len(t), axis=0)


def emulator(function, n_runs=60, seed=0):
    ranges = SIMULATIONS[function]
    X, omega = each(T, drawn(ranges, n_runs, seed))
    eta = function(X[:, 0], *omega.T)
    found = emulate_curves(X, omega, eta, np.array([[0.0, 20.0]]), np.array(ranges, float))
    return found, X, omega, eta


@pytest.mark.parametrize("ratio", [1.0, 3.0])
def test_few_of_many_runs_predict_as_all_of_them(ratio):
    """Also where the nuggets of runs differ by a ratio."""
    rng = np.random.default_rng(0)
    covariance = Covariance(np.full(2, 3.0), np.zeros(2), 1e-5, 0.0)
    process = Process(None, np.array([[0.0, 1.0]] * 2), covariance, np.empty(0))
    points, places = rng.random((600, 2)), rng.random((100, 2))
    runs, new = (process.places(np.empty((len(p), 0)), p) for p in (points, places))
    outputs = np.column_stack([np.sin(3 * points[:, 0]) * points[:, 1], np.exp(-points[:, 0])])
    shares = ratio ** (points[:, 0] - 0.5)
    every = conditioned(runs.alike(runs), 1e-5 * shares, outputs)
    few = condensed(runs.alike(runs), 1e-5, outputs, shares)
    assert len(few.weights) < 300
    (mean, sd), (of_few, sd_of_few) = (
        (alike @ given.weights, np.sqrt(1 - np.sum((alike @ given.whiten.T) ** 2, axis=1)))
        for given in (every, few)
        for alike in [new.alike(runs.of(given.centers))]
    )
    np.testing.assert_allclose(sd_of_few, sd, rtol=0.1)
    assert np.max(np.abs(of_few - mean) / (every.sd * sd[:, None])) < 0.1
    np.testing.assert_allclose(few.sd, every.sd, rtol=0.01)
    np.testing.assert_allclose(few.misses, every.misses, atol=0.1)


@pytest.mark.parametrize("function", SIMULATIONS)
def test_runs_are_met(function):
    found, X, omega, eta = emulator(function)
    missed = found.output(X, omega) - eta
    assert np.sqrt(np.mean(missed**2)) < 3e-3 * np.std(eta)


def test_runs_left_out_lie_in_the_intervals():
    """Over four simulations, two designs and 100 runs each: nine in ten are meant to."""
    inside, sizes = [], []
    for function, ranges in SIMULATIONS.items():
        for seed in range(2):
            found = emulator(function, seed=seed)[0]
            X, omega = each(np.linspace(0.3, 19.5, 30), drawn(ranges, 100, 100 + seed))
            missed = found.output(X, omega) - function(X[:, 0], *omega.T)
            sd = np.sqrt(np.sum(found.spread(X, omega) ** 2, axis=1))
            inside.append(np.mean(np.abs(missed) < 1.645 * sd))
            sizes.append(np.sqrt(np.mean(missed**2) / np.mean(sd**2)))
    # errors have heavier tails than the normal distribution, so that intervals hold more
    assert 0.85 < np.mean(inside) < 0.97
    assert min(inside) > 0.75
    assert 0.5 < np.median(sizes) < 1.5


def test_errors_of_equal_parameters_are_one_curve_and_of_others_are_not():
    found, *_ = emulator(oscillation)
    points = drawn(SIMULATIONS[oscillation], 3, 7)
    X, omega = each(np.linspace(1, 19, 9), points)
    whole = found.error(X, omega)
    square = whole @ whole.T
    for k in range(3):
        own = slice(9 * k, 9 * (k + 1))
        spread = found.spread(X[own], omega[own])
        np.testing.assert_allclose(
            square[own, own], spread @ spread.T, rtol=1e-3, atol=1e-6 * square.max()
        )
    near = omega.copy()
    near[:9] = near[9:18] * (1 + 1e-9)
    alike = found.error(X, near)
    np.testing.assert_allclose(alike[:9], alike[9:18], atol=1e-3 * np.abs(alike).max())


def test_rows_of_any_order_and_number():
    found, *_ = emulator(growth)
    X, omega = each(T[:7], drawn(SIMULATIONS[growth], 5, 3))
    order = np.random.default_rng(0).permutation(len(X))
    np.testing.assert_allclose(
        found.output(X[order], omega[order]), found.output(X, omega)[order], rtol=1e-9
    )
    assert found.output(X[:0], omega[:0]).shape == (0,)
    assert found.error(X[:1], omega[:1]).shape[0] == 1


def test_runs_that_are_in_the_emulator_compete_for_nothing():
    simulator = hs.Simulator(
        lambda t, rate: np.exp(-rate * t), {"t": (0, 10)}, {"rate": uniform(0.1, 0.4)}
    )
    t = np.linspace(0.5, 9.5, 20)
    y = np.exp(-0.3 * t) + 0.02 * np.random.default_rng(0).normal(size=20)
    model = hs.PowerScaledSurrogate(
        simulator.run(16, along=20, random_state=0),
        surrogate=hs.Kriging(),
        n_draws=200,
        random_state=0,
    )
    model.fit(t[:, None], y)
    assert not has_weight(model)
    # the same posterior as with the simulation itself, which the runs tell to a thousandth
    exact = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=200, random_state=0
    ).fit(t[:, None], y)
    ours, theirs = (one.posterior_.values[:, 0] for one in (model, exact))
    assert np.mean(ours) == pytest.approx(np.mean(theirs), abs=0.5 * np.std(theirs))
    assert np.std(ours) == pytest.approx(np.std(theirs), rel=0.3)
    assert np.mean(model.posterior_.sigma) == pytest.approx(0.02, rel=0.5)


def test_short_moves_follow_the_slopes():
    found, *_ = emulator(oscillation)
    rng = np.random.default_rng(0)
    nodes, moves, n = 2, 3, 10
    ranges = np.array(SIMULATIONS[oscillation])
    start = drawn(ranges, nodes * n, 5).reshape(nodes, 1, n, 3)
    steps = 1e-4 * np.ptp(ranges, axis=1) * rng.normal(size=(nodes, moves, n, 3))
    steps[:, 0] = 0
    omega = (start + steps).reshape(-1, 3)
    X = np.tile(np.linspace(1, 19, n), nodes * moves)[:, None]
    exact = found.output(X, omega)
    moved = np.ptp(exact.reshape(nodes, moves, n), axis=1)
    close = found.output_close_by(X, omega, (nodes, moves, n))
    np.testing.assert_allclose(close, exact, atol=0.01 * np.median(moved))


def test_output_and_spread_at_once_are_the_same():
    found, X, omega, _ = emulator(growth)
    output, spread = found.both(X[:50], omega[:50] * 1.01)
    np.testing.assert_allclose(output, found.output(X[:50], omega[:50] * 1.01), rtol=1e-9)
    np.testing.assert_allclose(spread, found.spread(X[:50], omega[:50] * 1.01), rtol=1e-6)
    each = found.outer_output(X[:50], omega[::60][:4])
    flat = [found.output(X[:50], np.tile(point, (50, 1))) for point in omega[::60][:4]]
    np.testing.assert_allclose(each, flat, rtol=1e-9)
