"""What is known to be wrong already is part of the simulation that is diagnosed."""

import numpy as np
import pytest
from few_kinds import all_but
from scipy.stats import norm

import hybridsurrogate as hs

T = np.linspace(0, 10, 60)
KINDS = all_but("trend", "step", "periodic", "bump", "episode")
WAVE = 0.6 * np.sin(2 * np.pi * T / 2.3)


def line(t, level, slope):
    return level + slope * t


def measured(hidden, seed=0, at=4.0):
    noise = 0.3 * np.random.default_rng(seed).standard_normal(len(T))
    return line(T, 1.0, 2.0) + 2.0 * (at < T) + hidden + noise


def diagnosed(y, effects, **settings):
    simulator = hs.Simulator(line, {"t": (0, 10)}, {"level": norm(0, 3), "slope": norm(2, 1)})
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), effects=effects, n_draws=200, random_state=0
    )
    settings = {"cv": None, "n_replicates": 100, "exclude": KINDS, **settings}
    return hs.DiscrepancyDiagnosis(model, random_state=0, **settings).fit(T[:, None], y)


@pytest.fixture(scope="module")
def found():
    return diagnosed(measured(WAVE), [hs.Step("t", location=norm(4, 0.2))], cv=3)


def test_the_next_cause_is_found_in_addition_to_what_is_known(found):
    assert found.verdict_ == "named"
    assert found.best_cause_.kind == "periodic"
    low, high = found.best_cause_.estimates["period"][1:]
    assert low < 2.3 < high
    assert found.p_value_ < 0.05


def test_what_is_known_stays_in_the_extension(found):
    kinds = [effect.kind for effect in found.extended_estimator_.effects if effect.is_learned]
    assert kinds == ["step", "periodic"]
    missed = found.predict(T[:, None]) - (line(T, 1.0, 2.0) + 2.0 * (T > 4) + WAVE)
    assert np.sqrt(np.mean(missed**2)) < 0.2
    # the simulation that may be taken away has both
    run = found.extended_simulator_
    assert {"location", "amplitude", "period"} <= {*run.parameters}
    assert "def step" in found.to_python()
    text = str(found.report(full=True))
    assert "Known before the diagnosis" in text
    assert "step(t): location" in text


def test_folds_know_it_too(found):
    gain = found.gain_
    assert gain.elpd_difference > 2 * gain.standard_error
    assert {*gain.kinds} == {"periodic"}


@pytest.mark.usefixtures("verdict_alone")
def test_where_nothing_else_is_wrong_nothing_is_named():
    """More than one of 5 sets: at a rate of 0.05 once in 44."""
    verdicts = [
        diagnosed(measured(0.0, seed), [hs.Step("t", location=norm(4, 0.2))]).verdict_
        for seed in range(1, 6)
    ]
    assert sum(word != "adequate" for word in verdicts) <= 1


def test_without_being_told_it_is_found():
    assert diagnosed(measured(0.0), []).best_cause_.kind == "step"


def test_a_known_effect_that_is_elsewhere_is_said():
    with pytest.warns(hs.DiagnosisWarning, match="show nothing of a known effect"):
        found = diagnosed(measured(0.0, at=7.0), [hs.Step("t", location=norm(2, 0.1))])
    assert found.best_cause_.kind == "step"
    assert found.best_cause_.estimates["location"][0] == pytest.approx(7.0, abs=0.3)
    assert "show nothing of a known effect" in " ".join(str(found.report()).split())


def test_a_known_effect_at_the_end_of_its_prior_is_said():
    with pytest.warns(hs.DiagnosisWarning, match="contradict what is known.*location of step"):
        diagnosed(measured(0.0, at=4.8), [hs.Step("t", location=norm(4.0, 0.2))])


@pytest.mark.parametrize("effect", [hs.GaussianProcessDiscrepancy(), hs.Outliers()])
def test_nothing_is_compared_in_addition_to_what_explains_all(effect):
    with pytest.raises(ValueError, match="Diagnose the estimator without it"):
        diagnosed(measured(0.0), [effect])
