"""The diagnosis as its user meets it: attributes, verdicts, bad input."""

from __future__ import annotations

import warnings

import numpy as np
import pandas as pd
import pytest
from few_kinds import all_but
from scipy.stats import halfnorm, norm, uniform
from sklearn.base import clone
from sklearn.exceptions import DataConversionWarning

import hybridsurrogate as hs
from hybridsurrogate.scoring import SCORERS


def cooling(t, start, rate, ambient):
    return ambient + start * np.exp(-rate * t)


@pytest.fixture(scope="module")
def simulator():
    return hs.Simulator(
        cooling,
        inputs={"t": (0, 20)},
        parameters={
            "start": hs.truncated_normal(60, 10, 20, 100),
            "rate": hs.truncated_normal(0.3, 0.1, 0.05, 0.8),
        },
        assumed={"ambient": hs.Assumed(20.0, norm(20, 4))},
        output="temperature",
    )


def exact(simulator, **settings):
    return hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), random_state=0, n_draws=400, **settings
    )


def measure(effect, seed=0, n=40, noise=0.5):
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 12, n)
    y = cooling(t, 63.0, 0.25, 20.0) + effect(t) + noise * rng.standard_normal(n)
    return t[:, None], y


@pytest.fixture(scope="module")
def periodic(simulator):
    X, y = measure(lambda t: 2 * np.sin(2 * np.pi * t / 3.1))
    return hs.DiscrepancyDiagnosis(exact(simulator), random_state=0).fit(X, y)


@pytest.mark.slow
def test_a_column_of_outputs_is_flattened(simulator):
    X, y = measure(lambda t: 2 * np.sin(2 * np.pi * t / 3.1))
    column = y[:, None]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DataConversionWarning)  # as scikit-learn says
        model = hs.DiscrepancyDiagnosis(exact(simulator), cv=3, random_state=0).fit(X, column)
        gain = model.gain_on(X, column)
        report = model.report(test=(X, column))
        scores = [scorer(model.extended_estimator_, X, column) for scorer in SCORERS.values()]
    assert model.gain_.n_rows == 40
    assert gain.elpd_difference == model.gain_on(X, y).elpd_difference
    assert "periodic" in str(report)
    assert scores == [scorer(model.extended_estimator_, X, y) for scorer in SCORERS.values()]


def test_every_attribute_of_a_named_cause(periodic):
    assert periodic.verdict_ == "named"
    assert periodic.p_value_ == pytest.approx(1 / 201)
    best = periodic.best_cause_
    assert (best.kind, best.target) == ("periodic", "t")
    mean, low, high = best.estimates["period"]
    assert low < 3.1 < high
    assert low < mean < high
    assert best.estimates["amplitude"][0] == pytest.approx(2, abs=0.3)
    assert best.probability > 0.9
    assert "cos" in best.formula
    assert periodic.indistinguishable_ == ["periodic"]
    assert periodic.causes_["kind"].iloc[0] == "periodic"
    assert periodic.causes_["probability"].is_monotonic_decreasing
    assert periodic.causes_["probability"].sum() == pytest.approx(1)
    assert periodic.extended_estimator_.effects[0].kind == "periodic"


def test_the_gain_is_paired_and_repeats_the_search(periodic):
    gain = periodic.gain_
    assert gain.n_rows == 40
    assert gain.kinds == ("periodic",) * 5
    assert gain.elpd_difference == pytest.approx(gain.elpd_after - gain.elpd_before)
    assert gain.elpd_difference > 3 * gain.standard_error
    assert gain.rmse_after < 0.5 * gain.rmse_before
    assert 0.75 <= gain.coverage_after <= 1


def test_gain_on_rows_beyond_the_measured_ones(periodic):
    t = np.linspace(12.5, 20, 30)
    truth = cooling(t, 63.0, 0.25, 20.0) + 2 * np.sin(2 * np.pi * t / 3.1)
    y = truth + 0.5 * np.random.default_rng(1).standard_normal(30)
    gain = periodic.gain_on(t[:, None], y)
    assert gain.rmse_after < 0.6 * gain.rmse_before
    assert gain.kinds == ()


def test_a_scan_of_beta_scores_both_models_on_the_same_folds(periodic):
    X, y = measure(lambda t: 2 * np.sin(2 * np.pi * t / 3.1))
    scan = periodic.beta_scan(X, y, (0.25, 0.5))
    assert list(scan.columns) == ["beta", "before", "after", "before_error", "after_error"]
    assert list(scan["beta"]) == [0.25, 0.5]
    # with the wave named, held-out rows are foreseen better at any weight
    assert (scan["after"] > scan["before"] + 0.5).all()


