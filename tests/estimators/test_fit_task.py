"""Measured data checked once, and a problem built once, for fits with other effects."""

import numpy as np
import pandas as pd
import pytest
from few_kinds import all_but
from scipy.stats import uniform
from sklearn.base import clone

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.search.setup import prepare
from hybridsurrogate.effects.noise.outliers import GrossRow
from hybridsurrogate.estimators import power_scaled
from hybridsurrogate.estimators.checked_estimator import CheckedEstimator
from hybridsurrogate.estimators.power_scaled import FitTask, prepared

pytestmark = pytest.mark.filterwarnings("ignore::hybridsurrogate.SamplingWarning")
T = np.linspace(0, 10, 24)


def fall(t, start, rate):
    return start * np.exp(-rate * t)


SIMULATOR = hs.Simulator(
    fall, inputs={"t": (0, 10)}, parameters={"start": uniform(2, 6), "rate": uniform(0.05, 0.5)}
)


def both(t, start, rate):
    return {"left": fall(t, start, rate), "gone": start - fall(t, start, rate)}


TWO = hs.Simulator(both, SIMULATOR.input_ranges, SIMULATOR.parameters, output=["left", "gone"])
SETTINGS = {"n_draws": 100, "random_state": 0}


def case(name):
    """Return an estimator, a table, outputs and weights of rows."""
    y = fall(T, 5, 0.2) + 0.1 * np.random.default_rng(0).standard_normal(24)
    weights, runs = np.linspace(0, 2, 24), SIMULATOR.run(40, random_state=0)
    frame = pd.DataFrame({"batch": np.repeat(["a", "b"], 12), "t": T})
    if name == "two outputs":
        Y = np.column_stack([y, 5 - y])
        Y[[2, 7], [0, 1]] = np.nan
        model = hs.PowerScaledSurrogate(TWO, experiment="batch", **SETTINGS)
        return model, frame, Y, weights
    if name == "sources":
        sources = [hs.Source(runs, 0.5), hs.Source((T[:9, None] + 0.3, y[:9]), 0.7)]
        return hs.MultiSourceSurrogate(sources, **SETTINGS), T[:, None], y, weights
    return hs.PowerScaledSurrogate(runs, beta=0.7, **SETTINGS), frame[["t"]], y, weights


def effects(name):
    causes = [hs.Offset()] if name != "two outputs" else [hs.InOutput(hs.Offset(), "gone")]
    return [*causes, hs.Remainder(0.2)] if name == "runs" else causes


def assert_same(one, other):
    for name in ("values", "sigma", "coefficients", "effect_coefficients"):
        found, expected = (getattr(model.posterior_, name) for model in (one, other))
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("name", ["runs", "two outputs", "sources"])
def test_other_effects_on_the_same_rows_give_the_draws_of_a_fit(name):
    model, *measured = case(name)
    task = prepared(model, *measured)
    assert_same(task.fit(), clone(model).fit(*measured))
    causes = effects(name)
    expected = clone(model).set_params(effects=causes).fit(*measured)
    assert_same(task.with_effects(causes).fit(), expected)
    assert_same(FitTask.of_fitted(task.fit()).with_effects(causes).fit(), expected)
    # and back again
    assert_same(task.with_effects(causes).with_effects(()).fit(), task.fit())


@pytest.mark.parametrize("name", ["runs", "sources"])
def test_rows_that_an_effect_leaves_out_have_no_weight(name):
    model, X, y, _ = case(name)
    gross = hs.GrossError(rows=(GrossRow(6, (("t", float(T[5])),), float(y[5]), 0.0),))
    task = prepared(model, X, y)
    found = task.with_effects([gross])
    assert_same(found.fit(), clone(model).set_params(effects=[gross]).fit(X, y))
    assert np.flatnonzero(found.data.single.weights == 0).tolist() == [5]
    assert found.with_effects([]).data.single.weights.all()
    assert len(task.data.distinct.y) - len(found.data.distinct.y) == 1


@pytest.fixture
def counts(monkeypatch):
    """How often data were checked and a problem was built."""
    found = {"checks": 0, "problems": 0}

    def counted(name, function):
        def call(*args, **settings):
            found[name] += 1
            return function(*args, **settings)

        return call

    check = CheckedEstimator.checked_data
    monkeypatch.setattr(CheckedEstimator, "checked_data", counted("checks", check))
    build = power_scaled.plain_problem
    monkeypatch.setattr(power_scaled, "plain_problem", counted("problems", build))
    return found


@pytest.mark.filterwarnings("ignore::hybridsurrogate.HybridSurrogateWarning")
def test_a_diagnosis_checks_a_table_once_and_builds_its_problem_once(counts):
    rng = np.random.default_rng(1)
    y = fall(T, 5, 0.2) + 0.3 * (T > 5) + 0.1 * rng.standard_normal(24)
    model = hs.PowerScaledSurrogate(SIMULATOR, **SETTINGS)
    settings = {"exclude": all_but("step", "ramp", "trend"), "n_replicates": 20}
    diagnosis = hs.DiscrepancyDiagnosis(model, **settings, cv=None, random_state=0)
    diagnosis.fit(T[:, None], y)
    # several explanations are fitted
    assert len(diagnosis.extended_estimator_.estimators_) > 1
    assert counts == {"checks": 1, "problems": 1}
    diagnosis.set_params(cv=2).fit(T[:, None], y)
    folds = 2 + 3 - (diagnosis.gain_out_of_range_ is None) * 3
    assert counts == {"checks": 2 + folds, "problems": 2 + folds}


def test_a_path_over_beta_checks_once_and_builds_once(counts):
    model, *measured = case("runs")
    hs.beta_path(model, measured[0], measured[1], np.linspace(0, 1, 5), measured[2])
    assert counts == {"checks": 1, "problems": 1}


def test_a_search_has_the_runs_in_full_whatever_beta():
    model, X, y, _ = case("runs")
    found = [
        prepare(clone(model).set_params(beta=beta).fit(X, y), ()).problem.simulation
        for beta in (0.7, lambda X: np.full(len(X), 0.2))
    ]
    np.testing.assert_array_equal(found[0].ff, found[1].ff)
