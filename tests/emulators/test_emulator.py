"""An emulator predicts runs that were not made, and says how well."""

import warnings

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from scipy.stats import uniform
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel, Matern

import hybridsurrogate as hs
from hybridsurrogate.emulators.conditioned import LeftOut
from hybridsurrogate.plotting import plot_emulator

RANGES = {"x": (0.0, 1.0), "z": (0.0, 1.0), "rate": (0.5, 3.0)}


def output(x, z, rate):
    return np.exp(-rate * x) * (1 + z**2) + 0.3 * np.sin(3 * z)


def points(n, seed):
    unit = stats.qmc.LatinHypercube(3, seed=seed).random(n)
    low, high = np.array(list(RANGES.values())).T
    return pd.DataFrame(low + (high - low) * unit, columns=list(RANGES))


def runs(n=60, seed=0, function=output, noise=0.0, repeats=1):
    table = pd.concat([points(n, seed)] * repeats, ignore_index=True)
    y = function(**{name: table[name].to_numpy() for name in RANGES})
    y = y + noise * np.random.default_rng(seed).standard_normal(y.shape)
    return hs.SimulationData(
        table[["x", "z"]],
        table[["rate"]],
        y,
        {"x": (0, 1), "z": (0, 1)},
        {"rate": uniform(0.5, 2.5)},
    )


@pytest.fixture(scope="module")
def kriged():
    return hs.Emulator().fit(runs())


NEW = points(400, 7)
TRUE = output(*NEW.to_numpy().T)


def test_it_predicts_runs_that_were_not_made(kriged):
    mean, sd = kriged.predict(NEW, return_std=True)
    assert kriged.kind_ == "kriging"
    assert np.std(mean - TRUE) < 0.02 * np.std(TRUE)
    assert np.mean(np.abs(mean - TRUE) < 1.645 * sd) > 0.8
    np.testing.assert_allclose(kriged.predict(NEW.to_numpy()), mean)
    # columns go by name
    np.testing.assert_allclose(kriged.predict(NEW[["rate", "z", "x"]]), mean)