def test_a_simulation_that_is_itself_run_has_no_weight(periodic):
    assert periodic.beta_scan() is None
    assert periodic.beta_scans_.best_beta_before() is None


def test_predict_and_score_are_those_of_the_extended_estimator(periodic):
    X = [[1.0], [7.0]]
    np.testing.assert_array_equal(periodic.predict(X), periodic.extended_estimator_.predict(X))
    y = [70.0, 31.0]
    assert periodic.score(X, y) == periodic.extended_estimator_.score(X, y)


def test_the_extension_weighs_causes_by_their_probabilities(simulator):
    # half a wave: several kinds draw it
    X, y = measure(lambda t: 2 * np.sin(2 * np.pi * t / 26))
    few = all_but("periodic", "bump", "trend", "ramp", "gain", "offset")
    settings = {"exclude": few, "cv": None, "n_replicates": 39}
    diagnosis = hs.DiscrepancyDiagnosis(exact(simulator), **settings, random_state=0).fit(X, y)
    average = diagnosis.extended_estimator_
    assert isinstance(average, hs.AveragedSurrogate)
    n = len(average.estimators_)
    assert n > 1
    shares = diagnosis.causes_["probability"].to_numpy()
    assert (shares[1:n] >= 0.05).all()
    assert (shares[n:] < 0.05).all()
    np.testing.assert_allclose(average.weights_, shares[:n] / shares[:n].sum())
    assert average.effects[0].kind == diagnosis.best_cause_.kind
    assert average.posterior_ is average.estimators_[0].posterior_
    # so that beyond the data a wrong name costs no more than its share
    t = np.linspace(12.5, 20, 30)
    y = cooling(t, 63.0, 0.25, 20.0)
    named = average.estimators_[0].log_predictive_density(t[:, None], y)
    mixed = average.log_predictive_density(t[:, None], y)
    assert (mixed >= named + np.log(average.weights_[0]) - 1e-9).all()
    gain = diagnosis.gain_on(t[:, None], y)
    assert gain.elpd_after == pytest.approx(mixed.mean())


def test_the_extended_simulator_runs_and_equals_the_estimator(periodic, simulator):
    extended = periodic.extended_simulator_
    assert {"start", "rate", "period", "sine", "cosine"} == set(extended.parameter_names)
    posterior = periodic.extended_estimator_.posterior_
    X = np.array([[0.5], [9.0], [15.0]])
    eta, _ = posterior.eta(X)
    draw = np.concatenate([posterior.values[7, :3], posterior.effect_coefficients[7, :2]])
    told = extended(X, np.tile(draw, (3, 1)))
    np.testing.assert_allclose(told[:2], eta[7, :2])
    # beyond the measured range the estimator is less sure than its formula
    assert told[2] != pytest.approx(eta[7, 2])
    assert extended.run(16, random_state=0).n_runs == 16


def test_the_band_excludes_zero_where_the_simulation_is_wrong(periodic):
    band = periodic.discrepancy_
    t = band.grid[:, 0]
    assert t.min() == 0
    assert t.max() == 12
    truth = 2 * np.sin(2 * np.pi * t / 3.1)
    peaks = np.abs(truth) > 1.8
    assert np.mean(np.sign(band.mean[peaks]) == np.sign(truth[peaks])) > 0.9
    assert band.share_outside > 0.5


def test_the_next_measurement_lies_in_the_simulated_range(periodic):
    assert 0 <= periodic.next_measurement_["t"] <= 20


def test_nothing_hidden_is_adequate(simulator):
    X, y = measure(lambda t: 0 * t, seed=3)
    diagnosis = hs.DiscrepancyDiagnosis(exact(simulator), cv=None, random_state=0).fit(X, y)
    assert diagnosis.verdict_ == "adequate"
    assert diagnosis.best_cause_.kind == "none"
    assert diagnosis.p_value_ > 0.05
    assert diagnosis.extended_estimator_ is diagnosis.estimator_
    assert diagnosis.extended_simulator_ is None
    assert diagnosis.gain_ is None


def test_a_constant_that_is_added_cannot_be_told_from_an_offset(simulator):
    rng = np.random.default_rng(5)
    t = np.linspace(0, 18, 60)
    y = cooling(t, 63.0, 0.25, 27.0) + 0.3 * rng.standard_normal(60)
    settings = {"cv": None, "n_replicates": 39, "random_state": 0}
    diagnosis = hs.DiscrepancyDiagnosis(exact(simulator), **settings).fit(t[:, None], y)
    assert {"wrong-constant", "offset"} <= set(diagnosis.indistinguishable_)
    assert diagnosis.verdict_ == "ambiguous"
    model = exact(simulator, effects=(hs.WrongConstant("ambient"),)).fit(t[:, None], y)
    low, high = np.quantile(model.posterior_.estimates(0)["value"], [0.01, 0.99])
    assert low < 27.0 < high


