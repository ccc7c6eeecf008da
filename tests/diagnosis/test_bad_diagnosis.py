"""What a diagnosis cannot work with is told before its search."""

import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm, uniform
from sklearn.base import clone

import hybridsurrogate as hs
from hybridsurrogate.effects.base import Context
from hybridsurrogate.effects.registry import kinds

SIMULATOR = hs.Simulator(lambda t, a: a * t, {"t": (0, 10)}, {"a": hs.truncated_normal(3, 1, 0, 6)})
T = np.linspace(0, 10, 20)
Y = 2 * T + 0.1 * np.random.default_rng(0).standard_normal(20)
MODEL = hs.PowerScaledSurrogate(SIMULATOR, surrogate=hs.ExactSurrogate(), random_state=0)


@pytest.mark.parametrize("causes", [hs.Offset(), [3], ["trend"], [hs.Trend]], ids=repr)
def test_causes_that_are_none(causes):
    diagnosis = hs.DiscrepancyDiagnosis(MODEL, causes=causes)
    with pytest.raises(TypeError, match=r"causes must be a sequence of causes such as"):
        diagnosis.fit(T[:, None], Y)


def test_a_measured_column_that_is_called_like_a_parameter():
    X = pd.DataFrame({"t": T, "a": np.cos(T)})
    with pytest.raises(ValueError, match=r"columns \['a'\] are called like parameters .* rename"):
        hs.DiscrepancyDiagnosis(MODEL).fit(X, Y)


class Own(hs.Cause):
    kind = "own"
    target = "t"
    parameters = {"rate": uniform(0, 1)}
    coefficients = ("amplitude",)


class NaNFarOut(Own):
    def columns(self, X, theta):
        return np.where(theta["rate"] > 0.8, np.nan, X["t"])[:, None]


class HalfOfInputs(Own):
    def columns(self, X, theta):
        return X["t"][:, None]

    def inputs(self, X, omega, theta):
        return X


class Raises(Own):
    def columns(self, X, theta):
        raise RuntimeError("no table")


@pytest.mark.parametrize(
    ("cause", "match"),
    [
        (NaNFarOut(), r"own.* NaN or infinity from columns: .* 5 or 95 %"),
        (HalfOfInputs(), r"own.* must return two mappings from inputs"),
        (Raises(), r"own.* failed in columns: RuntimeError: no table"),
    ],
)
def test_causes_of_ones_own_that_are_broken(cause, match):
    with pytest.raises(ValueError, match=match):
        hs.DiscrepancyDiagnosis(MODEL, causes=[cause]).fit(T[:, None], Y)
    with pytest.raises(ValueError, match=match):
        clone(MODEL).set_params(effects=(cause,)).fit(T[:, None], Y)


OVERRIDDEN = [
    (hs.Delay, ("t",)),
    (hs.Gain, ()),
    (hs.WrongConstant, ("g",)),
    (hs.ParameterDrift, ("a", "t")),
    (hs.MissingInput, ("day",)),
    (hs.Interaction, ("t", "day")),
    (hs.NoiseOfMean, ()),
    (hs.Outliers, ()),
    (hs.Step, ("t",)),
    (hs.Decay, ("t",)),
    (hs.Noise, ("t",)),
    (hs.Autocorrelation, ("t",)),
    (hs.GaussianProcessDiscrepancy, ()),
]


@pytest.mark.parametrize(("kind", "arguments"), OVERRIDDEN, ids=lambda value: str(value))
def test_a_cause_that_overrides_one_of_the_catalogue_stays_itself(kind, arguments):
    class Mine(kind):
        pass

    context = Context(
        {"t": T, "day": T % 3}, 1, {"a": norm(3, 1)}, {"g": hs.Assumed(9.8, norm(9.8, 1))}, 1.0
    )
    assert type(Mine(*arguments).prepare(context)) is Mine


@pytest.fixture(scope="module")
def fitted():
    few = [kind for kind in kinds() if kind != "offset"]
    diagnosis = hs.DiscrepancyDiagnosis(
        MODEL, exclude=few, cv=None, n_replicates=19, random_state=0
    )
    return diagnosis.fit(T[:, None], Y)


@pytest.mark.parametrize(
    ("method", "given", "words"),
    [
        ("report", {"test": 2.5}, r"test must be a pair \(X_test, y_test\), got 2.5"),
        ("plot", {"test": {"X": T, "y": Y}}, r"test must be a pair \(X_test, y_test\)"),
        ("report", {"beta_scan": pd.Timestamp("2020")}, "beta_scan must be True or False"),
        ("report", {"full": "yes"}, "full must be True or False"),
        ("beta_scan", {"out_of_range": pd.DataFrame()}, "out_of_range must be True or False"),
        ("beta_scan", {"betas": ["a"]}, "betas must hold numbers"),
        ("next_measurements", {"cost": set()}, "cost must hold numbers"),
    ],
)
def test_what_a_fitted_diagnosis_is_asked(fitted, method, given, words):
    with pytest.raises((TypeError, ValueError), match=words):
        getattr(fitted, method)(**given)
