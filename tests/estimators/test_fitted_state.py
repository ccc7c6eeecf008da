"""What a fit found stands until the next fit."""

import numpy as np
import pandas as pd
import pytest
from few_kinds import all_but
from sklearn.base import clone
from sklearn.exceptions import NotFittedError

import hybridsurrogate as hs


@pytest.mark.parametrize(
    "estimator", [hs.PowerScaledSurrogate, hs.PredictiveWeightedSurrogate], ids=lambda e: e.__name__
)
@pytest.mark.parametrize("beta", [0.9, lambda X: np.full(len(X), 0.9)], ids=["number", "callable"])
def test_parameters_set_after_fit_change_nothing(simulation, measured, estimator, beta):
    X, y = measured
    model = estimator(
        simulation, surrogate=hs.PolynomialChaos(1), beta=0.1, n_draws=100, random_state=0
    ).fit(X, y)
    mean, elpd, draws = model.predict(X), model.loo().elpd, model.sample_predictive_mean(X)
    model.set_params(beta=beta)
    np.testing.assert_array_equal(model.predict(X), mean)
    assert model.loo().elpd == elpd
    np.testing.assert_array_equal(model.sample_predictive_mean(X), draws)


def test_powers_set_after_fit_change_nothing(simulation, measured):
    sources = [hs.Source(simulation)]
    model = hs.MultiSourceSurrogate(
        sources, power=0.2, surrogate=hs.PolynomialChaos(1), n_draws=100, random_state=0
    ).fit(*measured)
    elpd = model.loo().elpd
    assert model.set_params(power=1.0).loo().elpd == elpd


def test_arrays_changed_after_fit_change_nothing(fitted, measured):
    X, y, weights = *(np.array(array) for array in measured), np.ones(32)
    weights[3] = 0
    model = clone(fitted).fit(X, y, sample_weight=weights)
    pointwise = model.loo().pointwise
    X += 1
    y += 100
    weights += 1
    np.testing.assert_array_equal(model.loo().pointwise, pointwise)


def test_arrays_changed_after_a_diagnosis_do_not_reach_it():
    rng = np.random.default_rng(0)
    line = hs.Simulator(lambda t: 2 * t, inputs={"t": (0, 10)})
    X = np.linspace(0, 10, 25)[:, None]
    y = 2 * X[:, 0] + 1 + 0.1 * rng.standard_normal(25)
    model = hs.PowerScaledSurrogate(line, hs.ExactSurrogate(), n_draws=100, random_state=0)
    settings = {"exclude": all_but("offset", "trend"), "n_replicates": 20, "cv": None}
    diagnosis = hs.DiscrepancyDiagnosis(model, **settings, random_state=0).fit(X, y)
    new, more = np.linspace(0, 10, 5)[:, None], np.linspace(1, 21, 5)
    expected, kept = clone(diagnosis).fit(X, y).update(new, more).table, new.copy()
    y += 100
    X += 5
    pd.testing.assert_frame_equal(diagnosis.update(kept, more).table, expected)


class Failing(hs.PolynomialChaos):
    """A surrogate whose fit fails after the data were checked."""

    def build(self, domain):
        raise RuntimeError("no basis")


def estimators(simulation, surrogate):
    settings = {"n_draws": 100, "random_state": 0, "surrogate": surrogate}
    one = hs.PowerScaledSurrogate(simulation, **settings)
    return [
        one,
        hs.PredictiveWeightedSurrogate(simulation, **settings),
        hs.KennedyOHaganSurrogate(simulation, **settings),
        hs.MultiSourceSurrogate([hs.Source(simulation)], **settings),
        hs.AveragedSurrogate([one], [1.0], random_state=0),
    ]


@pytest.mark.parametrize("which", range(5))
def test_a_failed_first_fit_is_no_fit(simulation, measured, which):
    X, y = measured
    model = estimators(simulation, Failing())[which]
    with pytest.raises(RuntimeError, match="no basis"):
        model.fit(X, y)
    for ask in (model.predict, model.sample_posterior_predictive, model.predict_interval):
        with pytest.raises(NotFittedError):
            ask(X)
    with pytest.raises(NotFittedError):
        model.loo()


@pytest.mark.parametrize("which", range(5))
def test_a_failed_refit_leaves_the_fit_before(simulation, measured, which):
    X, y = measured
    model = estimators(simulation, hs.PolynomialChaos(1))[which].fit(X, y)
    mean = model.predict(X)
    more = np.hstack([X, X])
    with pytest.raises(ValueError, match="NaN"):
        model.fit(more, np.full(32, np.nan))
    part = model.estimators[0] if which == 4 else model
    part.set_params(surrogate=Failing())
    with pytest.raises(RuntimeError, match="no basis"):
        model.fit(more, y)
    assert model.n_features_in_ == 1
    np.testing.assert_array_equal(model.predict(X), mean)
