"""The words of a report for scores, weights and numbers."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.answers.finding import CauseFinding
from hybridsurrogate.diagnosis.checks.simulation import EmulatorCheck
from hybridsurrogate.diagnosis.report import headline
from hybridsurrogate.diagnosis.report.details import checks, gain
from hybridsurrogate.diagnosis.report.elements.view import View, label_of_cause
from hybridsurrogate.diagnosis.validation.gain import FoldGain, HeldOutGain
from hybridsurrogate.effects.registry import FORMS
from hybridsurrogate.numerics import digits


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
    assert words in gain.weight(extended, scan, None)[-1]
    within, beyond = gain.weight(plain, scan, scan)[1:]
    assert "Within the measured range the best is beta = 0.5" in within
    assert "Beyond it the best is beta = 0.5" in beyond
    unsure = scan_of([-0.9, -0.5, -1.2], after, error=0.4)
    same = after.index(max(after)) == 1
    sentence = gain.weight(extended, unsure, None)[-1]
    assert ("as good within the errors" in sentence) is not same


def gain_of(difference, error, coverage=0.9, kinds=("step", "step")):
    folds = tuple(FoldGain(kind, 50, -1.0, -1.0 + difference, error) for kind in kinds)
    return HeldOutGain(
        *(-1.0, -1.0 + difference, difference, error, 2.0, 1.5),
        *(0.9, coverage, 0.4, 0.55, 100, kinds, folds),
    )


@pytest.mark.parametrize(
    ("difference", "error", "words"),
    [
        (0.5, 0.1, "the extended model predicts better"),
        (0.15, 0.1, "seems to predict better, by less than two"),
        (0.05, 0.1, "within its standard error"),
        (-0.05, 0.1, "within its standard error"),
        (-0.15, 0.1, "seems to predict worse, by less than two"),
        (-0.5, 0.1, "predicts worse: do not use it"),
        (0.0, 0.0, "changes nothing"),
        (0.5, np.nan, "too few rows"),
    ],
)
def test_what_a_difference_of_scores_amounts_to(difference, error, words):
    assert words in gain.judgement(gain_of(difference, error))


def view_of(units=()):
    return SimpleNamespace(
        extended=True, inputs=("t",), units=dict(units), output="mass", stacking=None
    )


def test_the_table_of_a_gain():
    table = gain.score_table(view_of({"mass": "mg"}), gain_of(0.512, 0.123)).set_index("")
    assert list(table.loc["log score a row"]) == ["-1.00", "-0.49", "+0.51 ± 0.12"]
    assert list(table.loc["error (RMSE, mg)"])[:2] == ["2", "1.5"]
    assert list(table.loc["covered by 50 % intervals"])[:2] == ["40 %", "55 %"]
    assert list(table.loc["covered by 90 % intervals"])[:2] == ["90 %", "90 %"]


def test_the_sentences_of_a_gain():
    split = gain_of(0.5, 0.1, 0.7, ("step", "bump"))
    beyond = gain_of(-0.5, 0.1, kinds=("none", "bump"))
    found = gain.section(view_of(), {"within": split, "beyond": beyond, "held out": None})
    text = " ".join(found.sentences)
    assert "Higher is better" in text
    assert "70 % cover the row, too few: they are too narrow" in text
    assert "its folds chose step (1) and bump (1)" in text
    assert "the last 100 rows along t, 2 blocks, each predicted from all rows before it" in text
    assert "predicts worse: do not use it for rows like these" in text
    alone = gain.section(view_of(), {"within": split, "beyond": None, "held out": None})
    assert "Beyond the measured range nothing was tested" in " ".join(alone.sentences)
    nothing = gain.section(view_of(), {"within": None, "beyond": None, "held out": None})
    assert "was not measured" in nothing.sentences[0]


def test_the_words_for_what_runs_leave_open():
    estimator = SimpleNamespace(surrogate_=hs.PolynomialChaos(), emulation_=None)
    check = EmulatorCheck(4e-7, 163.4, {"distance": 3, "t": 1}, 0.0, 0.0)
    view = SimpleNamespace(result=SimpleNamespace(emulator_check=check, before=estimator))
    known, missed, beyond = checks.emulator(view)
    assert "(3 along distance, 1 along t)" in beyond
    assert "leave the simulation uncertain by less than a thousandth of the noise, which" in known
    assert "differs from them by 163 times the noise there" in missed


def view_of_fit(n_coefficients, n_hyper=0):
    basis = SimpleNamespace(holds_runs=False, coefficient_mean=np.zeros(n_coefficients))
    model = SimpleNamespace(n_unknowns=2, n_hyper=n_hyper, basis=basis)
    posterior = SimpleNamespace(model=model, coefficients=np.zeros((1, n_coefficients)))
    fit = SimpleNamespace(posterior_=posterior)
    scans = SimpleNamespace(beta_scans=SimpleNamespace(models=(fit,)))
    return SimpleNamespace(extended=True, result=SimpleNamespace(before=fit, extension=scans))


def test_a_weight_that_takes_minutes_to_try_is_not_tried():
    costly, quick = view_of_fit(3, n_hyper=1), view_of_fit(3)
    assert "beta_scan(X, y) does it in minutes" in gain.weight(costly, None, None)[0]
    assert "report(beta_scan=True) does it in seconds" in gain.weight(quick, None, None)[0]
    assert gain.section_on_weights(view_of_fit(0), None, None) == ()


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


FOUND = {
    "mass rises against the simulation by 2.0 mg per h.": (hs.Trend("t"), {"slope": 2.0}),
    "The gap between mass and the simulation is a parabola over t.": (hs.Trend("t", degree=2), {}),
    "mass differs between the values of batch, which the simulation ignores.": (
        hs.MissingInput("batch", shape="categorical"),
        {},
    ),
    "mass is 2.0 mg below the simulation where batch is 3.": (
        hs.MissingInput("batch", shape="categorical", level=3),
        {"amplitude": -2.0},
    ),
    "The simulation misses that a and b act together on mass.": (hs.Interaction("a", "b"), {}),
    "rate changes over t, and the simulation keeps it constant.": (
        hs.ParameterDrift("rate", "t", "logistic"),
        {},
    ),
    "The simulation misses a cycle of mass: ±2.0 mg with a period of 7.0 h.": (
        hs.Periodic("t"),
        {"amplitude": 2.0, "period": 7.0},
    ),
    "At t = 7.0 mass falls by 2.0 mg, and the simulation does not.": (
        hs.Step("t"),
        {"location": 7.0, "amplitude": -2.0},
    ),
    "What prey does comes 2.0 h later than the equations have it.": (
        hs.DynamicDelay("prey"),
        {"lag": 2.0},
    ),
    "prey exchanges with a store that its equation leaves out, 2.0 times its size, over 3.0 h.": (
        hs.DynamicStore("prey"),
        {"ratio": 2.0, "scale": 3.0},
    ),
    "The term of loss acts on a store that exchanges with prey over 3.0 h, 2.0 times its size, "
    "and not on prey itself.": (
        hs.DynamicStore("prey", through="loss"),
        {"ratio": 2.0, "scale": 3.0},
    ),
    "mass jumps again and again over t, and each jump decays over 3.0 h.": (
        hs.RecurringJumps("t", places=(2.0, 7.0)),
        {"scale": 3.0},
    ),
    "The equation of prey misses a drive with a period of 7.0 h.": (
        hs.DynamicTerm("prey", "seasonal"),
        {"period": 7.0},
    ),
    "The equation of prey misses a loss in proportion to it, 2.0 per h.": (
        hs.DynamicTerm("prey", "proportional"),
        {"rate": -2.0},
    ),
}


@pytest.mark.parametrize("sentence", FOUND)
def test_each_form_has_a_headline(sentence):
    cause, means = FOUND[sentence]
    estimates = {name: (mean, mean - 0.3, mean + 0.3) for name, mean in means.items()}
    view = View(
        result_of("mass", ("t",), log_scale=False), units={"mass": "mg", "t": "h", "prey": "1"}
    )
    finding = CauseFinding(cause.kind, cause.target, "", 0.9, estimates)
    assert headline.sentence_of(view, finding, cause) == sentence


def test_on_a_logarithmic_scale_an_amplitude_is_a_factor():
    view = View(result_of("mass", ("t",), log_scale=True), units={"mass": "mg", "t": "h"})
    estimates = {"location": (7.0, 6.7, 7.3), "amplitude": (np.log(2), 0.6, 0.8)}
    finding = CauseFinding("step", "t", "", 0.9, estimates)
    sentence = headline.sentence_of(view, finding, hs.Step("t"))
    assert sentence == "At t = 7.0 mass rises by a factor of 2, and the simulation does not."


def test_one_alternative_more_than_are_listed_is_one_other():
    shares = {"step": 0.4, "ramp": 0.2, "trend": 0.2, "bump": 0.1, "gain": 0.05}
    result = SimpleNamespace(
        conclusion=SimpleNamespace(verdict="ambiguous", concerns="simulation"),
        indistinguishable=tuple(shares),
    )
    view = SimpleNamespace(
        result=result,
        findings=[(CauseFinding("step", "t", "", 0.4, {}), hs.Step("t"))],
        search=SimpleNamespace(kind_shares=shares),
    )
    assert headline.headline(view).endswith("how: step, ramp, trend, bump or one other.")


@pytest.mark.parametrize(
    ("log_scale", "units", "size"),
    [
        (False, {}, "0.044 per unit of year"),
        (True, {}, "a factor of 1.04 per unit of year"),
        (True, {"year": "a"}, "a factor of 1.04 per a"),
    ],
)
def test_a_slope_is_per_unit_of_its_column(log_scale, units, size):
    view = View(result_of("disasters", ("year",), log_scale), units=units)
    estimates = {"location": (1878.0, 1868.0, 1886.0), "slope": (-0.044, -0.049, -0.039)}
    finding = CauseFinding("ramp", "year", "", 0.9, estimates)
    sentence = headline.sentence_of(view, finding, hs.Ramp("year"))
    assert sentence.endswith(f"disasters falls below the simulation by {size}.")


def test_every_form_has_a_headline_of_its_own_or_of_its_kind():
    kinds = {form.kind for form in FORMS.values() if form.headline}
    assert {form.kind for form in FORMS.values()} <= kinds
    assert label_of_cause(None) == "nothing is wrong"
    assert label_of_cause(hs.ParameterDrift("rate", "t", "step")) == (
        "parameter-drift of rate (step over t)"
    )


def result_of(output, inputs, log_scale):
    """Return as much of a result as a headline reads."""
    simulation = SimpleNamespace(outputs=(output,), input_names=inputs)
    problem = SimpleNamespace(stacking=None, likelihood=SimpleNamespace(log_scale=log_scale))
    return SimpleNamespace(
        before=SimpleNamespace(simulation=simulation), search=SimpleNamespace(problem=problem)
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
    text = " ".join(str(found.report(full=True)).split())
    assert "in log activity (root mean square)" in text
