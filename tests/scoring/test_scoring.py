import pickle

import numpy as np
import pytest
from scipy import stats
from sklearn.linear_model import LinearRegression
from sklearn.model_selection import GridSearchCV, KFold
from sklearn.pipeline import make_pipeline

import hybridsurrogate as hs
from hybridsurrogate.scoring import (
    SCORERS,
    coverage,
    crps,
    elpd,
    elpd_scorer,
    interval_score,
    interval_score_scorer,
    interval_width,
    neg_crps_scorer,
    neg_rmse_scorer,
    paired_difference,
    pit,
    rmse,
)


def test_elpd_is_a_mean_with_the_standard_error_of_a_mean():
    mean, error = elpd([-1.0, -2.0, -6.0])
    assert mean == -3.0
    # sample variance (4 + 1 + 9) / 2 = 7
    assert error == pytest.approx(np.sqrt(7 / 3))


def test_one_row_has_no_standard_error():
    assert elpd([-1.0])[0] == -1.0
    assert np.isnan(elpd([-1.0])[1])
    assert np.isnan(paired_difference([1.0], [0.0]).standard_error)


def test_rmse_takes_the_root_in_every_row():
    # rows with errors (3, 4) and (0, 2): roots of 12.5 and 2
    draws = [[3.0, 1.0], [4.0, 3.0]]
    assert rmse(draws, [0.0, 1.0]) == pytest.approx((np.sqrt(12.5) + np.sqrt(2)) / 2)


def test_coverage_counts_rows_inside_ends_included():
    y, lower, upper = [0.0, 1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 0.0], [1.0, 1.0, 1.0, 1.0]
    assert coverage(y, lower, upper) == 0.5
    # a column beside rows would be every pair of them
    with pytest.raises(ValueError, match=r"one value a row; got y \(4, 1\)"):
        coverage(np.reshape(y, (4, 1)), lower, upper)


def test_paired_difference_has_the_error_of_the_differences():
    rng = np.random.default_rng(0)
    before = rng.normal(0, 100, 50)
    gain = paired_difference(before + 2, before)
    assert gain.difference == pytest.approx(2)
    assert gain.standard_error == pytest.approx(0, abs=1e-12)
    gain = paired_difference([1.0, 4.0, 1.0], [0.0, 0.0, 0.0])
    assert gain.difference == 2.0
    # sample variance of (1, 4, 1) is 3
    assert gain.standard_error == pytest.approx(1.0)


def test_interval_width_is_a_mean():
    assert interval_width([0.0, 1.0, 2.0], [1.0, 1.0, 7.0]) == 2.0


def test_interval_score_fines_what_lies_outside():
    # level 0.9: 20 for each unit outside; rows inside, below, above, on the edge
    y, lower, upper = [0.5, -1.0, 3.5, 2.0], [0.0, 0.0, 1.0, 2.0], [1.0, 2.0, 3.0, 4.0]
    np.testing.assert_allclose(interval_score(y, lower, upper), [1, 2 + 20, 2 + 10, 2])
    np.testing.assert_allclose(interval_score(y, lower, upper, level=0.5), [1, 2 + 4, 2 + 2, 2])


def test_interval_score_is_best_for_the_true_quantiles():
    y = np.random.default_rng(0).normal(size=200_000)
    mean_score = {
        reach: interval_score(y, np.full_like(y, -reach), np.full_like(y, reach), 0.8).mean()
        for reach in (1.1, stats.norm.ppf(0.9), 1.5)
    }
    _, true, _ = mean_score.values()
    assert true < min(mean_score[1.1], mean_score[1.5])


def normal_crps(y):
    """Score of the standard normal distribution, closed form."""
    return y * (2 * stats.norm.cdf(y) - 1) + 2 * stats.norm.pdf(y) - 1 / np.sqrt(np.pi)


def test_crps_of_a_normal_distribution():
    y = np.array([-3.0, -1.0, 0.0, 0.3, 2.0])
    n_draws = 200_000
    # evenly spaced quantiles, so the only error is the grid's
    draws = stats.norm.ppf((np.arange(n_draws) + 0.5) / n_draws)
    draws = np.tile(draws[:, None], (1, len(y)))
    before = draws.copy()
    np.testing.assert_allclose(crps(draws, y), normal_crps(y), atol=2e-5)
    np.testing.assert_array_equal(draws, before)
    # y and draws in other units and from another zero
    np.testing.assert_allclose(crps(1e6 - 3 * draws, 1e6 - 3 * y), 3 * normal_crps(y), atol=6e-5)


