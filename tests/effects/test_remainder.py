"""What may be lacking beyond the measured range: nothing within it, more the further out."""

import pickle

import numpy as np
import pandas as pd
import pytest
from few_kinds import all_but
from scipy import stats
from sklearn.base import clone

import hybridsurrogate as hs
from hybridsurrogate.effects.output.processes import GROWTH, LEAST, LEAST_OF_CURVE, MOST

T = np.linspace(0, 10, 30)
Y = 2 * T + 1.0 + 0.1 * np.random.default_rng(0).standard_normal(30)


def line(t, a):
    return a * t


SIMULATOR = hs.Simulator(line, {"t": (0, 20)}, {"a": hs.truncated_normal(2, 1, 0, 5)})


def fitted(*effects):
    return hs.PowerScaledSurrogate(
        SIMULATOR, surrogate=hs.ExactSurrogate(), effects=effects, random_state=0
    ).fit(T[:, None], Y)


@pytest.fixture(scope="module")
def both():
    return fitted(hs.Offset()), fitted(hs.Offset(), hs.Remainder(1.5))


def test_within_the_measured_range_nothing_changes(both):
    bare, kept = both
    X = np.linspace(0, 10, 17)[:, None]
    np.testing.assert_array_equal(bare.predict(X), kept.predict(X))
    np.testing.assert_array_equal(bare.posterior_.sigma, kept.posterior_.sigma)
    assert bare.score(T[:, None], Y) == kept.score(T[:, None], Y)
    assert bare.loo().elpd == kept.loo().elpd


@pytest.mark.parametrize("t", [10.5, 15.0, 30.0, -2.0])
def test_beyond_it_the_spread_is_that_of_the_prior(both, t):
    bare, kept = both
    X = np.array([[t]])
    added = kept.posterior_.eta(X)[0][:, 0] - bare.posterior_.eta(X)[0][:, 0]
    distance = max(t - 10, -t) / 10
    # a log-uniform amplitude times a normal: its second moment
    square = (MOST**2 - LEAST**2) / (2 * np.log(MOST / LEAST)) * 1.5**2 * distance ** (2 * GROWTH)
    assert np.mean(added**2) == pytest.approx(square, rel=0.3)
    assert abs(np.mean(added)) < 4 * np.sqrt(square / len(added))
    amplitude = kept.posterior_.named()["amplitude"]
    prior = stats.loguniform(1.5 * LEAST, 1.5 * MOST)
    amplitudes = np.sort(kept.posterior_.estimates(1)["amplitude"])
    np.testing.assert_allclose(prior.cdf(amplitudes), (np.arange(1000) + 0.5) / 1000, atol=1e-9)
    assert len(amplitude) == 1000


def test_the_predicted_mean_is_that_of_the_formula(both):
    bare, kept = both
    X = np.array([[5.0], [15.0], [30.0]])
    mean, std = kept.predict(X, return_std=True)
    np.testing.assert_array_equal(mean, bare.predict(X))
    assert std[0] == pytest.approx(bare.predict(X, return_std=True)[1][0])
    assert std[2] > std[1] > 2 * std[0]


def test_rows_beyond_one_end_share_it_and_rows_beyond_the_other_do_not(both):
    bare, kept = both
    X = np.array([[12.0], [18.0], [-3.0]])
    added = kept.posterior_.eta(X)[0] - bare.posterior_.eta(X)[0]
    np.testing.assert_allclose(added[:, 1], added[:, 0] * 4**GROWTH, rtol=1e-6, atol=1e-9)
    assert abs(np.corrcoef(np.sign(added[:, 0]), np.sign(added[:, 2]))[0, 1]) < 0.15


def test_a_fit_to_further_rows_moves_the_range(both):
    _, kept = both
    t = np.linspace(0, 20, 40)
    wider = clone(kept).fit(t[:, None], 2 * t + 1.0 + 0.1 * np.cos(50 * t))
    prepared = wider.posterior_.model.effects[-1]
    assert prepared.ranges == {"t": (0.0, 20.0)}
    assert kept.posterior_.model.effects[-1].ranges == {"t": (0.0, 10.0)}


def test_it_is_part_of_a_fitted_estimator_that_is_copied_and_stored(both):
    bare, kept = both
    added = bare.with_prior_only([hs.Remainder(1.5)])
    X = np.array([[15.0]])
    np.testing.assert_array_equal(added.predict(X), kept.predict(X))
    assert len(bare.effects) == 1
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(added)).predict(X), kept.predict(X))