def test_a_missing_input_by_name(simulator):
    X, y = measure(lambda t: 0 * t)
    wind = np.random.default_rng(2).standard_normal(40)
    frame = pd.DataFrame({"wind": wind, "t": X[:, 0]})
    few = all_but("missing-input", "trend", "step", "noise")
    settings = {"exclude": few, "cv": None, "n_replicates": 39, "random_state": 0}
    diagnosis = hs.DiscrepancyDiagnosis(exact(simulator), **settings).fit(frame, y + 1.5 * wind)
    assert (diagnosis.best_cause_.kind, diagnosis.best_cause_.target) == ("missing-input", "wind")
    _, low, high = diagnosis.best_cause_.estimates["slope"]
    assert low < 1.5 < high
    assert diagnosis.extended_simulator_.input_names == ("t", "wind")
    # without the column there is nothing to weigh, and the table says so
    bare = hs.DiscrepancyDiagnosis(exact(simulator), **settings).fit(X, y)
    row = bare.causes_[bare.causes_["kind"] == "missing-input"].iloc[0]
    assert "no measured column" in row["note"]


class Leak(hs.Cause):
    kind = "leak"
    target = "t"
    parameters = {"rate": halfnorm(scale=1.0)}
    coefficients = ("amplitude",)

    def columns(self, X, theta):
        return (1 - np.exp(-theta["rate"] * X["t"] ** 2))[:, None]


@pytest.mark.slow
def test_kinds_that_cannot_be_the_cause(simulator):
    X, y = measure(lambda t: 0.25 * t)
    whole = hs.DiscrepancyDiagnosis(exact(simulator), cv=None, random_state=0).fit(X, y)
    excluded = {whole.best_cause_.kind, "delay"}
    rest = clone(whole).set_params(exclude=sorted(excluded), cv=2).fit(X, y)
    assert rest.best_cause_.kind not in excluded
    assert not excluded & {*rest.gain_.kinds, *rest.indistinguishable_}
    table = rest.causes_.set_index("kind")
    for kind in excluded:
        assert table.loc[kind, "note"] == "not compared: you excluded it"
    assert "delay you excluded it" in " ".join(str(rest.report(full=True)).split())
    # what is left shares their prior probability (and is alone: nothing is weighed beside noise)
    odds = [
        shares["noise: mean"] / shares["none"]
        for shares in (d.causes_.set_index("form")["probability"] for d in (whole, rest))
    ]
    kinds = set(whole.causes_["kind"][whole.causes_["probability"] > 0]) - {"none", "unexplained"}
    assert odds[1] / odds[0] == pytest.approx(len(kinds) / (len(kinds) - 2))


def test_a_mechanism_of_the_users_own(simulator):
    X, y = measure(lambda t: 3 * (1 - np.exp(-0.8 * t**2)), noise=0.1)
    few = all_but("decay", "saturation", "build-up", "step", "trend")
    settings = {"causes": [Leak()], "exclude": few, "cv": None, "n_replicates": 39}
    diagnosis = hs.DiscrepancyDiagnosis(exact(simulator), **settings, random_state=0).fit(X, y)
    assert "leak" in set(diagnosis.causes_["kind"])
    assert "leak" in diagnosis.indistinguishable_


def test_the_same_seed_gives_the_same_diagnosis(simulator):
    X, y = measure(lambda t: 0.5 * np.sin(t))
    few = all_but("trend", "periodic", "noise")
    settings = {"exclude": few, "cv": None, "n_replicates": 39, "random_state": 4}
    first, second = (
        hs.DiscrepancyDiagnosis(exact(simulator), **settings).fit(X, y) for _ in range(2)
    )
    assert first.p_value_ == second.p_value_
    np.testing.assert_array_equal(first.predict(X), second.predict(X))


def test_clone_and_parameters(simulator):
    diagnosis = hs.DiscrepancyDiagnosis(exact(simulator), false_alarm_rate=0.1)
    assert clone(diagnosis).get_params()["false_alarm_rate"] == 0.1
    assert clone(diagnosis).set_params(estimator__beta=0.2).estimator.beta == 0.2


