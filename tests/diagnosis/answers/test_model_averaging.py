"""Over what the extended model averages, and with which weights."""

from types import SimpleNamespace

import numpy as np
import pytest
from sklearn.base import clone

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.answers.averaging import averaged_over, explanations

WAVE, STEP, BUMP, TREND = hs.Periodic("t"), hs.Step("t"), hs.Bump("t"), hs.Trend("t")
NOISE = hs.Autocorrelation("t")


def step_of(chosen, beside, needs_noise=(), **probabilities):
    """A search whose candidates have these probabilities, the rest being nothing further."""
    causes = {"wave": WAVE, "step": STEP, "bump": BUMP, "trend": TREND, "noise": NOISE}
    weighed = [None, *(causes[name] for name in probabilities)]
    shares = np.array(list(probabilities.values()))
    return SimpleNamespace(
        chosen=SimpleNamespace(cause=chosen),
        conditional=SimpleNamespace(
            candidates=[SimpleNamespace(cause=cause, log_evidence=0.0) for cause in weighed],
            correlated=np.array([1.0 * (cause in needs_noise) for cause in weighed]),
            probability=np.array([1 - shares.sum(), *shares]),
            problem=SimpleNamespace(model=SimpleNamespace(effects=beside)),
        ),
    )


def test_what_has_five_percent_is_averaged_over_the_found_cause_first():
    step = step_of(WAVE, (), step=0.5, wave=0.35, bump=0.06, trend=0.04)
    sets, shares = explanations([step])
    # the found one leads, though another is more probable alone; "none" has 5 % too
    assert sets == [(WAVE,), (STEP,), (BUMP,), ()]
    np.testing.assert_allclose(shares, [0.35, 0.5, 0.06, 0.05])


def test_an_improbable_cause_that_was_chosen_stays():
    sets, shares = explanations([step_of(WAVE, (), step=0.97, wave=0.01)])
    assert sets == [(WAVE,), (STEP,)]
    np.testing.assert_allclose(shares, [0.01, 0.97])


def test_of_several_causes_each_in_turn_gives_way():
    first = step_of(WAVE, (STEP,), wave=0.8, bump=0.2)
    second = step_of(STEP, (WAVE,), step=0.5, trend=0.5)
    sets, shares = explanations([first, second])
    assert sets == [(WAVE, STEP), (WAVE, TREND), (BUMP, STEP)]
    # relative to the pair that was found: 1, 0.5 / 0.5 and 0.2 / 0.8
    np.testing.assert_allclose(shares, np.array([1, 1, 0.25]) / 2.25)


def test_what_was_weighed_alone_says_nothing_of_a_pair():
    first = step_of(WAVE, (), wave=0.5, bump=0.5)
    second = step_of(STEP, (WAVE,), step=0.75, trend=0.25)
    assert explanations([first, second])[0] == [(WAVE, STEP), (WAVE, TREND)]


def test_correlated_noise_stays_with_the_causes_that_need_it():
    probabilities = {"wave": 0.5, "step": 0.2, "bump": 0.1, "noise": 0.1}
    first = step_of(WAVE, (), needs_noise=(WAVE, STEP), **probabilities)
    second = step_of(NOISE, (WAVE,), noise=0.9)
    sets, shares = explanations([first, second])
    assert sets == [(WAVE, NOISE), (STEP, NOISE), (), (BUMP,), (NOISE,), (WAVE,)]
    ratios = np.array([1, 0.4, 0.2, 0.2, 0.2, 1 / 9])
    np.testing.assert_allclose(shares, ratios / ratios.sum())


def test_a_rival_that_needs_correlated_noise_has_it():
    step = step_of(WAVE, (), needs_noise=(STEP,), wave=0.6, step=0.3, noise=0.1)
    assert explanations([step])[0] == [(WAVE,), (STEP, NOISE), (NOISE,)]


def test_what_cannot_be_fitted_is_told_and_left_out():
    simulator = hs.Simulator(
        lambda t, a: a * t, {"t": (0, 10)}, {"a": hs.truncated_normal(1, 1, 0, 3)}
    )
    t, y = np.arange(10.0)[:, None], np.arange(10.0)
    model = hs.PowerScaledSurrogate(simulator, hs.ExactSurrogate(), n_draws=50, random_state=0)
    before = model.fit(t, y)

    def fitted(causes):
        if causes == (BUMP,):
            raise ValueError("no start has a finite density")
        return clone(before).set_params(effects=causes).fit(t, y)

    step = step_of(TREND, (), trend=0.5, bump=0.3, step=0.18)
    with pytest.warns(hs.DiagnosisWarning, match=r"bump\(t\), with 30 % .* no start has a finite"):
        average = averaged_over([step], before, fitted)
    assert [one.effects[0] for one in average.estimators_] == [TREND, STEP]
    np.testing.assert_allclose(average.weights_, np.array([0.5, 0.18]) / 0.68)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::hybridsurrogate.ConfoundingWarning")
def test_beyond_the_data_two_explanations_foresee_more_than_one():
    """A bend that several kinds draw alike: each new seed's truth is one of them."""
    simulator = hs.Simulator(
        lambda t, a: a * t, {"t": (0, 20)}, {"a": hs.truncated_normal(1, 0.3, 0, 3)}
    )
    gains, held = [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        t = np.sort(rng.uniform(0, 10, 30))
        later = np.linspace(10.5, 20, 20)

        def truth(t, seed=seed):
            return t + (2 * t / (4 + t) if seed % 2 else 0.015 * t**2)

        model = hs.PowerScaledSurrogate(
            simulator, surrogate=hs.ExactSurrogate(), n_draws=200, random_state=0
        )
        diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, n_replicates=39, random_state=0)
        extended = diagnosis.fit(t[:, None], truth(t) + 0.2 * rng.standard_normal(30))
        extended = extended.extended_estimator_
        if extended is diagnosis.estimator_:
            continue
        new = later[:, None], truth(later) + 0.2 * rng.standard_normal(20)
        gains.append(extended.score(*new) - extended.estimators_[0].score(*new))
        held.append([m.interval_holds(*new)[0].mean() for m in (extended, extended.estimators_[0])])
    gains, (both, one) = np.array(gains), np.mean(held, axis=0)
    assert len(gains) > 6
    assert gains.mean() > 0
    # never more than the price of the leader's share
    assert gains.min() > np.log(0.05)
    assert both > one
