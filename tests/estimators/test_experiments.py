"""Rows of several experiments: parameters that differ between them, labels that are no axis."""

import numpy as np
import pandas as pd
import pytest
from batches import DECAY, batches
from sklearn.base import clone
from sklearn.model_selection import GroupKFold, cross_val_score

import hybridsurrogate as hs

EXACT = {
    "surrogate": hs.ExactSurrogate(),
    "experiment": "batch",
    "n_draws": 300,
    "random_state": 0,
}
SPREAD = {"by_experiment": {"rate": "spread"}}


@pytest.fixture(scope="module")
def fitted():
    X, y, rates = batches(0)
    return hs.PowerScaledSurrogate(DECAY, **EXACT, **SPREAD).fit(X, y), X, y, rates


def test_each_batch_has_its_rate(fitted):
    model, _, _, rates = fitted
    told = model.posterior_.estimates(0)
    mean = model.posterior_.values[:, 0]
    for k, rate in enumerate(rates):
        draws = mean + told[f"batch = b{k}"]
        assert abs(draws.mean() - rate) < 4 * draws.std()
        assert draws.std() < 0.03
    assert model.diagnostics_.sampler == "importance"


def test_a_batch_that_was_not_measured_is_another_one(fitted):
    model, X, _, _ = fitted
    rows = X.head(1).assign(x=1.5)
    known = model.predict(rows, return_std=True)[1]
    other = model.predict(rows.assign(batch="new"), return_std=True)[1]
    shift = 3 * 1.5 * np.exp(-0.5 * 1.5) * 0.15
    assert known[0] < 0.1 < 0.6 * shift < other[0] < 2 * shift


def test_own_values_tell_nothing_of_each_other():
    X, y, rates = batches(0)
    own = hs.PowerScaledSurrogate(DECAY, **EXACT, by_experiment={"rate": "own"}).fit(X, y)
    told = own.posterior_.estimates(0)
    for k, rate in enumerate(rates):
        assert abs(told[f"batch = b{k}"].mean() - rate) < 4 * told[f"batch = b{k}"].std()
    # an experiment that was not measured has the prior: half a log of the rate
    rows = X.head(1).assign(x=1.5, batch="new")
    assert own.predict(rows, return_std=True)[1] > 0.3


def test_names_and_numbers_are_the_same():
    X, y, _ = batches(1, n=4)
    numbers = X.assign(batch=X.batch.str[1:].astype(int))
    told = [
        hs.PowerScaledSurrogate(DECAY, **EXACT, **SPREAD).fit(rows, y).predict(rows)
        for rows in (X, numbers)
    ]
    np.testing.assert_allclose(*told, rtol=1e-6)
    as_array = hs.PowerScaledSurrogate(DECAY, **{**EXACT, "experiment": "x1"}, **SPREAD)
    np.testing.assert_allclose(
        as_array.fit(numbers.to_numpy(), y).predict(numbers.to_numpy()), told[0], rtol=1e-6
    )


def test_a_name_is_no_axis_and_shared_parameters_ignore_it():
    X, y, _ = batches(1, n=4)
    plain = hs.PowerScaledSurrogate(DECAY, **EXACT).fit(X, y)
    shared = clone(plain).set_params(by_experiment={"rate": "shared"}).fit(X, y)
    np.testing.assert_allclose(plain.predict(X), shared.predict(X), rtol=1e-9)
    without = clone(plain).set_params(experiment=None).fit(X[["x"]], y)
    np.testing.assert_allclose(plain.predict(X), without.predict(X[["x"]]), rtol=1e-9)


def test_runs_alone_will_do():
    X, y, rates = batches(2, n=4)
    runs = DECAY.run(100, random_state=0)
    model = hs.PowerScaledSurrogate(
        runs, **{**EXACT, "surrogate": hs.PolynomialChaos(degree=5)}, **SPREAD
    ).fit(X, y)
    told = model.posterior_.estimates(0)
    draws = model.posterior_.values[:, 0] + told["batch = b0"]
    assert abs(draws.mean() - rates[0]) < 4 * draws.std()
    assert draws.std() < 0.1


