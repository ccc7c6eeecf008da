"""What scikit-learn may expect of the estimators."""

import copy
import pickle

import numpy as np
import pandas as pd
import pytest
from agreement import assert_same_numbers
from scipy.stats import norm
from sklearn.base import clone, is_regressor
from sklearn.model_selection import GridSearchCV, KFold, cross_val_score
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer, SplineTransformer
from sklearn.utils.estimator_checks import estimator_checks_generator

import hybridsurrogate as hs

ESTIMATORS = [hs.PowerScaledSurrogate, hs.PredictiveWeightedSurrogate]


def line(X, omega, constants):
    return constants["height"] + constants["slope"] * X[:, 0]


def power_scaled(**parameters):
    return hs.PowerScaledSurrogate(n_draws=50, sampler="importance", random_state=0, **parameters)


# a check has thirty columns: higher degrees would have thousands of terms there
CHECKED = {
    "power-scaled": hs.PowerScaledSurrogate(n_draws=100, random_state=0),
    "predictive-weighted": hs.PredictiveWeightedSurrogate(n_draws=100, random_state=0),
    "kennedy-ohagan": hs.KennedyOHaganSurrogate(
        surrogate=hs.PolynomialChaos(1), sampler="importance", n_draws=50, random_state=0
    ),
    "multi-source": hs.MultiSourceSurrogate(n_draws=100, random_state=0),
    "averaged": hs.AveragedSurrogate(
        [power_scaled(), power_scaled(surrogate=hs.PolynomialChaos(1))], [0.6, 0.4], random_state=0
    ),
    "gaussian-process": power_scaled(surrogate=hs.GaussianProcess(degree=1)),
    "features": power_scaled(surrogate=hs.FeatureSurrogate(SplineTransformer(n_knots=3))),
    "network": power_scaled(surrogate=hs.NetworkSurrogate(hidden_layer_sizes=(2,))),
    "parametric": power_scaled(
        surrogate=hs.ParametricSurrogate(line, {"height": norm(0, 100), "slope": norm(0, 100)})
    ),
}


# the same numbers in another form: `fit` has made one table of them before a surrogate sees it
OTHER_FORMS = (
    "check_dtype_object",
    "check_estimators_dtypes",
    "check_f_contiguous_array_estimator",
    "check_fit2d_predict1d",
    "check_positive_only_tag_during_fit",
    "check_readonly_memmap_input",
    "check_regressor_data_not_an_array",
    "check_regressors_int",
    "check_sample_weights_list",
    "check_sample_weights_not_an_array",
    "check_sample_weights_pandas_series",
    "check_supervised_y_2d",
)
# two fits that must agree
SAME_NUMBERS = ("check_fit_idempotent", "check_sample_weight_equivalence_on_dense_data")
# ten columns take its lengths seconds: of one column in tests/estimators/test_weights.py
ELSEWHERE = ("gaussian-process", "check_sample_weight_equivalence_on_dense_data")


def is_repeated(name, check, what):
    """Return whether another estimator's check runs the same lines."""
    is_form = what in OTHER_FORMS or getattr(check, "keywords", {}).get("readonly_memmap")
    inherits = all(
        getattr(type(CHECKED[name]), method) is getattr(hs.PowerScaledSurrogate, method)
        for method in ("fit", "checked_data", "predict")
    )
    return (is_form and inherits and name != "power-scaled") or (name, what) == ELSEWHERE


def checks():
    # ids of our own: the priors' addresses in scikit-learn's differ from process to process
    for name, estimator in CHECKED.items():
        for one, check in estimator_checks_generator(estimator):
            what = getattr(check, "func", check).__name__
            marks = [pytest.mark.numbers] if what in SAME_NUMBERS else []
            if not is_repeated(name, check, what):
                yield pytest.param(one, check, id=f"{name}-{what}", marks=marks)


@pytest.mark.parametrize(("estimator", "check"), list(checks()))
def test_scikit_learn_check(estimator, check):
    check(estimator)


@pytest.fixture(params=ESTIMATORS)
def model(request, simulation):
    return request.param(
        simulation, surrogate=hs.PolynomialChaos(degree=2), n_draws=200, random_state=0
    )


def test_is_a_regressor_whose_score_is_no_r2(model):
    assert is_regressor(model)
    assert model.__sklearn_tags__().regressor_tags.poor_score


def test_clone_keeps_the_simulation_itself(model, simulation, measured):
    model.fit(*measured)
    again = clone(model)
    assert again.simulation is simulation
    assert again.surrogate is not model.surrogate
    assert again.surrogate.degree == 2
    assert not hasattr(again, "diagnostics_")
    np.testing.assert_array_equal(
        again.fit(*measured).predict(measured[0]), model.predict(measured[0])
    )


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda m: pickle.loads(pickle.dumps(m))])
def test_fitted_model_survives_a_round_trip(model, measured, copied):
    X, y = measured
    again = copied(model.fit(X, y))
    np.testing.assert_array_equal(again.predict(X), model.predict(X))
    np.testing.assert_array_equal(
        again.log_predictive_density(X, y), model.log_predictive_density(X, y)
    )


def test_set_params_reaches_the_surrogate(model, measured):
    model.set_params(surrogate__degree=1, beta=0.9)
    assert model.surrogate.degree == 1
    # (t, gravity) up to degree 1 are three terms, t alone two
    model.fit(*measured)
    posterior = getattr(model, "posterior_", None) or model.simulation_posterior_
    assert posterior.coefficients.shape == (200, 3)


def test_parameters_are_not_touched_by_fit(model, measured):
    before = model.get_params()
    model.fit(*measured)
    assert model.get_params() == before


