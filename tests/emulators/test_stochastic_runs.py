"""Runs of a stochastic simulation, repeated at equal parameters: the mean, and the scatter."""

import numpy as np
import pandas as pd
import pytest
from few_kinds import all_but
from scipy import stats
from scipy.stats import qmc, uniform

import hybridsurrogate as hs
from hybridsurrogate.surrogates.emulation.curves import curves_of

PRIORS = {"rate": uniform(0.2, 0.8), "level": uniform(1, 2)}
RANGES = np.array([[0.0, 10.0], [0.2, 1.0], [1.0, 3.0]])
T = np.linspace(0, 10, 40)
SD = 0.1


def mean(t, rate, level):
    return level * np.exp(-rate * t) + 0.3 * np.sin(rate * t)


def path(t, n, random, length=1.5):
    """Draw paths (n, n_places) that wander with a standard deviation of `SD`."""
    covariance = SD**2 * np.exp(-np.abs(t[:, None] - t) / length) + 1e-12 * np.eye(len(t))
    return random.standard_normal((n, len(t))) @ np.linalg.cholesky(covariance).T


def points(n, seed, ranges=RANGES):
    unit = qmc.LatinHypercube(len(ranges), seed=seed).random(n)
    return ranges[:, 0] + unit * np.ptp(ranges, axis=1)


def data(X, omega, y, **changes):
    return hs.SimulationData(X, omega, y, {"t": (0, 10)}, PRIORS, **changes)


def curves(seed=0, n=40, repeats=4, draw=path):
    omega = np.repeat(points(n, seed, RANGES[1:]), repeats, axis=0)
    y = mean(T, omega[:, :1], omega[:, 1:]) + draw(T, len(omega), np.random.default_rng(seed))
    run = np.repeat(np.arange(len(omega)), len(T))
    return data(np.tile(T, len(omega))[:, None], omega[run], y.ravel(), run=run)


def white(t, n, random):
    return SD * random.standard_normal((n, len(t)))


def rows(seed=0, n=40, repeats=4):
    every = np.repeat(points(n, seed), repeats, axis=0)
    y = mean(*every.T) + SD * np.random.default_rng(seed).standard_normal(len(every))
    return data(every[:, :1], every[:, 1:], y)


NEW = pd.DataFrame(points(300, 99), columns=["t", "rate", "level"])
TRUE = mean(*NEW.to_numpy().T)


@pytest.mark.parametrize("draw", [path, white])
def test_repeated_curves_have_a_mean_and_a_scatter(draw):
    emulator = hs.Emulator().fit(curves(draw=draw))
    assert emulator.kind_ == "curves"
    assert emulator.noise_ == pytest.approx(SD, rel=0.1)
    found, sd = emulator.predict(NEW, return_std=True)
    # four runs of each mean are half as far from it as one
    assert np.sqrt(np.mean((found - TRUE) ** 2)) < 0.4 * SD
    assert 0.8 < np.mean(np.abs(found - TRUE) < 1.645 * sd) < 0.97
    _, of_one_run = emulator.predict(NEW, return_std=True, with_noise=True)
    np.testing.assert_allclose(of_one_run, np.hypot(sd, SD), rtol=0.3)
    # runs that are left out are single runs
    assert 0.86 < emulator.coverage_ < 0.94
    assert stats.kstest(emulator.pit_[::40], "uniform").pvalue > 1e-3


@pytest.mark.parametrize("kind", ["kriging", "polynomial"])
def test_the_scatter_is_no_error_of_the_mean(kind):
    covered = []
    for seed in range(4):
        emulator = hs.Emulator(kind).fit(rows(seed))
        found, sd = emulator.predict(NEW, return_std=True)
        covered.append(np.abs(found - TRUE) < 1.645 * sd)
    assert 0.82 < np.mean(covered) < 0.96
    _, of_one_run = emulator.predict(NEW, return_std=True, with_noise=True)
    np.testing.assert_allclose(of_one_run, np.hypot(sd, emulator.noise_))


