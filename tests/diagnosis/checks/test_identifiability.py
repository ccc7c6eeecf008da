"""Causes that a parameter can stand in for are told from those that it cannot."""

import numpy as np
import pytest
from scipy.stats import norm

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.checks.parameters import confounded, confounding
from hybridsurrogate.diagnosis.report.details.checks import cautions
from hybridsurrogate.diagnosis.report.elements.view import View


def line(t, level, slope):
    return level + slope * t


def fitted(effect, truth, seed, level_sd=1.0):
    """Return the models before and after, and the measured rows, of a straight line."""
    rng = np.random.default_rng(seed)
    simulator = hs.Simulator(
        line, {"t": (0, 10)}, {"level": norm(0, level_sd), "slope": norm(1, 0.3)}
    )
    before = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=400, random_state=0
    )
    after = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), effects=(effect,), n_draws=400, random_state=0
    )
    t = np.linspace(0, 10, 40)
    level, slope = rng.normal(0, level_sd), rng.normal(1, 0.3)
    y = line(t, level, slope) + truth(t) + 0.2 * rng.standard_normal(40)
    return before.fit(t[:, None], y), after.fit(t[:, None], y), t[:, None]


@pytest.mark.parametrize("seed", range(4))
def test_an_offset_beside_an_additive_parameter_is_confounded(seed):
    table = confounding(*fitted(hs.Offset(), lambda t: 4.0, seed))
    (row,) = confounded(table).to_dict("records")
    assert (row["parameter"], row["estimate"]) == ("level", "amplitude")
    # the data know the sum to 0.1 at most, and the level's prior has a standard deviation of one
    assert row["correlation"] < -0.98
    assert row["width"] == pytest.approx(1, abs=0.15)
    assert row["absorbed"] == pytest.approx(1, abs=1e-6)
    # before, the level had to take the offset: it comes back to its prior
    assert row["shift"] == pytest.approx(-4, abs=2.5)


@pytest.mark.parametrize("seed", range(4))
def test_a_wave_beside_a_line_is_not(seed):
    wave = hs.Periodic("t")
    table = confounding(*fitted(wave, lambda t: np.sin(2 * np.pi * t / 2.5), seed))
    assert len(confounded(table)) == 0
    # four whole periods: the mean of the wave is zero, and hardly anything of it is a line
    assert table["absorbed"].max() < 0.1
    assert table["correlation"].abs().max() < 0.6


def test_a_parameter_that_is_known_leaves_nothing_to_confound():
    before, after, X = fitted(hs.Offset(), lambda t: 4.0, 0, level_sd=0.01)
    table = confounding(before, after, X)
    assert table[table["parameter"] == "level"]["correlation"].abs().max() < 0.5
    assert len(confounded(table)) == 0


def test_a_drift_is_not_compared_with_its_own_parameter():
    before, after, X = fitted(hs.ParameterDrift("slope", "t"), lambda t: 0.02 * t**2, 0)
    assert set(confounding(before, after, X)["parameter"]) == {"level"}


def test_the_diagnosis_warns_and_its_report_says_so():
    simulator = hs.Simulator(line, {"t": (0, 10)}, {"level": norm(0, 1), "slope": norm(1, 0.3)})
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=300, random_state=0
    )
    t = np.linspace(0, 10, 30)
    y = line(t, 0.0, 1.0) + 9.0 + 0.1 * np.random.default_rng(0).standard_normal(30)
    diagnosis = hs.DiscrepancyDiagnosis(
        model, cv=None, n_replicates=40, random_state=0, exclude=["narrow-prior"]
    )
    with pytest.warns(hs.ConfoundingWarning, match="from the parameter level"):
        diagnosis.fit(t[:, None], y)
    assert set(diagnosis.confounded_["parameter"]) == {"level", "slope"}
    said = " ".join(cautions(View(diagnosis.result_)))
    assert "How the two share it depends on their priors" in said
