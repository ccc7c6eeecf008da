"""The error of interpolation along curves: none where they were simulated, a bridge between."""

import numpy as np
import pytest
from scipy.stats import qmc

from hybridsurrogate.surrogates.emulation.between_places import between_places, degree_of
from hybridsurrogate.surrogates.emulation.curve_emulator import emulate_curves

DAYS, STEPS = 120, 12
FINE = np.arange(DAYS * STEPS + 1) / STEPS
LOW, HIGH = np.array([0.03, 0.1, 20.0]), np.array([0.2, 0.6, 120.0])


def reservoir(rain, points):
    """Return outflow (n_runs, n_steps) for rain (n_steps,): s += rain (1 - loss), q = k s."""
    k, loss, storage = points.T
    out = []
    for amount in rain:
        storage = storage + amount * (1 - loss)
        flow = k / STEPS * storage
        storage = storage - flow
        out.append(STEPS * flow)
    return np.stack(out, axis=-1)


def showers(points, rng):
    return reservoir(rng.gamma(0.05, 30, len(FINE)) / STEPS, points)


def by_day(points, rng):
    rain = np.zeros(len(FINE))
    rain[::STEPS] = rng.gamma(0.12, 14, DAYS + 1)
    return reservoir(rain, points)


def storms(points, rng):
    rain = np.zeros(len(FINE))
    rain[rng.choice(len(FINE), 20, replace=False)] = rng.exponential(15, 20)
    return reservoir(rain, points)


def paths(points, rng):
    first, second = np.cumsum(rng.normal(size=(2, len(FINE))), axis=1) / np.sqrt(STEPS)
    return 10 * points[:, :1] * first + points[:, 1:2] * second + points[:, 2:] / 50


def emulated(driven, seed, n_runs=60, n_new=100, gaps=0):
    """Return daily runs as an emulator, and parameters and finer curves that it has not seen."""
    rng = np.random.default_rng(seed)
    designs = [qmc.LatinHypercube(3, seed=rng).random(n) for n in (n_runs, n_new)]
    points = qmc.scale(np.concatenate(designs), LOW, HIGH)
    curves = driven(points, rng)
    days = FINE[::STEPS]
    X, omega = np.tile(days, n_runs)[:, None], np.repeat(points[:n_runs], len(days), axis=0)
    ranges = np.array([[0.0, DAYS]]), np.column_stack([LOW, HIGH])
    there = np.ones((n_runs, len(days)), dtype=bool)
    there[:gaps, rng.integers(80, 120, 10)] = False  # missing days
    there[gaps : 2 * gaps, 80:] = False  # and runs that stopped
    rows = there.ravel()
    eta = curves[:n_runs, ::STEPS].ravel()
    found = emulate_curves(X[rows], omega[rows], eta[rows], *ranges)
    return found, points[n_runs:], curves[n_runs:]


def missed_and_stated(found, points, curves, steps):
    """Return errors and their stated standard deviations at some of the fine steps."""
    at = FINE[steps]
    X, omega = np.tile(at, len(points))[:, None], np.repeat(points, len(at), axis=0)
    output, spread = found.both(X, omega)
    return output - curves[:, steps].ravel(), np.sqrt(np.sum(spread**2, axis=1))


def rms(values):
    return float(np.sqrt(np.mean(values**2)))


ON = slice(None, None, STEPS)
LAST = slice(80 * STEPS, None, STEPS)
OFF = np.flatnonzero(np.arange(len(FINE)) % STEPS)


@pytest.mark.parametrize("driven", [showers, by_day])
def test_places_that_were_simulated_cost_nothing(driven):
    ratios = []
    for seed in range(6):
        found, points, curves = emulated(driven, seed)
        missed, stated = missed_and_stated(found, points, curves, ON)
        ratios.append(rms(stated) / rms(missed))
        # and are not exact for want of care: between them the curve is open
        assert rms(missed_and_stated(found, points, curves, OFF)[1]) > 5 * rms(stated)
    assert 1 / 1.5 < np.exp(np.mean(np.log(ratios))) < 1.5
    assert max(ratios) < 2.5


def test_runs_with_gaps_are_no_reason_to_interpolate():
    """Days that some runs lack were simulated by the others, and all runs share their rain."""
    found, points, curves = emulated(by_day, 0, gaps=5)
    missed, stated = missed_and_stated(found, points, curves, LAST)
    assert rms(missed) / 2 < rms(stated) < 2 * rms(missed)
    complete = missed_and_stated(*emulated(by_day, 0), LAST)[0]
    assert rms(missed) < 2 * rms(complete)
    assert found.between(FINE[ON][:, None]).max() == 0


@pytest.mark.parametrize("driven", [showers, storms, paths])
def test_between_places_the_stated_error_is_the_true_one(driven):
    """68 % within one standard deviation is meant, more where showers are rare."""
    ratios, inside = [], []
    for seed in range(6):
        missed, stated = missed_and_stated(*emulated(driven, seed), OFF)
        ratios.append(rms(stated) / rms(missed))
        inside.append(np.mean(np.abs(missed) < stated))
    assert 2 / 3 < np.exp(np.mean(np.log(ratios))) < 1.5
    assert 0.5 < np.mean(inside) < 0.97


def test_of_random_paths_it_is_a_brownian_bridge():
    rng = np.random.default_rng(0)
    paths = np.cumsum(rng.normal(size=(2000, 61)), axis=1)
    places = np.arange(61.0)
    found = between_places(places, np.zeros(61), [(places, paths)], 1)
    assert degree_of([(places, paths)]) == 1
    assert found.power == pytest.approx(0.5, abs=0.02)
    assert found.correlation == pytest.approx(0, abs=0.02)
    # of variance u (1 - u) for a unit step
    u = np.array([0.0, 0.1, 0.25, 0.5, 0.9])
    np.testing.assert_allclose(found.sd(30 + u), np.sqrt(u * (1 - u)), rtol=0.06)
    # and correlations sqrt(u (1 - v) / v / (1 - u))
    within = found.correlations(np.array([30.25]), np.array([30.25, 30.75, 31.25]))[0]
    np.testing.assert_allclose(within, [1, 1 / 3, 0], atol=0.03)


