"""Whether an extension stays right as measurements come in."""

from copy import deepcopy

import numpy as np
import pandas as pd
import pytest
from few_kinds import all_but
from scipy.stats import multivariate_normal, norm, poisson

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.answers.monitor import log_odds

N = 50
# these watch what comes: the wave is plain, and else the simulation is right
FEW = all_but("periodic", "step", "noise")


def line(t, level, slope):
    return level + slope * t


def simulator():
    return hs.Simulator(
        line,
        inputs={"t": (0, 40)},
        parameters={"level": norm(0, 2), "slope": norm(1, 0.5)},
    )


def measured(n, seed, wave=1.5, noise=0.3):
    """A line with a wave that the simulation lacks."""
    t = np.linspace(0, 10 * n / N, n)
    rng = np.random.default_rng(seed)
    return t, 0.5 + t + wave * np.sin(2 * np.pi * t / 3) + noise * rng.standard_normal(n)


def diagnosed(X, y, exclude=()):
    model = hs.PowerScaledSurrogate(
        simulator(), surrogate=hs.ExactSurrogate(), n_draws=300, random_state=0
    )
    settings = {"exclude": exclude, "cv": None, "n_replicates": 39}
    return hs.DiscrepancyDiagnosis(model, random_state=0, **settings).fit(X, y)


@pytest.fixture(scope="module")
def fitted_once():
    t, y = measured(N, 0)
    found = diagnosed(pd.DataFrame({"t": t}), y, FEW)
    assert found.best_cause_.kind == "periodic"
    return found


@pytest.fixture
def wave(fitted_once):
    """A diagnosis that has seen no new measurement yet."""
    return deepcopy(fitted_once)


def following(seed, n=60, shift=0.0, since=None):
    t, y = measured(N + n, seed)
    t, y = t[N:], y[N:]
    if since is not None:
        y[since:] += shift
    return pd.DataFrame({"t": t}), y


def test_the_odds_are_those_of_every_beginning_and_change():
    z = np.random.default_rng(0).standard_normal(7)
    odds, began = log_odds(z)

    for t in range(1, 8):
        terms = []
        for k in range(1, t + 1):
            seen = z[k - 1 : t]
            # the shift is common to all of them
            moved = multivariate_normal(cov=np.eye(len(seen)) + 1.0).pdf(seen)
            wider = np.prod(norm(0, 2.0).pdf(seen))
            ratio = (moved + wider) / 2 / np.prod(norm.pdf(seen))
            terms.append(ratio / (k * (k + 1)))
        assert odds[t - 1] == pytest.approx(np.log(sum(terms) + 1 / (t + 1)))
        assert began[t - 1] == np.argmax(terms)


def test_nothing_that_changes_raises_few_alarms_at_any_time():
    rng = np.random.default_rng(0)
    alarms = [np.any(log_odds(rng.standard_normal(200))[0] >= np.log(20)) for _ in range(300)]
    # Ville: at most 5 %, plus two standard errors of 300 series
    assert np.mean(alarms) <= 0.05 + 2 * np.sqrt(0.05 * 0.95 / 300)


def test_a_right_extension_holds_and_one_call_is_as_many(wave, fitted_once):
    X, y = following(1)
    for some in (slice(0, 7), slice(7, 30), slice(30, 60)):
        told = wave.update(X[some], y[some])
    assert told.holds
    assert told.since is None
    assert wave.monitor_ is told
    assert list(told.table) == ["t", "y", "deviation", "e_value"]
    assert len(told.table) == 60
    assert "holds over 60 new measurements" in str(told)
    again = deepcopy(fitted_once).update(X, y)
    pd.testing.assert_frame_equal(again.table, told.table)


@pytest.mark.slow
def test_deviations_are_standard_normal_while_the_extension_is_right():
    z = []
    for seed in range(5):
        t, y = measured(N, seed)
        found = diagnosed(t[:, None], y)
        X, new = following(seed)
        z.append(found.update(X.to_numpy(), new).table["deviation"])
    z = np.concatenate(z)
    n = len(z)
    assert abs(z.mean()) < 3 / np.sqrt(n)
    assert abs(np.mean(z**2) - 1) < 3 * np.sqrt(2 / n)
    # independent of the one before
    assert abs(np.mean(z[1:] * z[:-1])) < 3 / np.sqrt(n)


