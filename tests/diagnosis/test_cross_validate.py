"""The gain measured after the verdict was read is that which `fit` would have measured."""

import numpy as np
import pandas as pd
import pytest
from sklearn.exceptions import NotFittedError

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.fitting import diagnose as module
from hybridsurrogate.effects.registry import kinds

FEW = sorted({*kinds()} - {"offset", "trend"})
T = np.linspace(0, 4, 24)
X = pd.DataFrame({"t": T})
Y = 2 * T + 1.5 + 0.3 * np.random.default_rng(0).standard_normal(24)


def line(t, slope):
    return slope * t


def diagnosis(**settings):
    simulator = hs.Simulator(
        line, inputs={"t": (0, 4)}, parameters={"slope": hs.truncated_normal(2, 0.2, 1, 3)}
    )
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=100, random_state=0
    )
    settings = {"exclude": FEW, "n_replicates": 50, "random_state": 0} | settings
    return hs.DiscrepancyDiagnosis(model, **settings)


def pointwise(fitted):
    gains = fitted.gain_, fitted.gain_out_of_range_
    return [(one.elpd_before, one.elpd_after, one.rmse_before, one.rmse_after) for one in gains]


def test_the_gain_is_the_same_in_fit_and_after_it():
    whole = diagnosis(cv=3).fit(X, Y)
    searched = diagnosis(cv=None).fit(X, Y)
    assert searched.gain_ is None
    # the search is what was fitted, whatever is set until the folds are run
    searched.set_params(exclude=(), max_causes=3, random_state=7, estimator__n_draws=10)
    assert searched.cross_validate(3) is searched
    np.testing.assert_allclose(pointwise(searched), pointwise(whole), rtol=1e-9)
    # once more: the folds are drawn anew from the same state
    np.testing.assert_allclose(pointwise(searched.cross_validate(3)), pointwise(whole), rtol=1e-9)


def test_folds_that_are_no_folds():
    fitted = diagnosis(cv=None).fit(X, Y)
    for cv, error in ((1, ValueError), (2.5, TypeError), (None, TypeError)):
        with pytest.raises(error, match="cv"):
            fitted.cross_validate(cv)
    assert fitted.gain_ is None


def test_nothing_is_cross_validated_before_a_fit():
    with pytest.raises(NotFittedError):
        diagnosis().cross_validate()


def test_an_interrupt_leaves_the_gain_that_was_there(monkeypatch):
    fitted = diagnosis(cv=None).fit(X, Y).cross_validate(2)
    gain = fitted.gain_

    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(module, "cross_validated", interrupt)
    with (
        pytest.warns(hs.DiagnosisWarning, match="folds of the diagnosis were interrupted"),
        pytest.raises(KeyboardInterrupt),
    ):
        fitted.cross_validate(3)
    assert fitted.gain_ is gain
