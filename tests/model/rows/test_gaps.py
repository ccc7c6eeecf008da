"""Rows without a measurement of one output: they are left out, with a warning of how many."""

from __future__ import annotations

import warnings

import numpy as np
import pandas as pd
import pytest
from sklearn.model_selection import GridSearchCV

import hybridsurrogate as hs
from hybridsurrogate.effects.registry import kinds
from hybridsurrogate.scoring import SCORERS

GAPS = [3, 4, 20]
SAID = r"3 of 32 rows have no measurement \(y is NaN\) and were left out, the first is row 4"
CLASSES = [
    hs.PowerScaledSurrogate,
    hs.PredictiveWeightedSurrogate,
    hs.KennedyOHaganSurrogate,
    lambda simulation, **options: hs.MultiSourceSurrogate([hs.Source(simulation)], **options),
]


def settings():
    return {"surrogate": hs.PolynomialChaos(2), "n_draws": 200, "random_state": 0}


@pytest.fixture
def gaps(measured):
    """The fall with three gaps, and the same without these rows."""
    X, y = measured
    there = np.ones(32, dtype=bool)
    there[GAPS] = False
    return X, np.where(there, y, np.nan), there


@pytest.mark.parametrize("of", CLASSES)
def test_a_gap_is_a_row_that_is_not_there(simulation, gaps, of):
    X, y, there = gaps
    with pytest.warns(hs.MissingMeasurementWarning, match=SAID) as said:
        model = of(simulation, **settings()).fit(X, y)
    assert len(said) == 1
    without = of(simulation, **settings()).fit(X[there], y[there])
    np.testing.assert_allclose(model.predict(X), without.predict(X))
    assert len(model.loo().pointwise) == 29


@pytest.mark.parametrize("form", ["list", "series", "nullable", "frame of another kind"])
def test_gaps_are_found_in_every_form_of_y(simulation, gaps, form):
    X, y, there = gaps
    forms = {
        "list": (X.tolist(), [None if np.isnan(value) else value for value in y]),
        "series": (pd.DataFrame({"t": X[:, 0]}), pd.Series(y, index=range(100, 132))),
        "nullable": (X, pd.Series(pd.array(y, dtype="Float64"))),
    }
    if form not in forms:
        polars = pytest.importorskip("polars")
        forms[form] = polars.DataFrame({"t": X[:, 0]}), polars.Series(y)
    with pytest.warns(hs.MissingMeasurementWarning, match=SAID):
        model = hs.PowerScaledSurrogate(simulation, **settings()).fit(*forms[form])
    np.testing.assert_array_equal(model.measured_[1], y[there])


def test_weights_go_with_their_rows(simulation, gaps):
    X, y, there = gaps
    weights = np.linspace(0, 2, 32)
    with pytest.warns(hs.MissingMeasurementWarning):
        model = hs.PowerScaledSurrogate(simulation, **settings()).fit(X, y, weights)
    without = hs.PowerScaledSurrogate(simulation, **settings())
    without.fit(X[there], y[there], weights[there])
    np.testing.assert_allclose(model.predict(X), without.predict(X))


def test_a_row_without_a_measurement_may_lack_its_inputs_too(simulation, gaps):
    """A line of a file that has nothing but a name."""
    X, y, there = gaps
    frame = pd.DataFrame({"t": np.where(there, X[:, 0], np.nan)})
    with pytest.warns(hs.MissingMeasurementWarning, match=SAID):
        model = hs.PowerScaledSurrogate(simulation, **settings()).fit(frame, y)
    assert len(model.measured_[1]) == 29


def test_scores_are_of_what_was_measured(fitted, gaps):
    X, y, there = gaps
    told = fitted.log_predictive_density(X, y)
    assert np.flatnonzero(np.isnan(told)).tolist() == GAPS
    np.testing.assert_allclose(told[there], fitted.log_predictive_density(X[there], y[there]))
    assert fitted.score(X, y) == pytest.approx(fitted.score(X[there], y[there]))
    weights = np.linspace(1, 2, 32)
    weighted = fitted.score(X[there], y[there], weights[there])
    assert fitted.score(X, y, weights) == pytest.approx(weighted)
    (inside,) = fitted.interval_holds(X, y)
    assert np.flatnonzero(np.isnan(inside)).tolist() == GAPS
    for name, scorer in SCORERS.items():
        # this one draws: 1000 values a row, other ones for other rows
        error = 0.02 if name == "neg_crps" else 1e-9
        expected = scorer(fitted, X[there], y[there])
        assert scorer(fitted, X, y) == pytest.approx(expected, abs=error)


def test_beta_is_chosen_with_gaps(simulation, gaps):
    X, y, there = gaps
    model = hs.PowerScaledSurrogate(simulation, **settings())
    with pytest.warns(hs.MissingMeasurementWarning, match=SAID) as said:
        chosen = hs.choose_beta(model, X, y, betas=[0.2, 0.8], cv=3)
    assert len([one for one in said if one.category is hs.MissingMeasurementWarning]) == 1
    without = hs.choose_beta(model, X[there], y[there], betas=[0.2, 0.8], cv=3)
    np.testing.assert_allclose(chosen.table["elpd"], without.table["elpd"])
    with pytest.warns(hs.MissingMeasurementWarning):
        search = GridSearchCV(model, {"beta": [0.2, 0.8]}, cv=3).fit(X, y)
    assert np.isfinite(search.cv_results_["mean_test_score"]).all()


def test_nothing_measured_is_refused(simulation, fitted, gaps):
    X, y, _ = gaps
    nothing = np.full(32, np.nan)
    match = "Input y contains NaN alone: no row has a measurement"
    for call in (
        lambda: hs.PowerScaledSurrogate(simulation).fit(X, nothing),
        lambda: fitted.score(X, nothing),
    ):
        with pytest.raises(ValueError, match=match):
            call()
    with pytest.raises(ValueError, match="Input y contains infinity"):
        hs.PowerScaledSurrogate(simulation).fit(X, np.where(np.isnan(y), np.inf, y))


def test_a_diagnosis_with_gaps_is_that_without_their_rows(simulator, gaps):
    X, y, there = gaps
    model = hs.PowerScaledSurrogate(simulator, hs.ExactSurrogate(), n_draws=200, random_state=0)
    exclude = sorted({*kinds()} - {"trend", "offset"})

    def diagnosed(X, y):
        # folds: they get rows of the tables that were given
        diagnosis = hs.DiscrepancyDiagnosis(
            model, exclude=exclude, cv=2, n_replicates=19, random_state=0
        )
        return diagnosis.fit(X, y)

    frame = pd.DataFrame({"t": X[:, 0]})
    with pytest.warns(hs.MissingMeasurementWarning, match=SAID) as said:
        found = diagnosed(frame, y)
    assert len([one for one in said if one.category is hs.MissingMeasurementWarning]) == 1
    without = diagnosed(frame[there], y[there])
    pd.testing.assert_frame_equal(found.causes_, without.causes_)
    assert found.gain_.n_rows == without.gain_.n_rows == 29
    # what is asked of it later
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        report = found.report(test=(frame, y))
        gain = found.gain_on(frame, y)
    assert "the rows that you held out" in " ".join(str(report).split())
    assert gain.n_rows == 29
    with pytest.warns(hs.MissingMeasurementWarning, match=SAID):
        told = found.update(frame, y)
    assert len(told.table) <= 29
    assert np.isfinite(told.table["y"]).all()