def test_few_draws_have_the_proposals_that_many_unknowns_need():
    X, y, _ = batches(2, n=4)
    runs = DECAY.run(100, random_state=0)
    settings = {**EXACT, "surrogate": hs.PolynomialChaos(degree=5), **SPREAD}
    few, many = (
        hs.PowerScaledSurrogate(runs, **{**settings, "n_draws": n}).fit(X, y) for n in (300, 1000)
    )
    assert few.diagnostics_.second_khat < many.diagnostics_.second_khat + 0.25


@pytest.mark.parametrize(
    "make",
    [
        lambda: hs.PredictiveWeightedSurrogate(DECAY, beta=0.9, **EXACT, **SPREAD),
        lambda: hs.KennedyOHaganSurrogate(DECAY, **EXACT, **SPREAD),
    ],
)
def test_other_estimators_take_them(make):
    X, y, _ = batches(0, n=4)
    model = make()
    alike = clone(model).set_params(by_experiment=None)
    assert model.fit(X, y).score(X, y) > alike.fit(X, y).score(X, y) + 0.1


def test_further_sources_have_batches_of_their_own():
    X, y, rates = batches(0, n=5)
    first, other = X.batch != "b4", X.batch == "b4"
    model = hs.MultiSourceSurrogate(
        [hs.Source(DECAY.run(100, random_state=0)), hs.Source((X[other], y[other]))],
        surrogate=hs.PolynomialChaos(degree=5),
        experiment="batch",
        n_draws=300,
        random_state=0,
        **SPREAD,
    ).fit(X[first], y[first])
    draws = model.posterior_.values[:, 0] + model.posterior_.estimates(0)["batch = b4"]
    assert abs(draws.mean() - rates[4]) < 4 * draws.std() < 0.4


def test_left_out_batches_are_predicted_as_others():
    X, y, _ = batches(3, n=4)
    scores = [
        cross_val_score(
            hs.PowerScaledSurrogate(DECAY, **EXACT, by_experiment=by),
            X,
            y,
            groups=X.batch,
            cv=GroupKFold(4),
        ).mean()
        for by in (SPREAD["by_experiment"], None)
    ]
    # who takes batches to be all alike is too sure of the next one
    assert scores[0] > scores[1]


@pytest.mark.parametrize(
    ("settings", "word"),
    [
        ({"experiment": "subject"}, "none of the measured columns"),
        ({"experiment": "x"}, "an input of the simulation"),
        ({"experiment": 3}, "name of a measured column"),
        ({"experiment": None, "by_experiment": {"rate": "own"}}, "needs experiment"),
        ({"by_experiment": {"speed": "own"}}, "not a parameter"),
        ({"by_experiment": {"rate": "free"}}, "must be one of"),
        ({"by_experiment": ["rate"]}, "must map parameters to how"),
    ],
)
def test_settings_that_mean_nothing(settings, word):
    X, y, rates = batches(0, n=4)
    X["batch"] = X.batch.map({f"b{k}": k for k in range(len(rates))})
    model = hs.PowerScaledSurrogate(DECAY, **{**EXACT, **settings})
    with pytest.raises((TypeError, ValueError), match=word):
        model.fit(X, y)


def test_columns_that_cannot_be_labels():
    X, y, _ = batches(0, n=4)
    model = hs.PowerScaledSurrogate(DECAY, **EXACT, **SPREAD)
    with pytest.raises(ValueError, match="always the same"):
        model.fit(X.assign(batch="b0"), y)
    with pytest.raises(ValueError, match="'batch' are missing"):
        model.fit(X.assign(batch=X.batch.where(X.index > 0)), y)
    with pytest.raises(ValueError, match="batch"):
        model.fit(X, y).predict(pd.DataFrame({"x": [1.0]}))
