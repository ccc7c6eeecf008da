"""Runs that are fields, outputs over two axes: few components over both."""

import pickle

import numpy as np
import pandas as pd
import pytest
from few_kinds import all_but
from scipy.stats import qmc, uniform

import hybridsurrogate as hs
from hybridsurrogate.surrogates.emulation.curve_emulator import emulate_curves
from hybridsurrogate.surrogates.emulation.curves import curves_of
from hybridsurrogate.surrogates.emulation.fields import field_of

PRIORS = {"speed": uniform(0.2, 0.8), "loss": uniform(0.3, 1.2)}
ENDS = np.array([[0.0, 10.0], [0.0, 10.0], [0.2, 1.0], [0.3, 1.5]])


def waves(t, z, speed, loss):
    return np.cos(2 * speed * t - z) * np.exp(-loss * z) + 0.02 * speed * t * z


def plume(t, z, speed, loss):
    return np.exp(-((z - speed * t) ** 2) / (4 * loss * (t + 1))) / np.sqrt(loss * (t + 1))


def drawn(n, seed, ends=ENDS):
    unit = qmc.LatinHypercube(len(ends), seed=seed).random(n)
    return ends[:, 0] + unit * np.ptp(ends, axis=1)


def runs(function=waves, n=60, shape=(20, 20), seed=0):
    omega = drawn(n, seed, ENDS[2:])
    grid = np.meshgrid(*(np.linspace(0, 10, k) for k in shape), indexing="ij")
    X = np.tile(np.stack(grid, axis=-1).reshape(-1, 2), (n, 1))
    run = np.repeat(np.arange(n), np.prod(shape))
    y = function(*X.T, *omega[run].T)
    return hs.SimulationData(X, omega[run], y, {"t": (0, 10), "z": (0, 10)}, PRIORS, run=run)


@pytest.mark.parametrize("function", [waves, plume])
def test_a_field_is_known_better_than_its_lines(function):
    every = runs(function)
    points = drawn(2000, 1)
    true = function(*points.T)
    emulator = hs.Emulator().fit(every)
    mean, sd = emulator.predict(points, return_std=True)
    field = np.sqrt(np.mean((mean - true) ** 2))
    assert field < 0.03 * np.std(true)
    assert 0.85 < np.mean(np.abs(mean - true) < 1.645 * sd) < 0.99
    assert emulator.q2_ > 0.999
    assert emulator.coverage_ > 0.85
    # as it was before: curves along time, with the depth as a further input
    X, omega, y = every.X, every.omega, every.y
    shuffled = np.random.default_rng(0).permutation(len(y))[1:]  # one row is missing
    assert field_of(X[shuffled], omega[shuffled], y[shuffled]) is None
    lines = emulate_curves(X[shuffled], omega[shuffled], y[shuffled], ENDS[:2], ENDS[2:])
    error = lines.output(points[:, :2], points[:, 2:]) - true
    assert field < 0.8 * np.sqrt(np.mean(error**2))


def test_a_field_is_met_where_it_was_simulated_and_between_with_an_error():
    every = runs(shape=(12, 15))
    found = field_of(every.X, every.omega, every.y)
    values = found.interpolated(found.outputs.T)(found.places)
    np.testing.assert_allclose(values, found.outputs.T, atol=1e-9)
    assert not found.between.sd(found.places).any()
    between = drawn(300, 3, ENDS[:2])
    exact = np.array([waves(*between.T, *own) for own in found.others]).T
    missed = found.interpolated(found.outputs.T)(between) - exact
    sd = found.between.sd(between)
    assert 0.3 < np.sqrt(np.mean(missed**2)) / np.sqrt(np.mean(sd**2)) < 1.5
    correlation = found.between.correlations(between, between)
    np.testing.assert_allclose(np.diag(correlation), 1)
    assert np.min(np.linalg.eigvalsh(correlation)) > -1e-6


def test_rows_in_any_order_are_the_same_field():
    every = runs(n=20)
    order = np.random.default_rng(0).permutation(every.n_rows)
    one = field_of(every.X, every.omega, every.y)
    other = field_of(every.X[order], every.omega[order], every.y[order])
    np.testing.assert_array_equal(one.outputs, other.outputs)