def test_crps_is_the_sum_over_pairs():
    rng = np.random.default_rng(1)
    draws, y = rng.gamma(2.0, size=(13, 4)), rng.gamma(2.0, size=4)
    pairs = np.abs(draws[:, None] - draws[None]).sum(axis=(0, 1)) / (13 * 12)
    np.testing.assert_allclose(crps(draws, y), np.abs(draws - y).mean(axis=0) - pairs / 2)


def test_crps_of_few_draws_has_no_bias():
    draws = np.random.default_rng(2).normal(size=(3, 100_000))
    scores = crps(draws, np.full(100_000, 0.7))
    # standard error 0.002; three draws without the correction for pairs would be off by 0.19
    assert scores.mean() == pytest.approx(normal_crps(0.7), abs=0.008)


def test_crps_of_equal_draws_is_the_absolute_error():
    np.testing.assert_allclose(crps(np.full((5, 2), 4.0), [1.0, 4.5]), [3.0, 0.5])


@pytest.mark.parametrize("n_draws", [1, 7, 400])
@pytest.mark.parametrize("distribution", [stats.norm(3, 2), stats.poisson(1.3), stats.poisson(40)])
def test_pit_of_right_predictions_is_uniform(distribution, n_draws):
    rng = np.random.default_rng(3)
    draws = distribution.rvs((n_draws, 4000), random_state=rng)
    values = pit(draws, distribution.rvs(4000, random_state=rng), random_state=rng)
    assert stats.kstest(values, "uniform").pvalue > 0.01


def test_pit_tells_wrong_predictions():
    rng = np.random.default_rng(4)
    y = rng.poisson(3.0, 2000)
    too_sure = pit(np.full((100, 2000), 3.0), y, random_state=0)
    assert stats.kstest(too_sure, "uniform").pvalue < 1e-6
    too_low = pit(rng.poisson(2.0, (100, 2000)), y, random_state=0)
    assert too_low.mean() > 0.6


def test_pit_of_continuous_draws_is_the_share_below():
    draws = np.arange(1000.0)[:, None] + np.zeros(3)
    np.testing.assert_allclose(pit(draws, [-0.5, 249.5, 1e4]), [0, 0.25, 1], atol=0.0015)


def test_pit_repeats_with_its_seed():
    draws, y = np.zeros((5, 50)), np.zeros(50)
    one, again, other = (pit(draws, y, seed) for seed in (0, 0, 1))
    np.testing.assert_array_equal(one, again)
    assert not np.array_equal(one, other)
    seeds = [np.random.RandomState(0), np.random.default_rng(0), None]
    assert all(((v > 0) & (v < 1)).all() for v in (pit(draws, y, seed) for seed in seeds))


@pytest.mark.parametrize("score", [crps, pit])
@pytest.mark.parametrize(
    ("draws", "y", "message"),
    [
        (np.zeros((5, 3)), np.zeros(4), r"shape \(n_draws, 4\), a column .*; got \(5, 3\)"),
        (np.zeros(4), np.zeros(4), r"shape \(n_draws, 4\), .*; got \(4,\)"),
        (np.zeros((0, 4)), np.zeros(4), r"got \(0, 4\)"),
        (np.zeros((5, 3)), np.zeros((3, 1)), r"one value a row; got y \(3, 1\)"),
        (np.zeros((5, 0)), np.zeros(0), r"got y \(0,\)"),
        (np.full((5, 3), np.nan), np.zeros(3), "draws must be finite"),
        (np.zeros((5, 3)), [0, np.inf, 0], "y must be finite"),
    ],
)
def test_wrong_draws_are_refused(score, draws, y, message):
    with pytest.raises(ValueError, match=message):
        score(draws, y)


def test_one_draw_has_no_fair_crps():
    with pytest.raises(ValueError, match="at least two draws"):
        crps([[1.0, 2.0]], [1.0, 2.0])