def test_it_is_as_good_as_a_gaussian_process_of_scikit_learn(kriged):
    every = runs()
    kernel = ConstantKernel(1.0, (1e-3, 1e6)) * Matern(np.ones(3), (0.01, 1000.0), nu=2.5)
    theirs = GaussianProcessRegressor(kernel, normalize_y=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        theirs.fit(np.hstack([every.X, every.omega]), every.y)
    errors = [np.std(one.predict(NEW.to_numpy()) - TRUE) for one in (kriged, theirs)]
    assert errors[0] < 1.1 * errors[1]


@pytest.mark.parametrize("kind", ["kriging", "polynomial"])
def test_runs_left_out_are_predicted_as_by_an_emulator_without_them(kind):
    """In closed form, with the covariance that all runs gave."""
    every = runs(30)
    whole = hs.Emulator(kind).fit(every)
    one = whole._emulators[0]
    few = [0, 11, 23]
    for row in few:
        at = int(np.flatnonzero(one.left_out.rows == row)[0])
        kept = np.delete(np.arange(30), row)
        mean = _without(one, every, kept, row)
        assert one.left_out.mean[at] == pytest.approx(mean, rel=1e-4, abs=1e-4)


def _without(one, every, kept, row):
    """Return what the other runs predict for one, computed anew."""
    X, omega, y = every.X, every.omega, every.y
    if one.kind == "polynomial":
        basis = one.basis.basis
        features, sd = basis.features(X, omega), one.basis.basis.coefficient_sd
        noise = np.mean((y - basis.known(X, omega) - features @ one.basis.mean) ** 2)
        target = y - basis.known(X, omega)
        precision = features[kept].T @ features[kept] / noise + np.diag(sd**-2.0)
        c = np.linalg.solve(precision, features[kept].T @ target[kept] / noise)
        return float(basis.known(X, omega)[row] + features[row] @ c)
    process = one.basis.process
    places = process.places(X, omega)
    matrix = places.alike(places) + process.covariance.nugget * np.eye(len(y))
    residual = y - process.prior_mean(X, omega)
    weights = np.linalg.solve(matrix[np.ix_(kept, kept)], residual[kept])
    return float(process.prior_mean(X, omega)[row] + matrix[row, kept] @ weights)


def test_curves_are_known_from_few_runs():
    simulator = hs.Simulator(
        lambda t, rate, level: level * np.exp(-rate * t),
        {"t": (0, 5)},
        {"rate": uniform(0.2, 1), "level": uniform(1, 2)},
    )
    emulator = hs.Emulator().fit(simulator.run(40, along=30, random_state=0))
    assert emulator.kind_ == "curves"
    assert emulator.q2_ > 0.999
    assert emulator.pit_.shape == (1200,)
    new = pd.DataFrame({"t": [0.3, 2.2], "rate": [0.5, 0.9], "level": [1.4, 2.5]})
    mean, sd = emulator.predict(new, return_std=True)
    true = new["level"] * np.exp(-new["rate"] * new["t"])
    assert np.all(np.abs(mean - true) < 0.02)
    assert np.all(sd < 0.05)


def test_a_stochastic_simulation_has_a_noise_of_its_own():
    emulator = hs.Emulator().fit(runs(60, noise=0.1, repeats=4))
    assert emulator.noise_ == pytest.approx(0.1, rel=0.2)
    mean, sd = emulator.predict(NEW, return_std=True)
    # the mean is known better than a single run
    assert np.sqrt(np.mean((mean - TRUE) ** 2)) < 0.06
    assert np.mean(np.abs(mean - TRUE) < 1.645 * sd) > 0.75
    assert np.median(sd) < 0.1
    assert stats.kstest(emulator.pit_, "uniform").pvalue > 1e-3


def test_several_outputs_are_emulated_each():
    table = points(50, 1)
    y = output(*table.to_numpy().T)
    outputs = np.column_stack([y, np.where(np.arange(50) < 10, np.nan, y**2)])
    several = hs.SimulationData(
        table[["x", "z"]],
        table[["rate"]],
        outputs,
        {"x": (0, 1), "z": (0, 1)},
        {"rate": uniform(0.5, 2.5)},
        output=["level", "power"],
    )
    emulator = hs.Emulator().fit(several)
    assert emulator.q2_.shape == (2,)
    assert np.all(emulator.q2_ > 0.99)
    assert np.isnan(emulator.pit_[:10, 1]).all()
    mean, sd = emulator.predict(NEW, return_std=True)
    assert mean.shape == sd.shape == (400, 2)
    assert plot_emulator(emulator).shape == (2, 2)


def test_it_is_saved_cloned_and_drawn(kriged, tmp_path):
    hs.save(kriged, tmp_path / "emulator.hs")
    again = hs.load(tmp_path / "emulator.hs")
    np.testing.assert_allclose(again.predict(NEW), kriged.predict(NEW))
    assert clone(kriged).get_params() == {"kind": "auto"}
    axes = plot_emulator(kriged)
    assert "Q²" in axes[0, 0].get_title()


def test_it_tells_right_from_wrong_standard_deviations():
    normal = np.random.default_rng(0).standard_normal(2000)
    rows, nothing = np.arange(2000), np.zeros(2000)
    right = LeftOut(rows, normal, nothing, np.ones(2000))
    assert right.coverage() == pytest.approx(0.9, abs=0.03)
    assert right.q2 == pytest.approx(0.0, abs=0.01)
    assert LeftOut(rows, normal, nothing, np.full(2000, 0.5)).coverage() < 0.7


def test_mistakes_are_told(kriged):
    with pytest.raises(TypeError, match="fitted to SimulationData"):
        hs.Emulator().fit(np.ones((3, 2)))
    with pytest.raises(ValueError, match="kind"):
        hs.Emulator("spline").fit(runs())
    with pytest.raises(ValueError, match="needs runs that are curves"):
        hs.Emulator("curves").fit(runs())
    with pytest.raises(ValueError, match="rate"):
        kriged.predict(NEW[["x", "z"]])
    with pytest.raises(ValueError, match="NaN"):
        kriged.predict([[0.5, np.nan, 1.0]])
    with pytest.warns(hs.ExtrapolationWarning, match="beyond the runs in rate"):
        kriged.predict([[0.5, 0.5, 4.0]])
