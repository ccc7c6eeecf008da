"""Rows with weights in a diagnosis: what the estimators' fit means by them."""

import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm

import hybridsurrogate as hs
from hybridsurrogate.effects.registry import kinds

# causes of each sort: columns, a change of the simulation, of the noise, a process
WEIGHED = {"offset", "trend", "periodic", "gain", "constant", "noise"}


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
    )


def measured(effect, n=24, seed=0):
    random = np.random.default_rng(seed)
    t = np.linspace(0, 12, n)
    y = cooling(t, 63.0, 0.25, 20.0) + effect(t) + 0.5 * random.standard_normal(n)
    return t[:, None], y


def wave(t):
    return 0.6 * np.sin(2 * np.pi * t / 3.1)


def diagnosis(simulation, surrogate=None, **settings):
    model = hs.PowerScaledSurrogate(
        simulation,
        surrogate=surrogate or hs.ExactSurrogate(),
        n_draws=200,
        random_state=0,
        **settings.pop("model", {}),
    )
    exclude = sorted({*kinds()} - WEIGHED)
    settings = {"exclude": exclude, "cv": None, "n_replicates": 50, **settings}
    return hs.DiscrepancyDiagnosis(model, random_state=0, **settings)


def evidence(fitted):
    """Return the log evidence of each cause alone, over that of none."""
    first, *others = fitted.search_.candidates
    found = {(w.cause.name, w.cause.variant): w.log_evidence for w in others}
    return pd.Series(found).sort_index() - first.log_evidence


@pytest.mark.filterwarnings("ignore:.*measured rows are copies")
def test_a_row_of_weight_two_is_two_rows(simulator):
    X, y = measured(lambda t: 4 * wave(t))
    weights = np.tile([1.0, 2.0, 0.0, 1.0], 6)
    index = np.repeat(np.arange(24), weights.astype(int))
    weighted = diagnosis(simulator).fit(X, y, sample_weight=weights)
    twice = diagnosis(simulator).fit(X[index], y[index])
    ours, theirs = evidence(weighted), evidence(twice)
    # rows measured twice with the same error are autocorrelated
    alike = [name for name in ours.index if "autocorrelation" not in name[1]]
    assert len(alike) > 8
    np.testing.assert_allclose(ours[alike], theirs[alike], atol=0.02)
    assert weighted.best_cause_.kind == twice.best_cause_.kind == "periodic"
    first, other = (one.extended_estimator_.estimators_[0] for one in (weighted, twice))
    np.testing.assert_allclose(first.predict(X), other.predict(X), atol=0.1)
    skipped = weighted.causes_[weighted.causes_["note"].str.contains("rows have weights")]
    assert list(skipped["kind"]) == ["noise"]


def test_weights_of_one_change_nothing(simulator):
    X, y = measured(wave)
    plain = diagnosis(simulator, cv=2).fit(X, y)
    ones = diagnosis(simulator, cv=2).fit(X, y, sample_weight=np.ones(24))
    pd.testing.assert_frame_equal(plain.causes_, ones.causes_)
    assert (plain.p_value_, plain.verdict_) == (ones.p_value_, ones.verdict_)
    assert str(plain.gain_) == str(ones.gain_)
    np.testing.assert_array_equal(plain.predict(X), ones.predict(X))


def test_a_weight_of_zero_leaves_a_row_out(simulator):
    X, y = measured(wave)
    y[[3, 17]] = 9999.0
    weights = np.where(y > 1000, 0.0, 1.0)
    weights[5] = 2.0
    kept = np.flatnonzero(weights)
    fitted = diagnosis(simulator, cv=2).fit(pd.DataFrame(X, columns=["t"]), y, weights)
    rest = diagnosis(simulator, cv=2).fit(
        pd.DataFrame(X[kept], columns=["t"]), y[kept], weights[kept]
    )
    pd.testing.assert_frame_equal(fitted.causes_, rest.causes_)
    assert str(fitted.gain_) == str(rest.gain_)
    assert fitted.gain_.n_rows == 22


def test_the_scale_of_weights_does_not_change_the_p_value(simulator):
    X, y = measured(lambda t: 0 * t)
    weights = np.random.default_rng(1).uniform(0.5, 2, 24)
    found = [diagnosis(simulator).fit(X, y, sample_weight=s * weights) for s in (1.0, 10.0)]
    first, tenfold = (one.p_value_ for one in found)
    assert first > 0.05
    # T is ten times as large in the data and in every replicate
    assert tenfold == pytest.approx(first, abs=0.15)
    assert tenfold > 0.05


def test_weights_are_precisions(simulator):
    """Rows whose noise is sigma / sqrt(w), as a mean of w measurements has: no alarm."""
    random = np.random.default_rng(2)
    t = np.linspace(0, 12, 40)
    alarms = {"weighted": 0, "plain": 0}
    weights = np.where(t < 6, 25.0, 1.0)
    y = cooling(t, 63.0, 0.25, 20.0) + 2 * random.standard_normal(40) / np.sqrt(weights)
    for word, given in (("weighted", weights / weights.mean()), ("plain", None)):
        fitted = diagnosis(simulator).fit(t[:, None], y, sample_weight=given)
        alarms[word] = fitted.verdict_ != "adequate"
    assert alarms == {"weighted": False, "plain": True}


@pytest.mark.parametrize("likelihood", ["student-t", "poisson"])
def test_any_likelihood_takes_weights(simulator, likelihood):
    X, y = measured(wave)
    y = np.round(y) if likelihood == "poisson" else y
    weights = np.tile([1.0, 2.0], 12)
    settings = {"likelihood": likelihood}
    fitted = diagnosis(simulator, model=settings, max_causes=1).fit(X, y, sample_weight=weights)
    assert fitted.verdict_ in ("adequate", "named", "nearest", "ambiguous", "unexplained")
    assert np.isfinite(evidence(fitted)).all()


def test_all_else_takes_weights(simulator):
    """Runs, several causes, the scans over beta, new measurements, the report."""
    X, y = measured(lambda t: wave(t) + 2 * (t > 8))
    weights = np.tile([1.0, 2.0, 1.5], 8)
    runs = simulator.run(40, along=12, random_state=0)
    fitted = diagnosis(runs, hs.Kriging(), cv=2, max_causes=2).fit(X, y, weights)
    assert fitted.gain_.n_rows == 24
    fitted.update(X[:3], y[:3])
    assert "Verdict" in str(fitted.report())
    assert len(fitted.next_measurements(2, places=X)) == 2
    polynomial = diagnosis(simulator.run(100, random_state=0), hs.PolynomialChaos(degree=3))
    table = polynomial.fit(X, y, weights).beta_scan()
    assert np.isfinite(table["before"]).all()


@pytest.mark.parametrize(
    ("weights", "match"),
    [
        (np.zeros(24), "sums to zero"),
        (-np.ones(24), "finite and not negative"),
        (np.ones(23), r"shape \(24,\)"),
        ([np.nan] * 24, "finite"),
    ],
)
def test_bad_weights(simulator, weights, match):
    X, y = measured(wave)
    with pytest.raises(ValueError, match=match):
        diagnosis(simulator).fit(X, y, sample_weight=weights)
