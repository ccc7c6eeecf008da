"""Predictions averaged over several explanations."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from agreement import assert_same_numbers
from scipy import special
from sklearn.base import clone
from sklearn.exceptions import NotFittedError

import hybridsurrogate as hs
from hybridsurrogate.datasets import make_log_sin

WEIGHTS = (3.0, 1.0)


@pytest.fixture(scope="module")
def case():
    return make_log_sin(random_state=0)


def candidates(case, **more):
    effects = ([hs.Periodic("x")], [hs.Bump("x")])
    return [
        hs.PowerScaledSurrogate(
            case.simulator,
            surrogate=hs.ExactSurrogate(),
            effects=effect,
            n_draws=300,
            random_state=0,
            **more,
        )
        for effect in effects
    ]


@pytest.fixture(scope="module")
def fitted(case):
    models = candidates(case)
    parts = [model.fit(case.X, case.y) for model in candidates(case)]
    return hs.AveragedSurrogate(models, WEIGHTS, random_state=0).fit(case.X, case.y), parts


def test_density_and_moments_are_those_of_the_mixture(case, fitted):
    model, parts = fitted
    X, y = case.X_out, case.y_out
    log_density = [part.log_predictive_density(X, y) for part in parts]
    expected = special.logsumexp(log_density, axis=0, b=np.array([[0.75], [0.25]]))
    np.testing.assert_allclose(model.log_predictive_density(X, y), expected)
    (one, sd_one), (two, sd_two) = (part.predict(X, return_std=True) for part in parts)
    mean, sd = model.predict(X, return_std=True)
    np.testing.assert_allclose(mean, 0.75 * one + 0.25 * two)
    variance = 0.75 * sd_one**2 + 0.25 * sd_two**2 + 0.75 * 0.25 * (one - two) ** 2
    np.testing.assert_allclose(sd, np.sqrt(variance))


def test_draws_and_intervals_hold_both_explanations(case, fitted):
    model, parts = fitted
    X = case.X_out[-1:]
    draws = model.sample_posterior_predictive(X, n_draws=40_000, random_state=0)[:, 0]
    each = [part.sample_posterior_predictive(X, n_draws=40_000)[:, 0] for part in parts]
    level = np.median(each[0])
    expected = 0.75 * np.mean(each[0] < level) + 0.25 * np.mean(each[1] < level)
    # three errors of the difference of two shares near a half, and four of a share of a tenth
    assert np.mean(draws < level) == pytest.approx(expected, abs=0.01)
    lower, upper = model.predict_interval(X, 0.8)
    assert np.mean(draws < lower[0]) == pytest.approx(0.1, abs=0.006)
    assert np.mean(draws > upper[0]) == pytest.approx(0.1, abs=0.006)


def test_leave_one_out_density_is_that_of_the_mixture(fitted):
    model, parts = fitted
    each = [part.loo().pointwise for part in parts]
    expected = special.logsumexp(each, axis=0, b=np.array([[0.75], [0.25]]))
    np.testing.assert_allclose(model.loo().pointwise, expected)


def test_estimators_that_are_fitted_need_no_further_fit(case, fitted, monkeypatch):
    model, parts = fitted
    monkeypatch.setattr(hs.PowerScaledSurrogate, "fit", None)
    average = hs.AveragedSurrogate.of_fitted(parts, WEIGHTS, random_state=0)
    assert average.estimators_ == parts
    assert_same_numbers(average.predict(case.X_out), model.predict(case.X_out))
    assert average.score(case.X, case.y) == pytest.approx(model.score(case.X, case.y))
    for name in ("posterior_", "diagnostics_"):
        assert getattr(average, name) is getattr(parts[0], name)
    assert average.effects == tuple(parts[0].effects)
    assert not hasattr(clone(average), "posterior_")


def test_estimators_of_other_rows_are_not_averaged(case, fitted):
    first, second = fitted[1]
    other = clone(second).fit(case.X[:-1], case.y[:-1])
    with pytest.raises(ValueError, match="the same measured rows"):
        hs.AveragedSurrogate.of_fitted([first, other], WEIGHTS)
    with pytest.raises(NotFittedError):
        hs.AveragedSurrogate.of_fitted([first, clone(second)], WEIGHTS)


def test_an_explanation_without_weight_has_no_say(case, fitted):
    alone = hs.AveragedSurrogate(candidates(case), [1, 0], random_state=0).fit(case.X, case.y)
    assert_same_numbers(alone.predict(case.X_out), fitted[1][0].predict(case.X_out))


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"estimators": []}, ValueError, "at least one estimator"),
        ({"estimators": [hs.Offset()]}, TypeError, "must hold PowerScaledSurrogate"),
        ({"weights": [1.0]}, ValueError, "one number for each of the 2 estimators"),
        ({"weights": [1.0, -0.1]}, ValueError, "must not be negative"),
        ({"weights": [1.0, np.nan]}, ValueError, "must not be negative or NaN"),
        ({"weights": [0.0, 0.0]}, ValueError, "sum must be positive"),
    ],
)
def test_bad_input_is_told(case, change, error, message):
    model = hs.AveragedSurrogate(candidates(case), WEIGHTS).set_params(**change)
    with pytest.raises(error, match=message):
        model.fit(case.X, case.y)


@pytest.mark.parametrize(("weights", "warned"), [((0.95, 0.05), False), ((0.6, 0.4), True)])
def test_doubtful_draws_count_by_their_weight(case, monkeypatch, weights, warned):
    doubtful = replace(candidates(case)[0].fit(case.X, case.y).diagnostics_, khat=1.2)
    keep = hs.PowerScaledSurrogate._keep

    def kept(self, *found):
        keep(self, *found)
        if self.effects[0].kind == "bump":
            self.diagnostics_ = doubtful
        return self

    monkeypatch.setattr(hs.PowerScaledSurrogate, "_keep", kept)
    model = hs.AveragedSurrogate(candidates(case), weights)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model.fit(case.X, case.y)
    told = [str(one.message) for one in caught]
    assert len(told) == warned
    if warned:
        assert "1 of 2 estimators, with 40 % of the weight, are doubtful; of estimator 1" in told[0]
        assert "k-hat of step 1 is 1.20" in told[0]


def test_estimators_must_share_simulation_and_likelihood(case):
    for other in (
        candidates(make_log_sin(random_state=0)),
        candidates(case, likelihood=hs.StudentT()),
        candidates(case, experiment="x"),
    ):
        model = hs.AveragedSurrogate([candidates(case)[0], other[1]], WEIGHTS)
        with pytest.raises(ValueError, match="the same simulation object, the same likelihood"):
            model.fit(case.X, case.y)


@pytest.mark.parametrize("outliers_first", [True, False])
def test_an_explanation_with_outliers_beside_one_without(outliers_first):
    """Intervals and ArviZ's draws are those of the mixture, in either order."""
    simulator = hs.Simulator(
        lambda t, a: a * t, {"t": (0, 10)}, {"a": hs.truncated_normal(2, 1, 0, 4)}
    )
    t = np.linspace(0, 10, 30)[:, None]
    y = 2 * t[:, 0] + 0.4 * np.random.default_rng(0).standard_normal(30)
    y[[3, 11]] += 8
    parts = [
        hs.PowerScaledSurrogate(
            simulator, surrogate=hs.ExactSurrogate(), effects=[effect], n_draws=400, random_state=0
        )
        for effect in (hs.Outliers(), hs.Offset())
    ]
    weights = [0.7, 0.3]
    order = slice(None) if outliers_first else slice(None, None, -1)
    model = hs.AveragedSurrogate(parts[order], weights[order], random_state=0).fit(t, y)
    draws = model.sample_posterior_predictive(t, 40_000, random_state=0)
    low, high = model.predict_interval(t, 0.98)
    # 2 % lie outside: 40000 draws know that to 0.07 %
    assert np.mean((draws < low) | (draws > high)) == pytest.approx(0.02, abs=0.002)
    told = model.to_arviz()
    density = told.log_likelihood["y"].to_numpy()[0]
    mean = special.logsumexp(density, axis=0) - np.log(len(density))
    # 400 draws: a share of 0.3 is known to 8 %, an outlier's density to about as much
    np.testing.assert_allclose(mean, model.log_predictive_density(t, y), atol=0.2)
    spread = np.quantile(told.posterior_predictive["y"].to_numpy()[0], [0.1, 0.9], axis=0)
    expected = np.quantile(draws, [0.1, 0.9], axis=0)
    assert np.abs(np.mean(spread - expected, axis=1)).max() < 0.1
