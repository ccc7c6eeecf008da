"""A cause and noise that neighbouring rows share: the one is no rival of the other."""

import warnings
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from few_kinds import all_but
from scipy import stats

import hybridsurrogate as hs

T = np.linspace(0, 10, 70)
FEW = all_but("periodic", "noise", "step", "trend", "offset")


def decay(t, start, rate):
    return start * np.exp(-rate * t)


def rows(seed: int, correlated: float, wave: float, jump: float = 0.0) -> np.ndarray:
    """Draw what is measured at T: a decay, what is hidden, correlated and independent noise."""
    rng = np.random.default_rng(seed)
    covariance = correlated**2 * np.exp(-np.abs(T[:, None] - T) / 0.4) + 1e-9 * np.eye(len(T))
    path = np.linalg.cholesky(covariance) @ rng.standard_normal(len(T))
    period, place = rng.uniform(2.5, 4), rng.uniform(3, 7)
    hidden = wave * np.sin(2 * np.pi * T / period) + jump * (place < T)
    return decay(T, 10, 0.2) + hidden + path + 0.3 * rng.standard_normal(len(T))


def diagnose(y: np.ndarray, **settings) -> hs.DiscrepancyDiagnosis:
    priors = {"start": stats.norm(10, 3), "rate": hs.truncated_normal(0.2, 0.1, 0.01, 1)}
    model = hs.PowerScaledSurrogate(
        hs.Simulator(decay, {"t": (0, 10)}, priors), surrogate=hs.ExactSurrogate(), random_state=0
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hs.HybridSurrogateWarning)
        settings = {"n_replicates": 99, "cv": None, "random_state": 0, **settings}
        return hs.DiscrepancyDiagnosis(model, **settings).fit(pd.DataFrame({"t": T}), y)


def test_a_wave_in_correlated_noise_is_found_beside_that_noise():
    # a wave of four times the noise
    diagnosis = diagnose(rows(12, correlated=0.9, wave=3.5), exclude=FEW)
    wave, noise = diagnosis.found_causes_
    assert (wave.kind, noise.kind) == ("periodic", "noise")
    low, high = noise.estimates["amplitude"][1:]
    assert low < 0.9 < high
    assert diagnosis.causes_["correlated"][0] > 0.5
    # its rivals, which were weighed beside the same noise, are averaged over with it
    models = diagnosis.extended_estimator_.estimators_
    assert len(models) > 1
    for model in models:
        assert "noise" in [cause.kind for cause in model.effects]
    report = str(diagnosis.report(full=True))
    assert "with and without correlated noise" in " ".join(report.split())


def test_independent_noise_stays_out_of_what_is_found():
    diagnosis = diagnose(rows(2, correlated=0.0, wave=1.2), exclude=FEW)
    assert [found.kind for found in diagnosis.found_causes_] == ["periodic"]
    assert diagnosis.causes_["correlated"][0] < 0.5


def test_noise_is_as_likely_correlated_beside_a_cause_as_beside_nothing():
    found = diagnose(rows(3, correlated=0.0, wave=0.0), exclude=FEW).search_
    none = found.candidates[0]
    path = next(w for w in found.candidates if w.cause and w.cause.is_correlated_noise)
    offset = next(w for w in found.candidates if w.cause and w.cause.kind == "offset")
    gained = 7.0
    candidates = [
        none._replace(log_evidence=0.0),
        path._replace(log_evidence=gained, log_evidence_with_remainder=-np.inf),
        offset._replace(
            log_evidence=2.0,
            log_evidence_with_remainder=-np.inf,
            log_evidence_with_noise=2.0 + gained,
        ),
    ]
    weighed = replace(found, candidates=candidates)
    odds_beside_nothing = weighed.probability[1] / weighed.probability[0]
    odds_beside_offset = weighed.correlated[2] / (1 - weighed.correlated[2])
    assert odds_beside_offset == pytest.approx(odds_beside_nothing)


@pytest.mark.slow
def test_how_often_a_wave_or_a_jump_is_found_in_correlated_noise():
    waves = [diagnose(rows(100 + k, 0.5, wave=1.2)) for k in range(20)]
    jumps = [diagnose(rows(200 + k, 0.5, wave=0.0, jump=2.5)) for k in range(20)]
    nothing = [diagnose(rows(300 + k, 0.5, wave=0.0)) for k in range(20)]
    first = {
        "periodic": np.mean([d.best_cause_.kind == "periodic" for d in waves]),
        "step": np.mean([d.best_cause_.kind == "step" for d in jumps]),
    }
    assert first["periodic"] >= 0.6
    assert first["step"] >= 0.5
    # a name where there is noise only: 5 % of 20, more than 4 with a probability of 0.003
    wrong = [d.verdict_ == "named" and d.best_cause_.kind != "noise" for d in nothing]
    assert np.sum(wrong) <= 4
    # what is left beside a right cause and the noise is noise: 5 % of those that have both
    both = [d for d in (*waves, *jumps) if len(d.found_causes_) == 2]
    assert len(both) >= 5
    assert np.mean([d.residual_check_.p_value <= 0.05 for d in both]) <= 0.3
