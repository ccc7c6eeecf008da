"""Gains within and beyond the measured range, and how far trust in the simulation rises."""

import threading

import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm
from sklearn.base import clone

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.search import context as fits
from hybridsurrogate.diagnosis.search.forward_selection import searches
from hybridsurrogate.diagnosis.validation.cross_validation import (
    folds_beyond,
    future_folds,
    random_folds,
)
from hybridsurrogate.diagnosis.validation.gain import FoldGain, Held, gain_over, pointwise
from hybridsurrogate.diagnosis.validation.refit import Pair, Refit
from hybridsurrogate.estimators.beta_path import fitted_near
from hybridsurrogate.estimators.power_scaled import prepared


def line(t, level, slope):
    return level + slope * t


@pytest.fixture(scope="module")
def simulator():
    return hs.Simulator(line, {"t": (0, 14)}, {"level": norm(0, 3), "slope": norm(1, 0.5)})


def test_the_future_is_foreseen_from_the_past_alone():
    x = np.random.default_rng(0).permutation(50.0 * np.arange(40))
    folds = future_folds(x)
    assert [len(test) for _, test in folds] == [5, 6, 5]
    for train, test in folds:
        assert x[train].max() < x[test].min()
    assert sorted(np.concatenate([test for _, test in folds])) == sorted(np.argsort(x)[24:])


def test_rows_of_equal_time_stay_together():
    x = np.repeat(np.arange(10.0), 4)
    folds = future_folds(x)
    assert folds
    for train, test in folds:
        assert not set(x[train]) & set(x[test])


def test_too_few_rows_have_no_future():
    assert future_folds(np.arange(11.0)) == []
    assert future_folds(np.zeros(40)) == []
    # the first cut would leave nine rows to learn from, the second twelve
    assert [len(train) for train, _ in future_folds(np.arange(16.0))] == [12, 14]


def test_order_along_the_only_input_or_in_time(simulator):
    X = np.column_stack([np.arange(30.0), np.zeros(30)])
    assert len(folds_beyond(simulator, X)) == 3
    two = hs.Simulator(lambda t, depth: t + depth, {"t": (0, 1), "depth": (0, 1)})
    # by which of two the rows are ordered shows where they come sorted
    assert [len(test) for _, test in folds_beyond(two, X)] == [4, 4, 4]
    assert np.all(folds_beyond(two, X[:, ::-1])[-1][1] == np.arange(26, 30))
    assert folds_beyond(two, X[np.random.default_rng(0).permutation(30)]) == []
    grid = np.column_stack([np.repeat(np.arange(5.0), 6), np.tile(np.arange(6.0), 5)])
    assert folds_beyond(two, grid) == []
    ode = hs.OdeSimulator(
        lambda t, state, rate, depth: -rate * depth * state,
        initial_state=[1.0],
        observe=lambda state: state[0],
        inputs={"t": (0, 4), "depth": (1, 2)},
        parameters={"rate": norm(1, 0.1)},
        states="n",
    )
    assert len(folds_beyond(ode, X)) == 3


def test_a_fold_is_fitted_from_the_proposals_of_the_whole(simulator):
    t = np.linspace(0, 14, 60)
    y = line(t, 1.0, 0.8) + 2 * (t > 7) + 0.5 * np.random.default_rng(0).standard_normal(60)
    model = hs.PowerScaledSurrogate(
        simulator,
        surrogate=hs.ExactSurrogate(),
        effects=[hs.Step("t")],
        n_draws=4000,
        random_state=0,
    )
    whole = clone(model).fit(t[:, None], y)
    rows = np.flatnonzero(np.arange(60) % 5 != 2)
    near = fitted_near(prepared(model, t[rows, None], y[rows]), whole)
    anew = clone(model).fit(t[rows, None], y[rows])
    n = min(one.diagnostics_.effective_draws for one in (near, anew))
    # four errors of the difference of two means; of the sds likewise
    limit = 4 * np.sqrt(2 / n)
    distance = {"near": [], "whole": []}
    for name in ("values", "sigma", "effect_coefficients"):
        expected = getattr(anew.posterior_, name)
        sd = expected.std(axis=0)
        for word, one in (("near", near), ("whole", whole)):
            found = getattr(one.posterior_, name)
            off = np.abs(found.mean(axis=0) - expected.mean(axis=0)) / sd
            distance[word].append(np.max(off))
        np.testing.assert_allclose(
            getattr(near.posterior_, name).std(axis=0), sd, rtol=6 / np.sqrt(n)
        )
    # to keep the draws of all rows would be noticed
    assert max(distance["near"]) < limit < max(distance["whole"])
    # what is true of other data serves nobody
    assert fitted_near(prepared(model, t[rows, None], 5 - 3 * y[rows]), whole) is None