def test_it_grows_with_the_distance():
    rng = np.random.default_rng(1)
    fine = np.cumsum(rng.normal(size=(2000, 201)), axis=1)
    places = np.concatenate([np.arange(0, 100, 2), np.arange(100, 201, 10)])
    found = between_places(1.0 * places, np.zeros(61), [(1.0 * places, fine[:, places])], 1)
    # the variance in the middle of a bridge is a quarter of its length
    middle = found.sd(np.array([41.0, 155.0]))
    np.testing.assert_allclose(middle, np.sqrt([2 / 4, 10 / 4]), rtol=0.15)


def test_of_smooth_curves_it_is_as_small_as_cubics_make_it():
    rates = np.random.default_rng(0).uniform(0.5, 1, 200)
    places, between = np.linspace(0, 20, 81), np.linspace(2, 18, 640)
    curves = np.cos(rates[:, None] * places)
    found = between_places(places, np.zeros(81), [(places, curves)], degree_of([(places, curves)]))
    assert found.power == pytest.approx(4, abs=0.5)
    assert found.correlation > 0.5
    # of a cubic spline e = f'''' h^4 / 384 in the middle of a pair
    exact = np.sqrt(np.mean((rates**4) ** 2 / 2)) * 0.25**4 / 384
    assert found.sd(places[10:70] + 0.125).mean() == pytest.approx(exact, rel=0.3)
    assert found.sd(places).max() == 0
    assert rms(found.sd(between)) < exact


def test_where_runs_have_places_of_their_own_none_is_exact():
    rng = np.random.default_rng(2)
    fine = np.cumsum(rng.normal(size=(40, 1201)), axis=1) / np.sqrt(20)
    own = [np.sort(rng.choice(1201, 61, replace=False)) for _ in range(40)]
    pieces = [(each / 20, run[each][None]) for each, run in zip(own, fine, strict=True)]
    grid = np.linspace(0, 60, 121)
    found = between_places(grid, np.ones(121), pieces, degree_of(pieces))
    # lines between random places, of mean distance 1: the mean of the bridges' variance
    true = [
        np.mean((np.interp(np.arange(1201), each, run[each]) - run) ** 2)
        for each, run in zip(own, fine, strict=True)
    ]
    assert rms(found.sd(grid)) == pytest.approx(np.sqrt(np.mean(true)), rel=0.5)


def test_a_jump_stays_where_it_is():
    places = np.arange(40.0)
    sizes = np.random.default_rng(0).uniform(1, 2, 50)
    curves = sizes[:, None] * (places > 20.5) + 1e-3 * np.sin(places)
    found = between_places(places, np.zeros(40), [(places, curves)], 1)
    # anywhere between 20 and 21: half of its size is open in the middle
    assert found.sd(np.array([20.5]))[0] == pytest.approx(rms(sizes) / 2, rel=0.15)
    assert found.sd(np.array([10.5, 30.5])).max() < 0.01
    np.testing.assert_array_equal(found.sd(np.array([20.0, 21.0])), 0)


def test_beyond_the_ends_it_is_as_large_as_between():
    rng = np.random.default_rng(0)
    places = np.arange(31.0)
    found = between_places(
        places, np.zeros(31), [(places, np.cumsum(rng.normal(size=(50, 31)), axis=1))], 1
    )
    np.testing.assert_allclose(found.sd(np.array([-3.0, 40.0])), found.middle[[0, -1]])


def test_curves_that_are_straight_or_few_are_known():
    places = np.arange(12.0)
    straight = np.outer(np.arange(1.0, 11.0), places)
    found = between_places(places, np.zeros(12), [(places, straight)], 1)
    assert found.sd(places[:-1] + 0.5).max() < 1e-12
    few = between_places(places[:2], np.zeros(2), [(places[:2], straight[:, :2])], 1)
    np.testing.assert_array_equal(few.sd(np.array([0.5])), 0)


def test_errors_of_rows_between_places_are_alike_in_one_pair_only():
    found, points, _ = emulated(storms, 0)
    at = np.concatenate([FINE[ON][5:9], [5.25, 5.5, 60.5, 5.5]])
    omega = np.repeat(points[:1], 8, axis=0)
    F = found.error(at[:, None], omega)
    covariance = F @ F.T
    spread = found.spread(at[:, None], omega)
    np.testing.assert_allclose(np.diagonal(covariance), np.sum(spread**2, axis=1), rtol=1e-3)
    size = np.sqrt(np.diagonal(covariance))
    alike = covariance / size / size[:, None]
    assert alike[5, 7] == pytest.approx(1)
    assert 0.3 < alike[4, 5] < 1
    # another experiment, whose run has other parameters, has an error of its own
    both = np.repeat(points[:2], 8, axis=0)
    both[8:] = np.where(np.abs(points[0] - LOW) > np.abs(points[0] - HIGH), LOW, HIGH)
    F = found.error(np.tile(at, 2)[:, None], both)
    covariance = F @ F.T
    assert covariance[5, 13] < 0.9 * np.sqrt(covariance[5, 5] * covariance[13, 13])
    assert np.linalg.eigvalsh(covariance).min() > -1e-9 * covariance.max()
    # rows at simulated places have nothing of it
    assert found.between(FINE[ON][:, None]).max() == 0