@pytest.mark.slow
def test_an_emulators_own_error_is_not_blamed_on_the_simulation():
    # a kink that a cubic polynomial cannot follow, and nothing wrong with the simulation
    def kinked(x, level):
        return level + 3 * np.abs(x - 4.0)

    simulator = hs.Simulator(kinked, {"x": (0, 10)}, {"level": uniform(0, 2)})
    model = hs.PowerScaledSurrogate(
        simulator.run(100, random_state=0), surrogate=hs.PolynomialChaos(degree=3), random_state=0
    )
    rng = np.random.default_rng(0)
    x = np.linspace(0.1, 9.9, 40)
    alarms = 0
    for _ in range(4):
        y = kinked(x, 1.0) + 0.3 * rng.standard_normal(40)
        diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, random_state=0)
        with pytest.warns(hs.DiagnosisWarning, match=r"PolynomialChaos.* misses the simulation by"):
            diagnosis.fit(x[:, None], y)
        assert diagnosis.emulator_check_.missed > 2 > 1 > diagnosis.emulator_check_.left_open
        alarms += diagnosis.verdict_ != "adequate"
    assert alarms <= 1  # at 5 % two of four have a chance of 1.4 %
    report = diagnosis.report()
    said = " ".join(str(diagnosis.report(full=True)).split())
    assert "differs from them by" in said
    assert "predictions rest on it: try Kriging() or more runs." in said
    assert report.to_dict()["emulator"] == diagnosis.emulator_check_._asdict()


@pytest.mark.slow
def test_a_simulation_that_is_run_has_no_emulator_to_check(simulator):
    X, y = measure(lambda t: 0 * t)
    diagnosis = hs.DiscrepancyDiagnosis(exact(simulator), cv=None, random_state=0).fit(X, y)
    assert diagnosis.emulator_check_ is None
    assert diagnosis.report().to_dict()["emulator"] is None
    assert "leave the simulation uncertain" not in str(diagnosis.report(full=True))


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"estimator": None}, TypeError, "must be a PowerScaledSurrogate"),
        ({"estimator": hs.PredictiveWeightedSurrogate()}, TypeError, "effects a diagnosis can"),
        ({"estimator": hs.PowerScaledSurrogate()}, ValueError, "no simulation to diagnose"),
        ({"false_alarm_rate": 1.5}, ValueError, "false_alarm_rate"),
        ({"n_replicates": 5}, ValueError, "use at least 19"),
    ],
)
def test_parameters_that_cannot_work(simulator, change, error, message):
    X, y = measure(lambda t: 0 * t)
    diagnosis = hs.DiscrepancyDiagnosis(exact(simulator)).set_params(**change)
    with pytest.raises(error, match=message):
        diagnosis.fit(X, y)


@pytest.mark.parametrize("exclude", ["trend", ["trnd"], ["unexplained"], None, [["trend"]]])
def test_what_cannot_be_excluded(simulator, exclude):
    X, y = measure(np.zeros_like)
    with pytest.raises(ValueError, match=r"the kinds are build-up, bump, .*decay"):
        hs.DiscrepancyDiagnosis(exact(simulator), exclude=exclude).fit(X, y)


def test_too_few_rows(simulator):
    X, y = measure(lambda t: 0 * t, n=6)
    with pytest.raises(ValueError, match="at least 8 measured rows, got 6"):
        hs.DiscrepancyDiagnosis(exact(simulator)).fit(X, y)


@pytest.mark.slow
def test_two_causes_are_found_one_after_the_other(simulator):
    n, spurious = 60, 0
    for seed in range(2):
        rng = np.random.default_rng(seed)
        frame = pd.DataFrame({"t": np.linspace(0, 12, n), "wind": rng.uniform(0, 4, n)})
        t, wind = frame["t"].to_numpy(), frame["wind"].to_numpy()
        mu = cooling(t, 60, 0.3, 20) + 1.5 * np.sin(2 * np.pi * t / 2.5) - 0.8 * (wind - 2)
        y = mu + 0.5 * rng.standard_normal(n)
        diagnosis = hs.DiscrepancyDiagnosis(
            exact(simulator), cv=None, n_replicates=99, max_causes=3, random_state=0
        ).fit(frame, y)
        kinds = [cause.kind for cause in diagnosis.found_causes_]
        assert set(kinds[:2]) == {"periodic", "missing-input"}
        # a third cause would be allowed, and is a false alarm
        spurious += len(kinds) - 2
        assert diagnosis.best_cause_ is diagnosis.found_causes_[0]
    assert spurious <= 1  # at a rate of 5 % two of two have a chance of one in 400
    found = {cause.kind: cause for cause in diagnosis.found_causes_}
    assert found["missing-input"].estimates["slope"][0] == pytest.approx(-0.8, abs=0.2)
    assert found["periodic"].estimates["period"][0] == pytest.approx(2.5, abs=0.1)
    # both are in the extended simulation
    assert "wind" in diagnosis.extended_simulator_.input_names
    assert {"period", "slope"} <= set(diagnosis.extended_simulator_.parameter_names)


def test_max_causes_is_checked(simulator):
    with pytest.raises(ValueError, match="max_causes == 0, must be >= 1"):
        hs.DiscrepancyDiagnosis(exact(simulator), max_causes=0).fit(*measure(np.zeros_like))