@pytest.mark.parametrize("cause", [hs.Step("t"), hs.Ramp("t"), hs.Bump("t")])
def test_proposals_that_a_fold_excludes_serve_nobody(simulator, cause):
    # it begins later than all rows of the fold, whose prior of its place ends with them
    t = np.linspace(0, 14, 60)
    y = line(t, 1.0, 0.8) + 0.1 * np.random.default_rng(0).standard_normal(60)
    y += 4 * np.exp(-5 * (t - 12) ** 2) if cause.kind == "bump" else 4 * np.maximum(t - 12, 0)
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), effects=[cause], n_draws=300, random_state=0
    )
    whole = clone(model).fit(t[:, None], y)
    assert fitted_near(prepared(model, t[:30, None], y[:30]), whole) is None


def test_a_fold_is_fitted_from_the_whole_where_priors_follow_the_rows(simulator):
    # the prior of the period follows the rows, and the period is known to a fraction of it
    t = np.linspace(0, 14, 60)
    y = line(t, 1.0, 0.8) + 2 * np.sin(2 * np.pi * t / 2.9)
    y += 0.02 * np.random.default_rng(0).standard_normal(60)
    model = hs.PowerScaledSurrogate(
        simulator,
        surrogate=hs.ExactSurrogate(),
        effects=[hs.Periodic("t")],
        n_draws=1000,
        random_state=0,
    )
    whole, rows = clone(model).fit(t[:, None], y), np.arange(50)
    priors = [
        one.posterior_.model.priors[-1].support()
        for one in (whole, clone(model).fit(t[rows, None], y[rows]))
    ]
    assert priors[0] != priors[1]
    near = fitted_near(prepared(model, t[rows, None], y[rows]), whole)
    anew = clone(model).fit(t[rows, None], y[rows])
    n = min(one.diagnostics_.effective_draws for one in (near, anew))
    expected = anew.posterior_.values
    sd = expected.std(axis=0)
    # four errors of the difference of two means
    off = np.abs(near.posterior_.values.mean(axis=0) - expected.mean(axis=0)) / sd
    assert np.max(off) < 4 * np.sqrt(2 / n)
    np.testing.assert_allclose(near.posterior_.values.std(axis=0), sd, rtol=6 / np.sqrt(n))


@pytest.mark.slow
def test_a_second_search_in_a_fold_starts_where_that_on_all_rows_ended(simulator, monkeypatch):
    rng = np.random.default_rng(0)
    t = np.sort(rng.uniform(0, 14, 80))
    y = line(t, 1.0, 0.8) + 3 * (t > 7) + np.sin(2 * np.pi * t / 1.3)
    y += 0.2 * rng.standard_normal(80)
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=100, random_state=0
    )
    diagnosis = hs.DiscrepancyDiagnosis(
        model, max_causes=2, cv=None, n_replicates=20, random_state=0
    ).fit(t[:, None], y)
    kept, climbs = np.arange(80) % 5 != 2, []

    def counted(*args, **settings):
        climbs[-1] += 1
        return optimise(*args, **settings)

    optimise = fits.optimise
    monkeypatch.setattr(fits, "optimise", counted)
    pair = Pair(diagnosis.estimator_, diagnosis.extended_estimator_, "periodic + step")
    found = searches(diagnosis.result_.steps)
    assert len(found) >= 2
    told = []
    for known in (found[:1], found):
        climbs.append(0)
        refitted = Refit(model, diagnosis.result_.settings, known, pair)
        told.append(refitted(t[kept, None], y[kept]))
    alone, helped = told
    assert alone.kind == helped.kind == "periodic + step"
    assert climbs[1] < 0.6 * climbs[0]
    # the same two causes with what these rows say of them, but for four errors of the difference
    names = [[cause.name for cause in one.after.effects] for one in told]
    assert names[0] == names[1]
    before, after = (one.after.posterior_.values.mean(axis=0) for one in told)
    sd = alone.after.posterior_.values.std(axis=0)
    assert np.all(np.abs(after - before) < 4 * np.sqrt(2 / 100) * sd)