def test_each_input_has_two_ends_and_one_that_was_not_varied_is_far_at_once():
    simulator = hs.Simulator(
        lambda t, u, v, a: a * t + u + 0 * v,
        {"t": (0, 20), "u": (0, 5), "v": (0, 1)},
        {"a": hs.truncated_normal(2, 1, 0, 5)},
    )
    random = np.random.default_rng(1)
    X = np.column_stack([T, random.uniform(0, 5, 30), np.full(30, 0.5)])
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), effects=[hs.Remainder(1.0)], random_state=0
    ).fit(X, 2 * T + X[:, 1] + 0.1 * random.standard_normal(30))
    prepared = model.posterior_.model.effects[-1]
    ends = [f"{side} {name}" for name in "tuv" for side in ("below", "above")]
    assert list(prepared.coefficients) == ends
    places = np.array([[5.0, 2.0, 0.5], [15.0, 9.0, 0.5], [5.0, 2.0, 0.51], [5.0, 2.0, 0.9]])
    inside, outside, *other = np.std(model.posterior_.eta(places)[0], axis=0)
    assert inside < 0.2 < outside
    # an amplitude that is log-uniform from 0.01 to 2, times a normal
    square = (MOST**2 - LEAST**2) / (2 * np.log(MOST / LEAST))
    np.testing.assert_allclose(np.square(other), square, rtol=0.3)


@pytest.mark.slow
def test_a_diagnosis_whose_true_cause_is_missing_from_the_catalogue_is_less_sure():
    """A wave that is not searched for: what is named goes wrong beyond the data, and is told."""
    random = np.random.default_rng(2)
    better = []
    for seed in range(4):
        t = np.linspace(0, 10, 40)
        phase = random.uniform(0, 6)

        def truth(t, phase=phase):
            return 2 * t + 1.5 * np.sin(2 * np.pi * t / 9 + phase)

        y = truth(t) + 0.2 * random.standard_normal(40)
        model = hs.PowerScaledSurrogate(
            SIMULATOR, surrogate=hs.ExactSurrogate(), random_state=seed, n_draws=400
        )
        diagnosis = hs.DiscrepancyDiagnosis(
            model, exclude=["periodic"], cv=None, n_replicates=19, random_state=seed
        ).fit(t[:, None], y)
        later = np.linspace(10.5, 16, 20)
        held = later[:, None], truth(later) + 0.2 * random.standard_normal(20)
        extended = diagnosis.extended_estimator_.estimators_[0]
        learned = [effect for effect in extended.effects if effect.is_learned]
        bare = clone(extended).set_params(effects=learned).fit(t[:, None], y)
        better.append(extended.score(*held) - bare.score(*held))
        inside = [model.interval_holds(*held)[0].mean() for model in (extended, bare)]
        assert inside[0] >= inside[1]
        assert "allows for further faults" in str(diagnosis.report(full=True)).replace("\n", " ")
    assert np.mean(better) > 0


def test_nothing_found_leaves_nothing_to_keep():
    model = hs.PowerScaledSurrogate(SIMULATOR, hs.ExactSurrogate(), n_draws=100, random_state=0)
    y = 2 * T + 0.1 * np.random.default_rng(3).standard_normal(30)
    settings = {"exclude": all_but("step", "trend"), "cv": None, "n_replicates": 39}
    diagnosis = hs.DiscrepancyDiagnosis(model, **settings, random_state=0).fit(T[:, None], y)
    assert diagnosis.verdict_ == "adequate"
    assert not diagnosis.extended_estimator_.effects


def test_beyond_what_its_experiment_measured_a_row_is_beyond_whatever_others_measured():
    # the first run ends at t = 4; a dose is set once for a run
    t = np.concatenate([np.linspace(0, 4, 15), np.linspace(0, 10, 15)])
    X = np.column_stack([t, np.repeat([1.0, 3.0], 15), np.repeat([1.0, 2.0], 15)])
    simulator = hs.Simulator(
        lambda t, dose, a: a * t + 0 * dose,
        {"t": (0, 20), "dose": (0, 5)},
        {"a": hs.truncated_normal(2, 1, 0, 5)},
    )
    rng = np.random.default_rng(1)
    model = hs.PowerScaledSurrogate(
        simulator,
        surrogate=hs.ExactSurrogate(),
        experiment="run",
        by_experiment={"a": "own"},
        effects=[hs.Remainder(1.5, by="run")],
        random_state=0,
    )
    X = pd.DataFrame(X, columns=["t", "dose", "run"])
    model.fit(X, 2 * t + 0.1 * rng.standard_normal(30))
    at = pd.DataFrame({"t": 8.0, "dose": [1.0, 3.0, 3.0, 1.0], "run": [1.0, 2.0, 1.0, 9.0]})
    _, std = model.predict(at, return_std=True)
    # of the first run, even at another dose; of one that was not measured not by this
    assert std[0] > 0.5
    assert std[2] > 0.5
    assert std[1] < 0.3


