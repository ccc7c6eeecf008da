"""Causes whose effect is far from its tangent: oscillations that run out of phase."""

import numpy as np
import pytest
from scipy import special

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.search.candidate import prior_odds
from hybridsurrogate.diagnosis.search.null_test import evidence_bound
from hybridsurrogate.effects.registry import kinds

WAVE = hs.Simulator(
    lambda t, height, rate: height * np.cos(rate * t),
    {"t": (0, 40)},
    {"height": hs.truncated_normal(5, 1, 2, 8)},
    {"rate": hs.Assumed(1.5, hs.truncated_normal(1.5, 0.3, 0.5, 2.5))},
)


DAMPED = hs.Simulator(
    lambda t, height, rate: height * np.exp(-0.02 * t) * np.cos(rate * t),
    {"t": (0, 40)},
    {"height": hs.truncated_normal(5, 1, 2, 8), "rate": hs.truncated_normal(1.5, 0.1, 1, 2)},
)
ROWS = np.linspace(0, 40, 60)


def diagnosis_of(simulator, truth, seed, **settings):
    noise = 0.3 * np.random.default_rng(seed).standard_normal(60)
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=100, random_state=seed
    )
    diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, random_state=seed, **settings)
    return diagnosis.fit(ROWS[:, None], truth + noise)


def diagnose(rate, seed, **settings):
    return diagnosis_of(WAVE, 5.3 * np.cos(rate * ROWS), seed, **settings)


@pytest.mark.slow
@pytest.mark.parametrize("rate", [1.55, 1.62, 1.8, 2.0])
def test_a_rate_that_is_off_by_many_periods_is_found(rate):
    """Up to seven standard deviations of phase away, where a climb from the assumed rate ends."""
    for seed in range(3):
        diagnosis = diagnose(rate, seed)
        assert diagnosis.verdict_ == "named"
        assert diagnosis.best_cause_.kind == "wrong-constant"
        mean, _, _ = diagnosis.best_cause_.estimates["value"]
        assert mean == pytest.approx(rate, abs=0.005)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shift", "form", "name", "value"),
    [
        (0.2 * (ROWS > 20), "step over t", "change", 0.2),
        (-0.4 * (ROWS > 14), "step over t", "change", -0.4),
        (0.3 / (1 + np.exp(-(ROWS - 20) / 3)), "logistic over t", "change", 0.3),
        (0.03 * (ROWS - 20), "parameter-drift", "slope", 0.03),
        (0.1 * np.sin(2 * np.pi * ROWS / 13), "periodic over t", "amplitude", 0.1),
    ],
)
def test_a_rate_that_drifts_by_many_periods_is_found(shift, form, name, value):
    """Confidently called noise, or another form of drift, where climbs follow tangents alone."""
    truth = DAMPED(ROWS, np.column_stack([np.full(60, 5.3), 1.56 + shift]))
    for seed in range(2):
        diagnosis = diagnosis_of(DAMPED, truth, seed)
        assert diagnosis.verdict_ == "named"
        assert diagnosis.best_cause_.kind == "parameter-drift"
        assert form in diagnosis.causes_["form"][0]
        assert diagnosis.best_cause_.estimates[name][0] == pytest.approx(value, rel=0.05)


@pytest.mark.slow
def test_a_rate_that_swings_through_many_radians_is_found():
    """By 12 rad, beyond what the rows resolve."""
    right = 0
    for period in (6, 9, 13, 20):
        for phase in (1.0, 4.0):
            rate = 1.56 + 0.3 * np.sin(2 * np.pi * ROWS / period + phase)
            truth = DAMPED(ROWS, np.column_stack([np.full(60, 5.3), rate]))
            diagnosis = diagnosis_of(DAMPED, truth, int(phase))
            if diagnosis.verdict_ == "named" and "periodic over t" in diagnosis.causes_["form"][0]:
                found = diagnosis.best_cause_.estimates["period"][0]
                right += abs(found / period - 1) < 0.02
    assert right >= 6


def test_evidence_tells_what_tangents_do_not_see():
    others = [kind for kind in kinds() if kind != "wrong-constant"]
    diagnosis = diagnose(2.0, 0, exclude=others)
    assert diagnosis.result_.test.share > 0.05
    assert diagnosis.p_value_ == pytest.approx(1 / 201)
    assert diagnosis.verdict_ == "named"
    assert "data sets made by the simulation itself looks as wrong" in " ".join(
        str(diagnosis.report()).split()
    )


@pytest.mark.slow
def test_nothing_is_found_where_nothing_is_wrong():
    found = [diagnose(1.5, 100 + seed).verdict_ for seed in range(10)]
    # of 10 a rate of 0.05 leaves more than 3 with a probability of 0.001
    assert np.sum(np.array(found) != "adequate") <= 3


def test_the_bound_is_the_ratio_of_the_evidence():
    found = diagnose(1.55, 0).search_
    prior = prior_odds([w.cause for w in found.candidates])
    alone = np.array([w.log_evidence for w in found.candidates])
    named = [w.cause is not None for w in found.candidates]
    curve = np.array([w.log_evidence_with_remainder for w in found.candidates])
    noise = np.array([w.log_evidence_with_noise for w in found.candidates])
    # a named cause leaves a smooth remainder with a probability of a tenth, and noise is
    # correlated beside it as often as beside nothing
    path = next(
        k for k, w in enumerate(found.candidates) if w.cause and w.cause.is_correlated_noise
    )
    of_noise = prior[path] / (prior[path] + prior[0])
    weights = np.array([0.1 * np.isfinite(curve) * named, of_noise * np.isfinite(noise)])
    parts = np.array([alone, np.where(weights[0], curve, 0), np.where(weights[1], noise, 0)])
    evidence = special.logsumexp(parts, b=[1 - weights.sum(axis=0), *weights], axis=0)[1:]
    against = special.logsumexp(evidence, b=prior[1:] / prior[1:].sum()) - alone[0]
    assert np.log(evidence_bound(found)) == pytest.approx(-against, abs=1e-6)


@pytest.mark.slow
def test_fits_of_an_oscillation_do_not_stop_at_another_frequency():
    """Over 35 periods, with phase and damping: 2 of 160 fits had ten times the noise."""
    priors = {
        "height": hs.truncated_normal(5, 1, 2, 8),
        "rate": hs.truncated_normal(1.5, 0.3, 0.5, 2.5),
        "phase": hs.truncated_normal(0, 1.5, -3.1, 3.1),
        "damping": hs.truncated_normal(0.02, 0.01, 0, 0.05),
    }

    def wave(t, height, rate, phase, damping):
        return height * np.exp(-damping * t) * np.cos(rate * t + phase)

    simulator = hs.Simulator(wave, {"t": (0, 150)}, priors)
    for seed in range(3000, 3040):
        rng = np.random.default_rng(seed)
        t = np.sort(rng.uniform(0, 150, 60))
        true = [prior.rvs(random_state=seed + k) for k, prior in enumerate(priors.values())]
        y = wave(t, *true) + 0.1 * rng.standard_normal(60)
        model = hs.PowerScaledSurrogate(
            simulator, surrogate=hs.ExactSurrogate(), n_draws=100, random_state=0
        ).fit(t[:, None], y)
        assert model.posterior_.sigma.mean() < 0.15, seed
