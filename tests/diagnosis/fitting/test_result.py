"""What a fit found is one object, which nothing changes afterwards."""

import copy
from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.fitting.result import DiagnosisResult
from hybridsurrogate.diagnosis.report.report import make_report
from hybridsurrogate.diagnosis.source.python_code import extended_model, python_source
from hybridsurrogate.effects.registry import kinds

T = np.linspace(0, 4, 24)
Y = 2 * T + 1.5 + 0.3 * np.random.default_rng(0).standard_normal(24)


def line(t, slope):
    return slope * t


def diagnosis_of(function=line, **settings):
    simulator = hs.Simulator(
        function, inputs={"t": (0, 4)}, parameters={"slope": hs.truncated_normal(2, 0.2, 1, 3)}
    )
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=100, random_state=0
    )
    exclude = sorted({*kinds()} - {"offset", "trend"})
    settings = {"exclude": exclude, "cv": None, "n_replicates": 50, "random_state": 0, **settings}
    return hs.DiscrepancyDiagnosis(model, **settings)


@pytest.fixture(scope="module")
def fitted():
    return diagnosis_of(cv=2).fit(T[:, None], Y)


def test_what_is_public_is_what_the_result_holds(fitted):
    result = fitted.result_
    assert isinstance(result, DiagnosisResult)
    assert fitted.verdict_ == result.conclusion.verdict
    assert fitted.causes_ is result.causes
    assert fitted.extended_estimator_ is result.extension.estimator
    assert fitted.best_cause_ is result.extension.found_causes[0] is fitted.found_causes_[0]
    assert fitted.gain_ is result.gain is not None
    public = {name for name in vars(fitted) if name.endswith("_")}
    assert public == set(result.attributes())


def test_a_result_is_frozen(fitted):
    for record in (fitted.result_, fitted.result_.conclusion, fitted.result_.extension):
        with pytest.raises(FrozenInstanceError):
            record.verdict = "adequate"


def test_a_result_is_all_that_report_and_module_need(fitted):
    report = fitted.report(full=True)
    assert str(make_report(fitted.result_, full=True)) == str(report)
    assert python_source(extended_model(fitted.result_)) == fitted.to_python()
    doubted = replace(fitted.result_.conclusion, verdict="ambiguous")
    other = make_report(replace(fitted.result_, conclusion=doubted))
    assert other.to_dict()["verdict"] == "ambiguous"
    assert fitted.report().to_dict()["verdict"] == fitted.verdict_ != "ambiguous"


def test_settings_of_a_report_are_those_of_the_fit(fitted):
    changed = copy.copy(fitted).set_params(n_replicates=1000, random_state=7)
    assert str(changed.report(full=True)) == str(fitted.report(full=True))
    assert changed.to_python() == fitted.to_python()


def test_a_fit_that_fails_leaves_what_was_found_before():
    found = diagnosis_of().fit(T[:, None], Y)
    report = str(found.report())
    with pytest.raises(ValueError, match="at least"):
        found.fit(T[:3, None], Y[:3])
    assert str(found.report()) == report


def test_an_interrupted_fit_leaves_nothing_of_the_fit_before(monkeypatch):
    # how often a simulation is called depends on how long it takes
    for module in ("simulation.evaluation", "diagnosis.checks.simulation"):
        monkeypatch.setattr(f"hybridsurrogate.{module}.perf_counter", lambda: 0.0)
    last = [np.inf]

    def stopping(t, slope):
        last[0] -= 1
        if last[0] < 0:
            raise KeyboardInterrupt
        return slope * t

    found = diagnosis_of(stopping)
    last[0] = n = 10**6
    found.fit(T[:, None], Y)
    # as the first fit went, so goes the second: the last call is of its extension
    last[0] = n - last[0] - 1
    with pytest.warns(hs.DiagnosisWarning, match="interrupted"), pytest.raises(KeyboardInterrupt):
        found.fit(T[:, None], Y)
    assert {name for name in vars(found) if name.endswith("_")} == {"search_", "causes_"}
    assert found.causes_["probability"].sum() == pytest.approx(1)