@pytest.mark.parametrize("shape", [(30, 3), (3, 30)])
def test_a_few_sensors_are_no_axis(shape):
    every = runs(shape=shape)
    assert field_of(every.X, every.omega, every.y) is None
    assert curves_of(every.X, every.omega, every.y) is not None


def test_further_fields_join_the_runs():
    every, more = runs(n=20), runs(n=4, seed=1)
    assert every.with_rows(more.to_frame()).n_runs == 24
    with pytest.raises(ValueError, match="different results of 'y'"):
        every.with_rows(every.to_frame().assign(y=0.0))


def test_repeated_fields_have_a_noise():
    every, random = runs(n=20).to_frame(), np.random.default_rng(0)
    shape = np.sin(every["t"] / 3)
    repeats = [
        every.assign(
            run=every["run"] + 100 * k,
            y=every["y"] + 0.1 * random.standard_normal(20)[every["run"]] * shape,
        )
        for k in range(4)
    ]
    emulator = hs.Emulator().fit(
        hs.SimulationData.from_frame(pd.concat(repeats), ["t", "z"], PRIORS)
    )
    assert emulator.noise_ == pytest.approx(0.1 * np.sqrt(np.mean(shape**2)), rel=0.2)
    where = pd.DataFrame({"t": [0.0, 4.7], "z": [3.0, 3.0], "speed": 0.5, "loss": 0.7})
    (_, sd), (_, of_one) = (
        emulator.predict(where, return_std=True, with_noise=flag) for flag in (False, True)
    )
    np.testing.assert_allclose(np.sqrt(of_one**2 - sd**2), [0, 0.1], rtol=0.2, atol=0.01)
    # it is saved with its interpolation
    again = pickle.loads(pickle.dumps(emulator))
    np.testing.assert_allclose(again.predict(where), emulator.predict(where))


# ten runs, on purpose
@pytest.mark.filterwarnings("ignore:At the measured rows the runs:hybridsurrogate.DiagnosisWarning")
@pytest.mark.filterwarnings("ignore:The budget of 2:hybridsurrogate.DiagnosisWarning")
def test_a_diagnosis_of_fields_is_refined():
    random = np.random.default_rng(0)
    X = random.uniform(0.5, 9.5, (60, 2))
    y = waves(*X.T, 0.6, 0.5) + 0.02 * random.standard_normal(60)
    simulator = hs.Simulator(waves, {"t": (0, 10), "z": (0, 10)}, PRIORS)
    model = hs.PowerScaledSurrogate(runs(n=12), surrogate=hs.Kriging(), n_draws=200, random_state=0)
    settings = {"exclude": all_but("step"), "cv": None, "n_replicates": 19}
    diagnosis = hs.DiscrepancyDiagnosis(model, **settings, random_state=0)
    found = hs.refine(diagnosis, X, y, simulator, budget=2, batch=2, open_below=1e-6)
    assert found.refinement_["n_runs"].tolist() == [12, 14]
    assert found.refinement_["left_open"].iloc[1] < found.refinement_["left_open"].iloc[0]


def test_a_diagnosis_of_fields():
    random = np.random.default_rng(0)
    X = random.uniform(0.5, 9.5, (80, 2))
    y = waves(*X.T, 0.6, 0.5) + 0.02 * random.standard_normal(80) + 0.15 * (X[:, 0] > 5)
    model = hs.PowerScaledSurrogate(runs(), surrogate=hs.Kriging(), n_draws=200, random_state=0)
    settings = {"exclude": all_but("step", "trend"), "cv": None, "n_replicates": 19}
    diagnosis = hs.DiscrepancyDiagnosis(model, **settings, random_state=0)
    diagnosis.fit(pd.DataFrame(X, columns=["t", "z"]), y)
    assert diagnosis.best_cause_.kind == "step"
    assert diagnosis.best_cause_.target == "t"
    check = diagnosis.emulator_check_
    assert check.left_open < 1
    assert check.along == "t and z"
    assert list(diagnosis.next_runs(2)) == ["speed", "loss"]