class Told:
    """A fitted model that always predicts a standard normal around one value."""

    def __init__(self, mean):
        self.mean = mean

    def predict(self, X):
        return np.full(len(X), self.mean)

    def interval_holds(self, X, y, levels, y_err=None):
        return [(abs(y - self.mean) <= norm.ppf(0.5 + level / 2)).astype(float) for level in levels]

    def log_predictive_density(self, X, y, y_err=None):
        return norm.logpdf(y, self.mean)

    def side_of(self, y):
        return np.zeros(len(y))


@pytest.mark.parametrize("likelihood", ["normal", "lognormal", "student-t"])
def test_rows_are_inside_where_the_interval_holds_them(likelihood):
    rng = np.random.default_rng(0)
    t = rng.uniform(0, 10, 40)
    y = (5 + t) * np.exp(0.3 * rng.standard_normal(40))
    simulator = hs.Simulator(
        lambda t, start: start + t, {"t": (0, 10)}, {"start": hs.truncated_normal(5, 1, 1, 9)}
    )
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), likelihood=likelihood, n_draws=200, random_state=0
    ).fit(t[:, None], y)
    levels = (0.2, 0.5, 0.9)
    for level, inside in zip(levels, model.interval_holds(t[:, None], y, levels), strict=True):
        lower, upper = model.predict_interval(t[:, None], level)
        assert inside.tolist() == ((lower <= y) & (y <= upper)).tolist()


def test_scores_of_known_models():
    y = np.array([0.0, 0.5, 1.0, 3.0])
    scores = pointwise(Told(0.0), y[:, None], y)
    # a standard normal has 50 % within 0.674 and 90 % within 1.645
    assert scores.inside_half.tolist() == [1, 1, 0, 0]
    assert scores.inside.tolist() == [1, 1, 1, 0]
    tests = [np.array([0, 1]), np.array([2, 3])]
    models = Told(0.0), Told(1.0)
    gain = gain_over(
        [
            Held(*(pointwise(model, y[rows, None], y[rows]) for model in models), kind)
            for rows, kind in zip(tests, ("offset", "trend"), strict=True)
        ]
    )
    # log densities differ by -0.5 ((y - 1)^2 - y^2) = y - 0.5
    assert gain.elpd_difference == pytest.approx(np.mean(y - 0.5))
    assert gain.standard_error == pytest.approx(np.std(y, ddof=1) / 2)
    assert gain.rmse_before == pytest.approx(np.sqrt(np.mean(y**2)))
    assert (gain.coverage_before, gain.coverage_after) == (0.75, 0.75)
    assert (gain.half_before, gain.half_after) == (0.5, 0.5)
    assert gain.kinds == ("offset", "trend")
    expected = FoldGain("offset", 2, 0, 0, 0.25)
    assert gain.folds[0].n_rows == expected.n_rows
    assert gain.folds[0].standard_error == pytest.approx(expected.standard_error)