def test_kriging_learns_the_scatter_of_runs_that_are_not_repeated():
    assert hs.Emulator("kriging").fit(rows(n=160, repeats=1)).noise_ == pytest.approx(SD, rel=0.3)


def test_a_run_is_left_out_with_its_repeats():
    every = rows(n=25)
    one = hs.Emulator("kriging").fit(every)._emulators[0]
    process = one.basis.process
    places = process.places(every.X, every.omega)
    matrix = places.alike(places) + process.covariance.nugget * np.eye(every.n_rows)
    residual = every.y - process.prior_mean(every.X, every.omega)
    group = np.arange(every.n_rows) // 4
    at = np.argsort(one.left_out.rows)
    for k in (0, 13):
        own, others = np.flatnonzero(group == k), np.flatnonzero(group != k)
        gain = np.linalg.solve(matrix[np.ix_(others, others)], matrix[np.ix_(others, own)])
        expected = (every.y - residual)[own] + gain.T @ residual[others]
        np.testing.assert_allclose(one.left_out.mean[at[own]], expected, rtol=1e-4, atol=1e-4)
        variance = np.diag(matrix[np.ix_(own, own)] - matrix[np.ix_(own, others)] @ gain)
        local = one.basis.local.at(places.points[own])
        sd = one.basis.sd * local * np.sqrt(variance)
        np.testing.assert_allclose(one.left_out.sd[at[own]], sd, rtol=1e-3)


def uneven(seed, ratio=10.0, n=80, repeats=3):
    """Rows whose scatter grows by a factor over the rate."""
    every = np.repeat(points(n, seed), repeats, axis=0)
    sd = SD * ratio ** ((every[:, 1] - 0.6) / 0.8)
    y = mean(*every.T) + sd * np.random.default_rng(seed).standard_normal(len(every))
    return data(every[:, :1], every[:, 1:], y)


@pytest.mark.parametrize("kind", ["kriging", "polynomial"])
def test_a_scatter_that_changes_is_learned_where_repeats_show_it(kind):
    """One number for all covers 100 % of single runs where they scatter least, 70 % where most."""
    true = SD * 10 ** ((NEW["rate"].to_numpy() - 0.6) / 0.8)
    low, high = true < np.quantile(true, 0.25), true > np.quantile(true, 0.75)
    ratios, covered = [], []
    for seed in range(4):
        emulator = hs.Emulator(kind).fit(uneven(seed))
        found, sd = emulator.predict(NEW, return_std=True)
        _, of_one_run = emulator.predict(NEW, return_std=True, with_noise=True)
        ratios.append(np.sqrt(of_one_run**2 - sd**2) / true)
        runs = TRUE + true * np.random.default_rng(seed + 50).standard_normal(len(NEW))
        covered.append(np.abs(runs - found) < 1.645 * of_one_run)
    assert np.median(np.abs(np.log(ratios))) < 0.2
    # four emulators of 75 rows each: a standard error of 0.02, more as rows share their emulator
    for where in (low, high):
        share = np.mean(np.array(covered)[:, where])
        assert share > 0.78
        # what a polynomial misses is the same everywhere, and more than the least scatter
        assert kind == "polynomial" or share < 0.98


def test_curves_may_scatter_more_at_some_parameters():
    """One size covered 68 % of single runs where they scatter most, and all where least."""

    def growing(t, n, random):
        return path(t, n, random) * np.repeat(10 ** ((rate - 0.6) / 0.8), 4)[:, None]

    size = 10 ** ((NEW["rate"].to_numpy() - 0.6) / 0.8)
    low, high = size < np.quantile(size, 0.25), size > np.quantile(size, 0.75)
    of_means, of_runs = [], []
    for seed in range(4):
        rate = points(60, seed, RANGES[1:])[:, 0]
        emulator = hs.Emulator().fit(curves(seed, n=60, draw=growing))
        found, sd = emulator.predict(NEW, return_std=True)
        _, of_one_run = emulator.predict(NEW, return_std=True, with_noise=True)
        np.testing.assert_allclose(np.sqrt(of_one_run**2 - sd**2), SD * size, rtol=0.4)
        runs = TRUE + SD * size * np.random.default_rng(seed + 50).standard_normal(len(NEW))
        of_means.append(np.abs(TRUE - found) < 1.645 * sd)
        of_runs.append(np.abs(runs - found) < 1.645 * of_one_run)
        assert 0.86 < emulator.coverage_ < 0.94
    # four emulators of 75 rows each: a standard error of 0.02, more as rows share their emulator
    for where in (low, high):
        assert 0.78 < np.mean(np.array(of_means)[:, where]) < 0.97
        assert 0.82 < np.mean(np.array(of_runs)[:, where]) < 0.97


