"""One story from end to end: runs, measurements, a hidden cause, the report."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import halfnorm, norm
from sklearn.model_selection import GridSearchCV

import hybridsurrogate as hs
from hybridsurrogate.datasets import load_mauna_loa_co2, load_nile, make_log_sin
from hybridsurrogate.scoring import rmse


@pytest.fixture(scope="module")
def story():
    case = make_log_sin(random_state=3)
    model = hs.PowerScaledSurrogate(
        case.simulation,
        surrogate=hs.PolynomialChaos(degree=5, coefficient_prior=norm(0, 5)),
        noise_prior=halfnorm(scale=0.5),
        beta=0.5,
        n_draws=500,
        random_state=0,
    )
    diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, random_state=0).fit(case.X, case.y)
    return case, model, diagnosis


def test_the_simulation_is_found_wrong_and_the_cause_is_named(story):
    _, _, diagnosis = story
    assert diagnosis.p_value_ < 0.01
    assert diagnosis.best_cause_.kind == "periodic"
    low, high = diagnosis.best_cause_.estimates["period"][1:]
    assert low < 2 * np.pi / 0.05 < high


def test_the_extension_beats_every_weight_on_the_whole_range(story):
    case, model, diagnosis = story
    X = np.vstack([case.X_in, case.X_out])
    y = np.concatenate([case.y_in, case.y_out])
    mu = np.concatenate([case.mu_in, case.mu_out])
    search = GridSearchCV(model, {"beta": [0.0, 0.1, 0.3, 0.5, 0.9, 1.0]}, cv=3)
    search.fit(case.X, case.y)
    extended = diagnosis.extended_estimator_
    for weighted in (model.set_params(beta=b).fit(case.X, case.y) for b in (0.0, 0.5, 1.0)):
        assert extended.score(X, y) > weighted.score(X, y)
    assert extended.score(X, y) > search.best_estimator_.score(X, y)
    best = rmse(search.best_estimator_.sample_predictive_mean(X), mu)
    assert rmse(extended.sample_predictive_mean(X), mu) < best
    # each draw of the average is of one explanation; those of the cause that was hidden are nearest
    named = extended.estimators_[0]
    assert rmse(named.sample_predictive_mean(X), mu) < 0.75 * best


@pytest.mark.slow
def test_the_gain_is_reported(story, tmp_path):
    case, _, diagnosis = story
    diagnosis.cross_validate(5)
    assert diagnosis.gain_.elpd_difference > 0
    report = diagnosis.report(test=(case.X_out, case.y_out))
    # 30 rows hold 0.8 of a period, which a smooth curve imitates: both are said
    assert "periodic" in report.headline
    assert any(
        "periodic" in e.name
        for one in diagnosis.extended_estimator_.estimators_
        for e in one.effects
    )
    report.save(tmp_path / "report.html")
    assert (tmp_path / "report.html").stat().st_size > 10_000


@pytest.mark.slow
def test_the_seasons_of_mauna_loa():
    co2 = load_mauna_loa_co2()
    model = hs.PowerScaledSurrogate(
        co2.simulator, surrogate=hs.ExactSurrogate(), n_draws=300, random_state=0
    )
    diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, random_state=0).fit(co2.data, co2.target)
    # years differ by more than their seasons: El Nino and others stay in what is left
    assert diagnosis.verdict_ == "nearest"
    assert diagnosis.best_cause_.kind == "periodic"
    assert diagnosis.best_cause_.estimates["period"][0] == pytest.approx(1.0, abs=0.01)


def test_the_step_of_the_nile():
    nile = load_nile()
    model = hs.PowerScaledSurrogate(
        nile.simulator, surrogate=hs.ExactSurrogate(), n_draws=300, random_state=0
    )
    diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, random_state=0).fit(nile.data, nile.target)
    assert diagnosis.verdict_ == "named"
    assert diagnosis.best_cause_.kind == "step"
    assert diagnosis.best_cause_.estimates["location"][0] == pytest.approx(1898, abs=2)