def test_a_wave_pays_off_beyond_the_measured_rows_too(simulator):
    rng = np.random.default_rng(1)
    t = np.sort(rng.uniform(0, 14, 40))
    y = line(t, 1.0, 1.2) + 2 * np.sin(2 * np.pi * t / 2.9) + 0.4 * rng.standard_normal(40)
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=200, random_state=0
    )
    diagnosis = hs.DiscrepancyDiagnosis(model, cv=2, n_replicates=20, random_state=0)
    diagnosis.fit(t[:, None], y)
    within, beyond = diagnosis.gain_, diagnosis.gain_out_of_range_
    assert (within.n_rows, beyond.n_rows) == (40, 16)
    assert (len(within.folds), len(beyond.folds)) == (2, 3)
    assert beyond.kinds == ("periodic",) * 3
    assert beyond.elpd_difference > 2 * beyond.standard_error
    assert beyond.rmse_after < 0.5 * beyond.rmse_before


@pytest.mark.slow
def test_folds_in_processes_of_their_own_tell_the_same():
    # a function that only this process knows and counts, rows by name, a cause beside the catalogue
    runs = []

    def line_of(t, level):
        runs.append(len(t))
        return level + t

    simulator = hs.Simulator(line_of, {"t": (0, 14)}, {"level": norm(0, 3)})
    rng = np.random.default_rng(3)
    X = pd.DataFrame({"t": np.sort(rng.uniform(0, 14, 24))})
    y = simulator(X, np.full((24, 1), 1.0)) + 2.0 * (X["t"] > 7) + 0.3 * rng.standard_normal(24)
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=100, random_state=0
    )
    told, calls = [], []
    for n in (None, 2):
        runs.clear()
        diagnosis = hs.DiscrepancyDiagnosis(
            model, causes=[hs.Ramp("t")], cv=2, n_replicates=20, n_jobs=n, random_state=0
        )
        told.append(diagnosis.fit(X, y))
        calls.append(len(runs))
    for which in ("gain_", "gain_out_of_range_"):
        one, other = (getattr(diagnosis, which) for diagnosis in told)
        assert one.kinds == other.kinds
        # a process of its own may have other threads and kernels
        for number in ("elpd_before", "elpd_after", "standard_error", "rmse_after"):
            assert getattr(one, number) == pytest.approx(getattr(other, number), rel=1e-9)
    # the folds ran elsewhere
    assert calls[1] < 0.7 * calls[0]


@pytest.mark.slow
def test_a_simulation_that_stays_in_its_process_is_diagnosed_there():
    lock = threading.Lock()

    def guarded(t, level):
        with lock:
            return level + t

    simulator = hs.Simulator(guarded, {"t": (0, 14)}, {"level": norm(0, 3)})
    t = np.linspace(0, 14, 24)
    y = t + 2.0 * (t > 7) + 0.3 * np.random.default_rng(0).standard_normal(24)
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=100, random_state=0
    )
    diagnosis = hs.DiscrepancyDiagnosis(model, cv=2, n_replicates=20, n_jobs=2, random_state=0)
    with pytest.warns(hs.DiagnosisWarning, match="The folds ran in this process"):
        diagnosis.fit(t[:, None], y)
    assert diagnosis.gain_.n_rows == 24


@pytest.mark.parametrize(
    ("setting", "match"),
    [
        ({"cv": 1}, "cv == 1, must be >= 2"),
        ({"cv": "5"}, "cv must be an instance of int"),
        ({"n_jobs": 0}, "n_jobs must be a number of processes"),
        ({"n_jobs": "all"}, "n_jobs must be a number of processes"),
    ],
)
def test_folds_are_checked_before_the_search(simulator, setting, match):
    model = hs.PowerScaledSurrogate(simulator, surrogate=hs.ExactSurrogate())
    with pytest.raises((TypeError, ValueError), match=match):
        hs.DiscrepancyDiagnosis(model, **setting).fit(np.zeros((20, 1)), np.zeros(20))


def test_folds_are_those_asked_for():
    folds = random_folds(20, 5, 0)
    assert sorted(np.concatenate([test for _, test in folds])) == list(range(20))
    assert [len(test) for _, test in random_folds(9, 5, 0)] == [3, 2, 2, 2]