def test_a_scatter_that_is_equal_everywhere_stays_so():
    for seed in range(4):
        emulator = hs.Emulator("kriging").fit(rows(seed))
        both = (emulator.predict(NEW, True, with_noise=one)[1] for one in (True, False))
        noise = np.sqrt(np.subtract(*(sd**2 for sd in both)))
        np.testing.assert_allclose(noise, emulator.noise_, rtol=1e-6)


def test_repeats_that_agree_in_places_are_no_error():
    """Where the simulation is deterministic repeats are equal, and their variance has no log."""
    every = uneven(0)
    still = every.omega[:, 0] < 0.5
    y = np.where(still, mean(*every.X.T, *every.omega.T), every.y)
    emulator = hs.Emulator("kriging").fit(data(every.X, every.omega, y))
    _, sd = emulator.predict(NEW, return_std=True)
    _, of_one_run = emulator.predict(NEW, return_std=True, with_noise=True)
    noise, rate = np.sqrt(of_one_run**2 - sd**2), NEW["rate"]
    assert np.median(noise[rate < 0.4]) < 0.1 * np.median(noise[rate > 0.6])


def test_repeats_of_single_rows_are_no_curves():
    every = rows(repeats=7)
    assert curves_of(every.X, every.omega, every.y) is None
    assert hs.Emulator().fit(every).kind_ == "kriging"


def test_runs_that_scatter_take_further_ones():
    every = curves()
    more = every.with_rows(curves(seed=1, n=8, repeats=2).to_frame())
    assert more.n_runs == 176


@pytest.mark.slow
@pytest.mark.parametrize(("step", "verdicts"), [(0.0, {"adequate"}), (0.8, {"named", "nearest"})])
def test_a_measured_system_is_one_run(step, verdicts):
    """Its path is no discrepancy: without the scatter four of four sets had a cause."""
    random = np.random.default_rng(3)
    t = np.sort(random.uniform(0.2, 9.8, 50))
    y = mean(t, 0.5, 2.0) + path(t, 1, random)[0] + 0.03 * random.standard_normal(50)
    model = hs.PowerScaledSurrogate(curves(), surrogate=hs.Kriging(), random_state=0)
    diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, random_state=0)
    diagnosis.fit(t[:, None], y + step * (t > 5))
    assert diagnosis.verdict_ in verdicts
    assert diagnosis.best_cause_.kind == ("step" if step else "none")
    check = diagnosis.emulator_check_
    assert check.left_open < 1 < check.scatter


def test_a_path_without_repeated_runs_is_no_discrepancy_but_open():
    """A cycle was named with 80 % of the evidence, and a bump in the next set."""
    few = all_but("step", "trend", "periodic", "bump", "offset")

    def run(t, rate, level):
        raise AssertionError("further runs close nothing of it")

    simulator = hs.Simulator(run, {"t": (0, 10)}, PRIORS, returns="curve")
    for seed in (3, 4):
        random = np.random.default_rng(seed)
        t = np.sort(random.uniform(0.2, 9.8, 50))
        y = mean(t, 0.5, 2.0) + path(t, 1, random)[0] + 0.03 * random.standard_normal(50)
        model = hs.PowerScaledSurrogate(
            curves(n=160, repeats=1), surrogate=hs.Kriging(), random_state=0
        )
        diagnosis = hs.DiscrepancyDiagnosis(
            model, exclude=few, cv=None, n_replicates=50, random_state=0
        )
        with pytest.warns(hs.DiagnosisWarning) as caught:
            diagnosis = hs.refine(diagnosis, t[:, None], y, simulator, budget=20)
        said = " ".join(str(each.message) for each in caught)
        assert "0 of 20 further runs were made, and more would not help" in said
        assert "run some points twice or more" in said
        assert diagnosis.best_cause_.kind == "none"
        assert diagnosis.verdict_ == "undecided"
        check = diagnosis.emulator_check_
        assert check.needs_repeats
        # in units of the noise: the path's size
        assert 0.4 * SD < check.unrepeated * 0.03 < 2 * SD
        assert "run some points twice" in str(diagnosis.report())
        assert "next_runs" not in str(diagnosis.report())


