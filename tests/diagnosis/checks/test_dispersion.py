"""Counts that scatter more than Poisson, whatever their mean is."""

import numpy as np
import pytest
from few_kinds import all_but
from scipy.stats import uniform

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.checks import data
from hybridsurrogate.diagnosis.checks.data import dispersion_of, neighbours
from hybridsurrogate.likelihoods import Binomial, Poisson


def _counts(random, n=60, mean=20.0, ratio=1.0, factor=0.0):
    """Return inputs, log of the simulated mean, counts of variance ratio times their mean."""
    X = np.sort(random.uniform(0, 1, (n, 1)), axis=0)
    eta = np.log(mean) + 0.5 * X[:, 0]
    mu = np.exp(eta + factor * np.sin(2 * np.pi * 3 * X[:, 0]))
    if ratio == 1:
        return X, eta, random.poisson(mu).astype(float)
    return X, eta, random.negative_binomial(mu / (ratio - 1), 1 / ratio).astype(float)


@pytest.fixture
def few_replicates(monkeypatch):
    """A p-value has its level with 199 as with thousands."""
    monkeypatch.setattr(data, "REPLICATES", 199)


def _p_values(make, likelihood, seeds=100):
    found = [dispersion_of(likelihood, *make(np.random.default_rng(s))) for s in range(seeds)]
    return np.array([one.p_value for one in found]), np.array([one.ratio for one in found])


@pytest.mark.usefixtures("few_replicates")
@pytest.mark.parametrize("mean", [0.5, 2.0, 20.0, 1e4])
def test_poisson_counts_are_poisson(mean):
    p, ratio = _p_values(lambda random: _counts(random, 80, mean), Poisson())
    # of 100 at a level of 5 %: more than 12 would happen once in 500 times
    assert np.sum(p <= 0.05) <= 12
    assert np.mean(ratio) == pytest.approx(1, abs=0.1)


@pytest.mark.usefixtures("few_replicates")
def test_a_wrong_mean_is_no_overdispersion():
    # three waves over the rows, by a factor of 1.5 up and down
    p, ratio = _p_values(lambda random: _counts(random, factor=0.4), Poisson())
    assert np.sum(p <= 0.05) <= 12
    assert np.mean(ratio) == pytest.approx(1, abs=0.1)


@pytest.mark.usefixtures("few_replicates")
def test_a_jump_of_the_mean_is_no_overdispersion():
    def jumps(random):
        X, eta, _ = _counts(random)
        return X, eta, random.poisson(np.exp(eta + 1.5 * (X[:, 0] > 0.5))).astype(float)

    p, _ = _p_values(jumps, Poisson())
    assert np.sum(p <= 0.01) <= 5


@pytest.mark.usefixtures("few_replicates")
def test_overdispersed_counts_are_found_and_measured():
    p, ratio = _p_values(lambda random: _counts(random, ratio=3.0), Poisson())
    assert np.sum(p <= 0.01) >= 90
    assert np.mean(ratio) == pytest.approx(3, rel=0.15)


@pytest.mark.usefixtures("few_replicates")
def test_successes():
    def successes(random, spread=0.0):
        X = np.sort(random.uniform(0, 1, (60, 1)), axis=0)
        eta = 2 * X[:, 0] - 1
        share = 1 / (1 + np.exp(-eta))
        if spread:
            size = 1 / spread - 1
            share = random.beta(share * size, (1 - share) * size)
        return X, eta, random.binomial(20, share).astype(float)

    p, _ = _p_values(successes, Binomial(20))
    assert np.sum(p <= 0.05) <= 12
    p, ratio = _p_values(lambda random: successes(random, 0.1), Binomial(20))
    assert np.sum(p <= 0.01) >= 85
    # the variance of a beta-binomial is 1 + (trials - 1) spread times that of a binomial
    assert np.mean(ratio) == pytest.approx(2.9, rel=0.2)


def test_one_trial_says_nothing_of_scatter():
    X = np.arange(60.0)[:, None]
    y = np.random.default_rng(0).binomial(1, 0.5, 60).astype(float)
    found = dispersion_of(Binomial(1), X, np.zeros(60), y)
    assert found is None or found.p_value > 0.5


def test_rows_are_paired_once_with_what_is_near():
    X = np.column_stack([np.repeat([0.0, 10.0], 20), np.tile(np.arange(20.0), 2)])
    a, b = neighbours(X)
    assert len(np.unique(np.concatenate([a, b]))) == 2 * len(a)
    assert len(a) >= 15
    assert (X[a, 0] == X[b, 0]).all()


FEW = all_but("noise", "step", "periodic", "trend")


def _diagnosed(y, t, exclude=FEW):
    simulator = hs.Simulator(
        lambda t, a, k: a * np.exp(-k * t),
        inputs={"t": (0, 10)},
        parameters={"a": uniform(10, 50), "k": uniform(0.02, 0.2)},
        output="n",
    )
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), likelihood="poisson", random_state=0
    )
    settings = {"exclude": exclude, "cv": None, "n_replicates": 39}
    return hs.DiscrepancyDiagnosis(model, **settings, random_state=0).fit(t[:, None], y)