def test_an_extension_keeps_the_ranges_of_experiments_only_where_these_differ():
    rng = np.random.default_rng(2)
    t, run = np.tile(np.linspace(0, 10, 20), 2), np.repeat([1.0, 2.0], 20)
    rows = ~((run == 1) & (t > 5))
    y = 2 * t + 1.5 * (t > 3) + 0.1 * rng.standard_normal(40)
    X = pd.DataFrame({"t": t, "run": run})
    spreads = []
    shared = {"by_experiment": {"y": "spread"}}
    for options in ({}, shared, {"by_experiment": {"a": "own"}}):
        model = hs.PowerScaledSurrogate(
            SIMULATOR, surrogate=hs.ExactSurrogate(), experiment="run", random_state=0, **options
        )
        kinds = all_but("step", "trend", "offset")
        diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, random_state=0, exclude=kinds)
        diagnosis.fit(X[rows], y[rows])
        assert diagnosis.best_cause_.kind == "step"
        spreads.append(diagnosis.predict(X[~rows], return_std=True)[1].mean())
    assert spreads[1] < 1.5 * spreads[0]
    assert spreads[2] > 1.5 * spreads[0]


class Wave(hs.Trend):
    """A line that its author declares a curve of any shape."""

    kind = "wave"
    is_smooth_curve = True


@pytest.mark.parametrize("effect", [Wave("t"), hs.Trend("t")])
def test_what_a_cause_says_of_itself_decides_whether_it_is_followed_beyond(effect):
    plain = fitted()
    one = fitted(effect).with_prior_only([hs.Remainder(1.0)])
    both = hs.AveragedSurrogate.of_fitted([one], [1.0], 0, plain)
    beyond = np.array([[15.0]])
    expected = (plain if effect.is_smooth_curve else one).predict(beyond)
    np.testing.assert_allclose(both.predict(beyond), expected)
    np.testing.assert_allclose(both.predict(T[:, None]), one.predict(T[:, None]))


def test_beyond_the_range_a_curve_of_any_shape_leaves_predictions_to_the_simulation():
    # a quarter of a wave, which any smooth curve imitates
    rng = np.random.default_rng(4)
    t = np.linspace(0, 10, 40)
    y = 2 * t + 2 * np.sin(0.9 * t) + 0.1 * rng.standard_normal(40)
    model = hs.PowerScaledSurrogate(SIMULATOR, surrogate=hs.ExactSurrogate(), random_state=0)
    diagnosis = hs.DiscrepancyDiagnosis(
        model, cv=None, random_state=0, exclude=all_but("unexplained")
    ).fit(t[:, None], y)
    extended = diagnosis.extended_estimator_
    kept = [e for e in extended.estimators_[0].effects if e.kind == "remainder"]
    assert [one.least for one in kept] == [LEAST_OF_CURVE]
    assert kept[0].size == pytest.approx(np.std(2 * np.sin(0.9 * t)), rel=0.4)
    amplitude = extended.estimators_[0].posterior_.named()["amplitude"]
    assert amplitude.min() >= LEAST_OF_CURVE * kept[0].size * (1 - 1e-9)
    assert amplitude.max() <= MOST * kept[0].size * (1 + 1e-9)
    X, y_new = np.linspace(-5, 20, 51)[:, None], np.zeros(51)
    beyond = (X[:, 0] < 0) | (X[:, 0] > 10)
    plain, one = diagnosis.estimator_, extended.estimators_[0]
    for model, rows in ((plain, X[beyond]), (one, X[~beyond])):
        for name in ("predict", "predict_interval"):
            given, expected = (getattr(each, name)(rows) for each in (extended, model))
            np.testing.assert_allclose(given, expected)
    # rows of both together: densities, draws, and the same after a new fit
    density = extended.log_predictive_density(X, y_new)
    expected = [model.log_predictive_density(X, y_new) for model in (plain, one)]
    np.testing.assert_allclose(density, np.where(beyond, *expected))
    assert extended.sample_posterior_predictive(X, n_draws=50, random_state=0).shape == (50, 51)
    again = clone(extended).fit(t[:, None], y)
    np.testing.assert_allclose(again.predict(X), extended.predict(X), atol=0.3)