def test_jumps_between_runs_are_part_of_the_error():
    """Intervals covered 76 %: what a run differs by from its neighbours counted as noise."""

    def jumps(t, rate, level):
        return np.exp(-rate * t) * (1 + 0.1 * np.floor(6 * level))

    covered = []
    for seed in range(4):
        omega = points(80, seed, RANGES[1:])
        every = hs.SimulationData.from_curves(
            omega, jumps(T, omega[:, :1], omega[:, 1:]), along={"t": T}, parameters=PRIORS
        )
        emulator = hs.Emulator().fit(every)
        found, sd = emulator.predict(NEW, return_std=True)
        covered.append(np.abs(found - jumps(*NEW.to_numpy().T)) < 1.645 * sd)
    assert 0.86 < np.mean(covered) < 0.98


def test_rows_of_one_run_have_one_realisation():
    """Whatever their parameters are; those of another batch have another one."""
    random = np.random.default_rng(0)
    omega = np.repeat(points(30, 0, RANGES[1:]), 4, axis=0)
    batch = np.repeat(random.uniform(0, 1, 30), 4)
    y = mean(T, omega[:, :1], omega[:, 1:]) + path(T, len(omega), random)
    run = np.repeat(np.arange(len(omega)), len(T))
    X = np.column_stack([np.tile(T, len(omega)), batch[run]])
    every = hs.SimulationData(
        X, omega[run], y.ravel(), {"t": (0, 10), "batch": (0, 1)}, PRIORS, run=run
    )
    basis = hs.Emulator().fit(every)._emulators[0].basis
    t, other = np.array([2.0, 2.5, 2.0, 2.5]), np.array([0.2, 0.2, 0.9, 0.9])
    drifting = np.column_stack([[0.5, 0.51, 0.5, 0.51], np.full(4, 2.0)])
    X = np.column_stack([t, other])
    error = basis.error(X, drifting)
    of_path = basis.emulator.realisation(X)
    covariance = error @ error.T
    within = of_path[0] @ of_path[1]
    assert 0.6 * SD**2 < within < 1.2 * SD**2
    assert covariance[0, 1] > 0.9 * within
    assert abs(covariance[0, 3]) < 0.5 * within


@pytest.mark.parametrize("n", [12, 60])
def test_a_curve_is_left_out_with_its_repeats(n):
    """Of many runs, that few of them give, as of few that are all used."""
    emulator = hs.Emulator().fit(curves(n=n))._emulators[0].basis.emulator
    left, coefficients = emulator.left_out, emulator.components.coefficients
    others = np.unique(curves(n=n).omega, axis=0)
    places = emulator.process.places(np.empty((n, 0)), others)
    nugget = emulator.process.covariance.nugget
    matrix = places.alike(places) + nugget * np.eye(n)
    np.testing.assert_allclose(left.noise, nugget)
    for k in (0, 7):
        run = left.runs[k]
        rest = np.delete(np.arange(n), run)
        gain = np.linalg.solve(matrix[np.ix_(rest, rest)], matrix[rest, run])
        expected = gain @ coefficients[rest]
        size = np.std(coefficients, axis=0)
        np.testing.assert_allclose(left.coefficients[k] / size, expected / size, atol=0.03)
        local = emulator.local.at(places.points[[run]])[0]
        variance = local**2 * (matrix[run, run] - gain @ matrix[rest, run])
        assert left.variance[k] == pytest.approx(variance, rel=0.05)