def test_overdispersed_counts_are_named_so_and_the_cure_is_said():
    random = np.random.default_rng(100)
    t = np.sort(random.uniform(0, 10, 70))
    y = random.negative_binomial(20 * np.exp(-0.1 * t), 1 / 3)  # variance: 3 times the mean
    with pytest.warns(hs.DiagnosisWarning, match="likelihood='negative-binomial'"):
        diagnosis = _diagnosed(y, t)
    assert diagnosis.causes_["form"].iloc[0] == "noise: overdispersed"
    assert [one.about for one in diagnosis.cautions_] == ["noise"]
    _, low, high = diagnosis.best_cause_.estimates["ratio"]
    assert low < 3**0.5 < high
    assert diagnosis.extended_simulator_ is None
    assert "negative binomial" in diagnosis.best_cause_.formula
    assert "negative-binomial" in str(diagnosis.report(full=True))
    # its intervals are as wide as the counts scatter
    draws = diagnosis.extended_estimator_.sample_posterior_predictive(t[:, None])
    assert np.mean(np.var(draws, axis=0) / np.mean(draws, axis=0)) == pytest.approx(3, rel=0.35)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::hybridsurrogate.DiagnosisWarning")
def test_of_twenty_sets_each():
    over, alarms, waves = [], [], []
    for seed in range(20):
        random = np.random.default_rng(300 + seed)
        t = np.sort(random.uniform(0, 10, 70))
        mu = 40 * np.exp(-0.1 * t)
        over.append(_diagnosed(random.negative_binomial(mu / 2, 1 / 3), t, ()))
        alarms.append(_diagnosed(random.poisson(mu), t, ()))
        wave = 1 + 0.3 * np.sin(2 * np.pi * t / 2.5)
        waves.append(_diagnosed(random.poisson(mu * wave), t, ()))
    concerned = ["noise" in [c.about for c in one.cautions_] for one in over]
    overdispersed = [one.causes_["form"].iloc[0] == "noise: overdispersed" for one in over]
    assert np.sum(np.logical_or(concerned, overdispersed)) >= 18
    named = [one.verdict_ in ("named", "nearest") for one in over]
    assert np.sum(np.logical_and(named, np.logical_not(overdispersed))) <= 1
    assert sum(bool(one.cautions_) for one in alarms) <= 1
    assert sum(one.best_cause_.kind == "periodic" for one in waves) >= 18
    assert sum(bool(one.cautions_) for one in waves) <= 2


def _of_trials(t, a, k):
    return 20 / (1 + np.exp(-(a - k * t)))


def _successes_diagnosed(y, t, exclude=FEW):
    simulator = hs.Simulator(
        _of_trials,
        inputs={"t": (0, 10)},
        parameters={"a": uniform(0, 3), "k": uniform(0.1, 0.7)},
        output="survivors",
    )
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), likelihood=Binomial(20), random_state=0
    )
    settings = {"exclude": exclude, "cv": None, "n_replicates": 39}
    return hs.DiscrepancyDiagnosis(model, **settings, random_state=0).fit(t[:, None], y)


def _survivors(random, n=70, correlation=0.0):
    """Return times, survivors of 20; a share that differs between rows correlates these."""
    t = np.sort(random.uniform(0, 10, n))
    share = _of_trials(t, 1.5, 0.4) / 20
    if correlation:
        size = 1 / correlation - 1
        share = random.beta(share * size, (1 - share) * size)
    return t, random.binomial(20, share).astype(float)


def test_successes_that_scatter_more_are_named_so_and_the_cure_is_said():
    t, y = _survivors(np.random.default_rng(100), correlation=0.1)
    with pytest.warns(hs.DiagnosisWarning, match=r"likelihood=BetaBinomial\(trials=...\)"):
        diagnosis = _successes_diagnosed(y, t)
    assert diagnosis.causes_["form"].iloc[0] == "noise: overdispersed"
    assert diagnosis.verdict_ == "named"
    told = diagnosis.best_cause_.estimates
    for name, true in (("ratio", (1 + 19 * 0.1) ** 0.5), ("scatter", (0.1 / 0.9) ** 0.5)):
        mean, low, high = told[name]
        # three standard deviations; from 5 to 95 % are 3.29
        assert abs(mean - true) < 3 * (high - low) / 3.29
    assert diagnosis.extended_simulator_ is None
    assert "beta-binomial" in diagnosis.best_cause_.formula
    assert "BetaBinomial" in str(diagnosis.report(full=True))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::hybridsurrogate.DiagnosisWarning")
def test_of_ten_sets_of_successes_each():
    seeds = [np.random.default_rng(500 + seed) for seed in range(10)]
    over = []
    for random in seeds:
        t, y = _survivors(random, correlation=0.1)
        over.append(_successes_diagnosed(y, t, ()))
    clean = []
    for random in seeds:
        t, y = _survivors(random)
        clean.append(_successes_diagnosed(y, t, ()))
    told = [any("BetaBinomial" in c.sentence for c in one.cautions_) for one in over]
    overdispersed = [one.causes_["form"].iloc[0] == "noise: overdispersed" for one in over]
    assert np.sum(np.logical_or(told, overdispersed)) >= 9
    named = [one.verdict_ in ("named", "nearest") for one in over]
    assert np.sum(np.logical_and(named, np.logical_not(overdispersed))) == 0
    assert sum(one.verdict_ != "adequate" for one in clean) <= 2
    assert sum(bool(one.cautions_) for one in clean) <= 1