def test_cross_val_score(model, measured):
    scores = cross_val_score(model, *measured, cv=KFold(4))
    assert scores.shape == (4,)
    # normal noise with sd 1 has an expected log density of -1.4
    assert np.isfinite(scores).all()
    assert -2.5 < scores.mean() < -1.0


def test_search_over_beta_never_slices_the_runs(model, measured, simulation):
    # as many runs as measured rows: an array-like of runs would be cut into folds
    assert simulation.n_runs == len(measured[1])
    search = GridSearchCV(model, {"beta": [0.0, 0.5, 1.0]}, cv=KFold(4)).fit(*measured)
    assert search.best_params_["beta"] in (0.0, 0.5, 1.0)
    assert np.isfinite(search.cv_results_["mean_test_score"]).all()
    assert search.best_estimator_.simulation is simulation


def test_search_over_the_degree_of_the_surrogate(model, measured):
    # the fall is quadratic: a straight line cannot follow it
    search = GridSearchCV(model, {"surrogate__degree": [1, 2]}, cv=KFold(4)).fit(*measured)
    assert search.best_params_ == {"surrogate__degree": 2}


def test_same_seed_same_scores_whatever_n_jobs(model, measured):
    results = [
        GridSearchCV(model, {"beta": [0.2, 0.8]}, cv=KFold(3), n_jobs=n).fit(*measured)
        for n in (1, 2)
    ]
    assert_same_numbers(
        results[0].cv_results_["mean_test_score"], results[1].cv_results_["mean_test_score"]
    )


def test_seeds(model, measured):
    X, y = measured
    first, same = (clone(model).fit(X, y).sample_predictive_mean(X) for _ in range(2))
    other = clone(model).set_params(random_state=1).fit(X, y).sample_predictive_mean(X)
    np.testing.assert_array_equal(first, same)
    assert (first != other).any()


def test_random_state_object_is_used_and_moved_on(model, measured):
    X, y = measured
    state = np.random.RandomState(3)
    model.set_params(random_state=state)
    first, second = model.fit(X, y).predict(X), model.fit(X, y).predict(X)
    assert (first != second).any()
    np.testing.assert_array_equal(
        model.set_params(random_state=np.random.RandomState(3)).fit(X, y).predict(X), first
    )


def test_predict_is_deterministic_without_a_seed(model, measured):
    X, y = measured
    model.set_params(random_state=None).fit(X, y)
    attributes = set(vars(model))
    np.testing.assert_array_equal(model.predict(X), model.predict(X))
    assert set(vars(model)) == attributes


def test_pipeline_converts_units_before_the_simulation(model, measured):
    seconds, y = measured
    pipeline = make_pipeline(FunctionTransformer(lambda minutes: 60 * minutes), model)
    pipeline.fit(seconds / 60, y)
    direct = clone(model).fit(seconds, y)
    np.testing.assert_allclose(pipeline.predict(seconds / 60), direct.predict(seconds), rtol=1e-6)
    search = GridSearchCV(pipeline, {pipeline.steps[-1][0] + "__beta": [0.1, 0.9]}, cv=3)
    assert np.isfinite(search.fit(seconds / 60, y).best_score_)


def test_columns_of_a_frame_go_by_name(model, measured):
    X, y = measured
    expected = clone(model).fit(X, y).predict(X)
    noise = np.random.default_rng(0).normal(size=len(y))
    frame = pd.DataFrame({"humidity": noise, "t": X[:, 0], "wind": -noise})
    model.fit(frame, y)
    assert list(model.feature_names_in_) == ["humidity", "t", "wind"]
    assert_same_numbers(model.predict(frame), expected)
    assert_same_numbers(model.predict(frame[["t", "wind", "humidity"]]), expected)
    with pytest.raises(ValueError, match="feature names should match"):
        model.predict(frame[["t", "wind"]])


def test_extra_columns_of_an_array_come_after_the_inputs(model, measured):
    X, y = measured
    expected = clone(model).fit(X, y).predict(X)
    wide = np.column_stack([X, np.arange(len(y))])
    assert_same_numbers(model.fit(wide, y).predict(wide), expected)


def test_frame_of_the_same_numbers_is_the_same_fit(model, measured):
    X, y = measured
    frame, series = pd.DataFrame({"t": X[:, 0]}), pd.Series(y)
    assert_same_numbers(clone(model).fit(frame, series).predict(frame), model.fit(X, y).predict(X))


@pytest.mark.parametrize("estimator", ESTIMATORS)
@pytest.mark.parametrize(
    ("X", "y"),
    [
        (np.linspace(0, 1, 10)[:, None], np.full(10, 3.0)),
        (np.linspace(0, 1, 10)[:, None], np.zeros(10)),
        (np.full((10, 1), 2.0), np.arange(10.0)),
        (np.array([[0.0], [1.0]]), np.array([1.0, 2.0])),
        (np.linspace(0, 1, 10)[:, None], 1e6 + np.linspace(0, 1, 10)),
        (np.linspace(0, 1e-6, 10)[:, None], 1e-9 * np.linspace(0, 1, 10)),
    ],
    ids=["constant", "zero", "same-inputs", "two-rows", "large-offset", "tiny"],
)
def test_odd_data_give_finite_predictions_near_y(estimator, X, y):
    model = estimator(n_draws=100, random_state=0).fit(X, y)
    mean, sd = model.predict(X, return_std=True)
    assert np.isfinite(mean).all()
    assert (sd > 0).all()
    reach = max(np.ptp(y), abs(y).max() * 1e-3, 1e-3 * (y == 0).all())
    assert np.abs(mean - (y if len(np.unique(X)) > 1 else y.mean())).max() < reach


def test_one_row_is_too_few(model):
    with pytest.raises(ValueError, match="minimum of 2 is required"):
        model.fit([[1.0]], [95.0])