def test_wrong_intervals_are_refused():
    with pytest.raises(ValueError, match=r"got lower \(2,\), upper \(3,\)"):
        interval_width([0.0, 0.0], [1.0, 1.0, 1.0])
    with pytest.raises(ValueError, match=r"got y \(1,\), lower \(2,\), upper \(2,\)"):
        interval_score([0.0], [0.0, 0.0], [1.0, 1.0])
    with pytest.raises(ValueError, match="level must be a finite number, got nan"):
        interval_score([0.0], [0.0], [1.0], np.nan)
    for level in (0.0, 1.0, 90):
        with pytest.raises(ValueError, match="level must lie between 0 and 1"):
            interval_score([0.0], [0.0], [1.0], level)


def test_scorers_are_the_scores_of_a_fit(fitted, measured):
    X, y = measured
    assert elpd_scorer(fitted, X, y) == pytest.approx(fitted.score(X, y))
    assert neg_rmse_scorer(fitted, X, y) == -np.sqrt(np.mean((fitted.predict(X) - y) ** 2))
    score = interval_score(y, *fitted.predict_interval(X, level=0.9), 0.9)
    assert interval_score_scorer(fitted, X, y) == -score.mean()
    draws = fitted.sample_posterior_predictive(X, n_draws=20_000, random_state=5)
    assert neg_crps_scorer(fitted, X, y) == pytest.approx(-crps(draws, y).mean(), rel=0.03)
    assert neg_crps_scorer(fitted, X, y) == neg_crps_scorer(fitted, X, y)


@pytest.mark.parametrize("scorer", SCORERS.values())
def test_scorers_know_better_from_worse(scorer, fitted, fitted_mixture, measured):
    X, y = measured
    for model in (fitted, fitted_mixture):
        assert scorer(model, X, y) > scorer(model, X, y + 5)


@pytest.mark.parametrize("scorer", SCORERS.values())
def test_scorers_can_be_pickled(scorer):
    assert pickle.loads(pickle.dumps(scorer)) is scorer


@pytest.mark.parametrize(
    ("scorer", "method"),
    [
        (elpd_scorer, "log_predictive_density"),
        (neg_crps_scorer, "sample_posterior_predictive"),
        (interval_score_scorer, "predict_interval"),
    ],
)
def test_scorers_say_what_an_estimator_lacks(scorer, method, measured):
    X, y = measured
    line = LinearRegression().fit(X, y)
    assert neg_rmse_scorer(line, X, y) < 0
    message = f"{scorer.__name__} needs an estimator with the method {method}.*; LinearRegression"
    with pytest.raises(TypeError, match=message):
        scorer(line, X, y)
    with pytest.raises(TypeError, match="Pipeline has none"):
        scorer(make_pipeline(line), X, y)


@pytest.fixture(scope="module")
def small_model(simulation):
    return hs.PowerScaledSurrogate(
        simulation, surrogate=hs.PolynomialChaos(degree=2), n_draws=100, random_state=0
    )


def search(model, measured, scoring, refit=True):
    grid = GridSearchCV(
        model,
        {"beta": [0.0, 0.5, 1.0]},
        scoring=scoring,
        refit=refit,
        cv=KFold(3, shuffle=True, random_state=0),
        error_score="raise",
    )
    return grid.fit(*measured)


@pytest.fixture(scope="module")
def search_with_all(small_model, measured):
    return search(small_model, measured, SCORERS, refit="elpd")


def test_search_over_beta_with_all_scorers(search_with_all):
    results = search_with_all.cv_results_
    best = search_with_all.best_index_
    # of weights equal but for rounding either may be the best
    assert results["mean_test_elpd"][best] >= results["mean_test_elpd"].max() - 1e-9
    for name in SCORERS:
        assert np.isfinite(results[f"mean_test_{name}"]).all()
    # normal noise with sd 1: what a perfect prediction has, and some loss
    assert -2.0 < results["mean_test_elpd"][best] < -1.2
    assert -1.6 < results["mean_test_neg_rmse"][best] < -0.7
    assert -0.9 < results["mean_test_neg_crps"][best] < -0.4
    assert -7.0 < results["mean_test_neg_interval_score"][best] < -3.3


@pytest.mark.parametrize("name", SCORERS)
def test_search_over_beta_with_one_scorer(name, search_with_all, small_model, measured):
    alone = search(small_model, measured, SCORERS[name])
    scores = search_with_all.cv_results_[f"mean_test_{name}"]
    np.testing.assert_allclose(alone.cv_results_["mean_test_score"], scores)
    assert scores[alone.best_index_] >= scores.max() - 1e-9
    assert hasattr(alone.best_estimator_, "posterior_")
