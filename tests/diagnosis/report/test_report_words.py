"""The words of a report for scores, weights and numbers."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

import hybridsurrogate as hs
from hybridsurrogate import digits
from hybridsurrogate.diagnosis.checks.emulator import EmulatorCheck
from hybridsurrogate.diagnosis.report import findings, scores, trust
from hybridsurrogate.diagnosis.report.view import label_of_cause
from hybridsurrogate.diagnosis.validation.gain import FoldGain, Gain


def scan_of(before, after, error=0.1):
    scores = {"before": before, "after": after, "before_error": error, "after_error": error}
    return pd.DataFrame({"beta": [0.05, 0.5, 0.95], **scores})


@pytest.mark.parametrize(
    ("after", "words"),
    [
        ([-1.0, -0.8, -0.3], "deserves more weight"),
        ([-1.0, -0.3, -0.8], "does not raise the weight"),
        ([-0.3, -0.8, -1.0], "less weight than before"),
    ],
)
def test_what_the_best_beta_says(after, words):
    scan = scan_of([-0.9, -0.5, -1.2], after)
    extended, plain = SimpleNamespace(extended=True), SimpleNamespace(extended=False)
    assert words in trust.trust(extended, scan, None)[-1]
    within, beyond = trust.trust(plain, scan, scan)[1:]
    assert "Within the measured range the best is beta = 0.5" in within
    assert "Beyond it the best is beta = 0.5" in beyond
    unsure = scan_of([-0.9, -0.5, -1.2], after, error=0.4)
    same = after.index(max(after)) == 1
    told = trust.trust(extended, unsure, None)[-1]
    assert ("as good within the errors" in told) is not same


def gain_of(difference, error, coverage=0.9, kinds=("step", "step")):
    folds = tuple(FoldGain(kind, 50, -1.0, -1.0 + difference, error) for kind in kinds)
    return Gain(
        *(-1.0, -1.0 + difference, difference, error, 2.0, 1.5),
        *(0.9, coverage, 0.4, 0.55, 100, kinds, folds),
    )


@pytest.mark.parametrize(
    ("difference", "error", "words"),
    [
        (0.5, 0.1, "the extended model predicts better"),
        (0.15, 0.1, "seems to predict better, but by less than two"),
        (0.05, 0.1, "within its standard error"),
        (-0.05, 0.1, "within its standard error"),
        (-0.15, 0.1, "seems to predict worse, by less than two"),
        (-0.5, 0.1, "predicts worse: do not use it"),
        (0.0, 0.0, "changes nothing"),
        (0.5, np.nan, "too few rows"),
    ],
)
def test_what_a_difference_of_scores_amounts_to(difference, error, words):
    assert words in scores.judgement(gain_of(difference, error))


def view_of(gain, beyond=None, kinds="step"):
    diagnosis = SimpleNamespace(gain_=gain, gain_out_of_range_=beyond)
    return SimpleNamespace(extended=True, diagnosis=diagnosis, inputs=("t",), kinds=kinds)


def test_the_words_for_a_gain():
    text = " ".join(scores.gains(view_of(gain_of(0.512, 0.123)), None))
    assert "-1.00 before, -0.49 after, difference +0.51 ± 0.12 (standard error)" in text
    assert "2 before and 1.5 after, 25 % less" in text
    assert "The 50 % interval holds 40 % before and 55 % after" in text
    assert "as it should be, within chance" in text
    assert "Higher is better" in text
    assert "Beyond the measured range the gain was not measured" in text
    split = " ".join(scores.gains(view_of(gain_of(0.5, 0.1, 0.7, ("step", "bump"))), None))
    assert "it chose: step 1, bump 1" in split
    assert "Of these 2 searches 1 chose step" in split
    assert "too few: the uncertainty stated is too small" in split
    pair = gain_of(0.5, 0.1, kinds=("periodic + step", "step"))
    both = " ".join(scores.gains(view_of(pair, kinds="periodic + step"), None))
    assert "it chose: periodic + step 1, step 1" in both
    assert "Of these 2 searches 1 chose periodic + step" in both
    wide = " ".join(scores.gains(view_of(None), gain_of(0.5, 0.1, 1.0, ())))
    assert "On the rows held back (100 rows)" in wide
    assert "too many: the uncertainty stated is too large" in wide


def test_the_words_for_a_gain_beyond_the_measured_range():
    beyond = gain_of(-0.5, 0.1, kinds=("none", "bump"))
    text = " ".join(scores.gains(view_of(gain_of(0.5, 0.1), beyond), None))
    assert "the last 100 rows along t, in 2 parts, each foreseen from all rows before it" in text
    assert "predicts worse: do not use it for rows like these" in text
    assert "Of these 2 searches none chose step" in text
    assert "cannot be foreseen from those before them" in text


def test_the_words_for_what_runs_leave_open():
    estimator = SimpleNamespace(surrogate=hs.PolynomialChaos())
    check = EmulatorCheck(4e-7, 163.4, {"distance": 3, "t": 1})
    view = SimpleNamespace(diagnosis=SimpleNamespace(emulator_check_=check, estimator_=estimator))
    known, missed, beyond = scores.emulator(view)
    assert "(3 along distance, 1 along t)" in beyond
    assert "leave the simulation open by less than a thousandth of the noise, which" in known
    assert "misses what they tell by 163 times the noise there" in missed


def test_a_weight_that_takes_minutes_to_try_is_not_tried():
    costly = SimpleNamespace(extended=True, has_weight=True, weight_takes_minutes=True)
    assert "which takes minutes. beta_scan(X, y) does it" in trust.trust(costly, None, None)[0]
    quick = SimpleNamespace(extended=True, has_weight=True, weight_takes_minutes=False)
    assert "report(beta_scan=True) does it" in trust.trust(quick, None, None)[0]
    exact = SimpleNamespace(extended=True, has_weight=False)
    assert "There is no weight to choose" in trust.trust(exact, None, None)[0]


def test_digits():
    assert digits.interval(1898.34, 1896.71, 1899.31) == "1898.3 (1896.7 to 1899.3)"
    assert digits.interval(-243.1, -294.0, -192.6) == "-243 (-294 to -193)"
    assert digits.interval(0.0312, 0.0301, 0.0323) == "0.0312 (0.0301 to 0.0323)"
    assert digits.interval(2.0, 2.0, 2.0) == "2"
    assert digits.plus_minus(0.2503, 0.0664, sign=True) == "+0.250 ± 0.066"
    assert digits.plus_minus(-0.0001, 0.5) == "0.00 ± 0.50"
    assert digits.number(20.0) == "20"
    assert digits.number(0.0) == "0"
    assert digits.number(123456.0) == "123456"
    assert digits.number(1.5e-7) == "1.500e-07"
    assert digits.number(np.nan) == "unknown"
    assert [digits.percent(s) for s in (0, 1, 0.5, 0.0004, 0.052)] == [
        "0 %",
        "100 %",
        "50 %",
        "less than 0.1 %",
        "5.2 %",
    ]
    assert digits.probability(1.0) == "more than 99.9 %"
    assert digits.listing(["a", "b", "c"]) == "a, b and c"


def test_forms_of_a_kind_have_words_of_their_own():
    view = SimpleNamespace(output="mass", inputs=("t",), log_scale=False)
    causes = {
        "gap between measured and simulated mass grows steadily over t": hs.Trend("t"),
        "is a parabola over t": hs.Trend("t", degree=2),
        "an amount of its own for each value of batch": hs.MissingInput(
            "batch", shape="categorical"
        ),
        "mass is off where batch has one of its values": hs.MissingInput(
            "batch", shape="categorical", level=3
        ),
        "the columns a and b act together": hs.Interaction("a", "b"),
        "the parameter rate changes over t": hs.ParameterDrift("rate", "t", "logistic"),
        "what prey does to itself and to others comes later": hs.DynamicDelay("prey"),
        "something drives prey up and down": hs.DynamicTerm("prey", "seasonal"),
        "prey gains or loses something": hs.DynamicTerm("prey", "proportional"),
    }
    for words, cause in causes.items():
        finding = SimpleNamespace(kind=cause.kind, target=cause.target)
        (sentence,) = findings._meaning(view, finding, cause)
        assert words in sentence
    assert label_of_cause(None) == "nothing is wrong"
    assert label_of_cause(hs.ParameterDrift("rate", "t", "step")) == (
        "parameter-drift of rate (step over t)"
    )


@pytest.mark.slow
def test_where_under_a_log_normal_likelihood():
    """In squares of the raw output it would be wherever the output is large."""
    t = np.linspace(0.2, 12, 60)
    simulator = hs.Simulator(
        lambda t, a, k: a * np.exp(-k * t),
        inputs={"t": (0, 12)},
        parameters={
            "a": hs.truncated_normal(50, 5, 30, 70),
            "k": hs.truncated_normal(1, 0.02, 0, 2),
        },
        output="activity",
    )
    rng = np.random.default_rng(0)
    y = 50 * np.exp(-t + 0.5 * (t > 8) + 0.1 * rng.standard_normal(60))
    model = hs.PowerScaledSurrogate(
        simulator,
        surrogate=hs.ExactSurrogate(),
        likelihood="lognormal",
        n_draws=300,
        random_state=0,
    )
    found = hs.DiscrepancyDiagnosis(model, cv=None, random_state=0).fit(t[:, None], y)
    assert found.best_cause_.kind == "step"
    report = found.report()
    last = max(report.to_dict()["discrepancy"]["thirds"], key=lambda third: third["low"])
    # before, the decay bent to meet the jump; in raw squares a factor of e^-8 leaves nothing here
    assert last["share"] > 0.3
    assert "(root mean square, in units of log activity)" in " ".join(str(report).split())
