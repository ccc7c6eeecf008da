"""Causes whose effect is far from its tangent: oscillations that run out of phase."""

import numpy as np
import pytest

import hybridsurrogate as hs
from hybridsurrogate.effects.catalogue import KINDS

WAVE = hs.Simulator(
    lambda t, height, rate: height * np.cos(rate * t),
    {"t": (0, 40)},
    {"height": hs.truncated_normal(5, 1, 2, 8)},
    {"rate": hs.Assumed(1.5, hs.truncated_normal(1.5, 0.3, 0.5, 2.5))},
)


def diagnose(rate, seed, drift=0.0, **settings):
    t = np.linspace(0, 40, 60)
    noise = 0.3 * np.random.default_rng(seed).standard_normal(60)
    y = 5.3 * np.cos((rate + drift * (t - 20)) * t) + noise
    model = hs.PowerScaledSurrogate(
        WAVE, surrogate=hs.ExactSurrogate(), n_draws=100, random_state=seed
    )
    diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, random_state=seed, **settings)
    return diagnosis.fit(t[:, None], y)


@pytest.mark.parametrize("rate", [1.55, 1.62, 1.8, 2.0])
def test_a_rate_that_is_off_by_many_periods_is_found(rate):
    """Up to seven standard deviations of phase away, where a climb from the assumed rate ends."""
    for seed in range(3):
        diagnosis = diagnose(rate, seed)
        assert diagnosis.verdict_ == "named"
        assert diagnosis.best_cause_.kind == "wrong-constant"
        mean, _, _ = diagnosis.best_cause_.estimates["value"]
        assert mean == pytest.approx(rate, abs=0.005)


def test_evidence_tells_what_tangents_do_not_see():
    others = [kind for kind in KINDS if kind != "wrong-constant"]
    diagnosis = diagnose(2.0, 0, exclude=others)
    assert diagnosis._test.share > 0.05
    assert diagnosis.p_value_ == pytest.approx(1 / 201)
    assert diagnosis.verdict_ == "named"
    assert "searched by tangents" in str(diagnosis.report())


def test_nothing_is_found_where_nothing_is_wrong():
    found = [diagnose(1.5, 100 + seed).verdict_ for seed in range(20)]
    # of 20 a rate of 0.05 leaves more than 4 with a probability of 0.003
    assert np.sum(np.array(found) != "adequate") <= 4