def test_deviations_are_those_of_the_average_over_explanations():
    t = np.linspace(0, 10, N)
    y = 0.5 + t + 0.03 * t**2 + 0.3 * np.random.default_rng(4).standard_normal(N)
    found = diagnosed(t[:, None], y)
    average = found.extended_estimator_
    assert len(average.estimators_) > 1
    X, new = np.array([[11.0], [12.0]]), np.array([15.0, 17.0])
    weights, below = [], []
    for share, one in zip(average.weights_, average.estimators_, strict=True):
        eta, sigma = one.posterior_.eta(X)
        weights.append(np.full(len(eta), share / len(eta)))
        below.append(norm(eta, sigma[:, None] if sigma.ndim == 1 else sigma).cdf(new))
    weights, below = np.concatenate(weights), np.concatenate(below)
    deviations = found.update(X, new).table["deviation"]
    assert norm.cdf(deviations[0]) == pytest.approx(weights @ below[:, 0])
    # the first measurement says which explanation, and which draw, foresaw it
    told = []
    for one in average.estimators_:
        eta, sigma = one.posterior_.eta(X)
        sigma = sigma[:, None] if sigma.ndim == 1 else sigma
        told.append(norm(eta, sigma).pdf(new)[:, 0])
    weights = weights * np.concatenate(told)
    assert norm.cdf(deviations[1]) == pytest.approx(weights @ below[:, 1] / weights.sum())


@pytest.mark.parametrize("seed", [2, 3, 4])
def test_a_sensor_that_moved_is_told_soon_and_since_when(wave, seed):
    found = wave
    X, new = following(seed, shift=0.9, since=25)  # three standard deviations of the noise
    told = found.update(X, new)
    assert not told.holds
    assert 25 <= told.alarm_at <= 40
    assert abs(told.since - 25) <= 2
    assert len(told.table) == told.alarm_at + 1
    assert "no longer holds" in str(told)
    # what comes after an alarm does not take it back
    assert found.update(*following(seed + 50)).alarm_at == told.alarm_at


def test_a_calibrated_simulation_is_watched_too():
    t, y = measured(N, 5, wave=0.0)
    found = diagnosed(t[:, None], y, FEW)
    assert found.verdict_ == "adequate"
    X, new = measured(N + 60, 6, wave=0.0)
    assert found.update(X[N:, None], new[N:]).holds
    bent = found.update(X[N:, None], new[N:] + 0.1 * (X[N:] - 10) ** 2)
    assert not bent.holds


def test_counts():
    rate = hs.Simulator(
        lambda t, level: level + 0 * t, inputs={"t": (0, 100)}, parameters={"level": norm(2, 1)}
    )
    model = hs.PowerScaledSurrogate(
        rate, surrogate=hs.ExactSurrogate(), likelihood="poisson", random_state=0
    )
    t = np.arange(100.0)
    y = poisson.rvs(8.0, size=100, random_state=0).astype(float)
    found = hs.DiscrepancyDiagnosis(model, cv=None, n_replicates=39, random_state=0)
    found.fit(t[:40, None], y[:40])
    assert found.update(t[40:70, None], y[40:70]).holds
    assert not found.update(t[70:, None], 2 * y[70:]).holds


def test_several_outputs():
    def two(t, level):
        return level + t, level - t

    simulation = hs.Simulator(
        two, inputs={"t": (0, 40)}, parameters={"level": norm(0, 2)}, output=("a", "b")
    )
    rng = np.random.default_rng(0)
    t = np.linspace(0, 20, 60)
    Y = np.stack([1 + t, 1 - t], axis=1) + 0.3 * rng.standard_normal((60, 2))
    Y[45, 0] = np.nan
    model = hs.PowerScaledSurrogate(simulation, hs.ExactSurrogate(), n_draws=300, random_state=0)
    settings = {"exclude": FEW, "cv": None, "n_replicates": 39}
    found = hs.DiscrepancyDiagnosis(model, random_state=0, **settings)
    found.fit(t[:30, None], Y[:30])
    assert "holds over 0 new" in str(found.update(t[30:31, None], np.full((1, 2), np.nan)))
    told = found.update(t[31:50, None], Y[31:50])
    assert told.holds
    assert told.table["output"].value_counts().to_dict() == {"a": 18, "b": 19}
    shifted = found.update(t[50:, None], Y[50:] + np.array([0, 1.5]))
    assert not shifted.holds
    assert shifted.since >= 35


def test_bad_rows(wave):
    X, y = following(7)
    t, first = measured(N, 0)
    found = wave
    with pytest.raises(ValueError, match="inconsistent numbers of samples"):
        found.update(X, y[:-1])
    with pytest.raises(ValueError, match="NaN"):
        found.update(X, np.full(len(y), np.nan))
    assert not hasattr(found, "monitor_")
    assert found.update(X, y).holds
    # whatever it finds
    found.set_params(exclude=all_but("periodic")).fit(pd.DataFrame({"t": t}), first)
    assert not hasattr(found, "monitor_")
