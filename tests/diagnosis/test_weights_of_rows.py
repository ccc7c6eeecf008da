"""Rows with weights in a diagnosis: what the estimators' fit means by them."""

import numpy as np
import pandas as pd
import pytest
from agreement import assert_same_numbers
from scipy.stats import norm
from sklearn.base import clone

import hybridsurrogate as hs
from hybridsurrogate.effects.registry import kinds

# causes of each sort: columns, a change of the simulation, of the noise, a process
WEIGHED = {"offset", "trend", "periodic", "gain", "wrong-constant", "noise"}
# for folds, which search anew
FEW = sorted({*kinds()} - {"offset", "gain"})


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


def slow_wave(t):
    return 1.5 * np.sin(2 * np.pi * t / 5)


def diagnosis(simulation, surrogate=None, **settings):
    model = hs.PowerScaledSurrogate(
        simulation,
        surrogate=surrogate or hs.ExactSurrogate(),
        n_draws=200,
        random_state=0,
        **settings.pop("model", {}),
    )
    exclude = sorted({*kinds()} - WEIGHED)
    settings = {"exclude": exclude, "cv": None, "n_replicates": 39, **settings}
    return hs.DiscrepancyDiagnosis(model, random_state=0, **settings)


def evidence(fitted):
    """Return the log evidence of each cause alone, over that of none."""
    first, *others = fitted.search_.candidates
    found = {(w.cause.name, w.cause.variant): w.log_evidence for w in others}
    return pd.Series(found).sort_index() - first.log_evidence


def test_the_extension_is_fitted_with_the_estimators_weights(simulator):
    """There a row of weight two counts like two equal rows, as `fit` of the estimators says."""
    X, y = measured(slow_wave)
    weights = np.tile([1.0, 2.0, 0.0, 1.0], 6)
    index = np.repeat(np.arange(24), weights.astype(int))
    found = diagnosis(simulator).fit(X, y, sample_weight=weights)
    assert found.best_cause_.kind == "periodic"
    for fitted in (found.estimator_, found.extended_estimator_.estimators_[0]):
        twice = clone(fitted).fit(X[index], y[index])
        assert_same_numbers(twice.predict(X), fitted.predict(X))


def test_means_with_their_counts_estimate_what_the_single_rows_do(simulator):
    """A mean of w measurements has a variance of sigma^2 / w: least squares are the same."""
    random = np.random.default_rng(3)
    counts = np.tile([1, 4, 9], 8)
    t = np.linspace(0, 12, 24)
    single = np.repeat(t, counts)
    y = cooling(single, 63.0, 0.25, 20.0) + slow_wave(single)
    y += random.standard_normal(len(y))
    means = np.array([y[single == one].mean() for one in t])
    single_rows = diagnosis(simulator).fit(single[:, None], y)
    weights = counts / counts.mean()
    weighted = diagnosis(simulator).fit(t[:, None], means, sample_weight=weights)
    assert single_rows.best_cause_.kind == weighted.best_cause_.kind == "periodic"
    for name in ("amplitude", "period"):
        ours, theirs = (one.best_cause_.estimates[name] for one in (weighted, single_rows))
        assert ours[0] == pytest.approx(theirs[0], abs=0.2 * (theirs[2] - theirs[1]))
        # the noise is known from fewer rows
        assert 0.8 < (ours[2] - ours[1]) / (theirs[2] - theirs[1]) < 1.5


@pytest.mark.numbers
def test_weights_of_one_change_nothing(simulator):
    X, y = measured(wave)
    plain = diagnosis(simulator, cv=2, exclude=FEW).fit(X, y)
    ones = diagnosis(simulator, cv=2, exclude=FEW).fit(X, y, sample_weight=np.ones(24))
    assert str(plain.gain_) == str(ones.gain_)
    plain = diagnosis(simulator).fit(X, y)
    ones = diagnosis(simulator).fit(X, y, sample_weight=np.ones(24))
    pd.testing.assert_frame_equal(plain.causes_, ones.causes_)
    assert (plain.p_value_, plain.verdict_) == (ones.p_value_, ones.verdict_)
    np.testing.assert_array_equal(plain.predict(X), ones.predict(X))


@pytest.mark.numbers
def test_a_weight_of_zero_leaves_a_row_out(simulator):
    X, y = measured(wave)
    y[[3, 17]] = 9999.0
    weights = np.where(y > 1000, 0.0, 1.0)
    weights[5] = 2.0
    kept = np.flatnonzero(weights)
    frame = pd.DataFrame(X, columns=["t"])
    for settings in ({}, {"cv": 2, "exclude": FEW}):
        fitted = diagnosis(simulator, **settings).fit(frame, y, weights)
        rest = diagnosis(simulator, **settings).fit(frame.iloc[kept], y[kept], weights[kept])
        pd.testing.assert_frame_equal(fitted.causes_, rest.causes_)
    assert str(fitted.gain_) == str(rest.gain_)
    assert fitted.gain_.n_rows == 22


def test_the_unit_of_weights_says_nothing(simulator):
    """Ten times the weight makes no ten measurements of one."""
    X, y = measured(lambda t: 0 * t)
    weights = np.random.default_rng(1).uniform(0.5, 2, 24)
    first, tenfold = (diagnosis(simulator).fit(X, y, s * weights) for s in (1.0, 10.0))
    assert first.verdict_ == tenfold.verdict_ == "adequate"
    assert tenfold.p_value_ == pytest.approx(first.p_value_, abs=0.1)
    np.testing.assert_allclose(evidence(tenfold), evidence(first), atol=0.1)


def test_weights_are_precisions(simulator):
    """Rows whose noise is sigma / sqrt(w), as a mean of w measurements has: no alarm."""
    random = np.random.default_rng(2)
    t = np.linspace(0, 12, 40)
    alarms = {}
    weights = np.where(t < 6, 25.0, 1.0)
    y = cooling(t, 63.0, 0.25, 20.0) + 2 * random.standard_normal(40) / np.sqrt(weights)
    for word, given in (("weighted", weights), ("plain", None)):
        fitted = diagnosis(simulator).fit(t[:, None], y, sample_weight=given)
        alarms[word] = fitted.verdict_ != "adequate"
    assert alarms == {"weighted": False, "plain": True}


@pytest.mark.parametrize(
    "likelihood", ["poisson", pytest.param("student-t", marks=pytest.mark.slow)]
)
def test_any_likelihood_takes_weights(simulator, likelihood):
    X, y = measured(lambda t: 0 * t)
    y = np.round(y) if likelihood == "poisson" else y
    weights = np.tile([1.0, 2.0], 12)
    exclude = sorted({*kinds()} - {"offset", "trend"})
    settings = {"model": {"likelihood": likelihood}, "exclude": exclude}
    fitted = diagnosis(simulator, **settings).fit(X, y, sample_weight=weights)
    assert fitted.verdict_ == "adequate"
    assert np.isfinite(evidence(fitted)).all()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::hybridsurrogate.exceptions.DiagnosisWarning")
def test_all_else_takes_weights(simulator):
    """Runs, several causes, the scans over beta, new measurements, the report."""
    X, y = measured(slow_wave)
    weights = np.tile([1.0, 2.0, 1.5], 8)
    # the folds of `test_weights_of_one_change_nothing` have weights, too
    fitted = diagnosis(simulator, max_causes=2).fit(X, y, weights)
    fitted.update(X[:3], y[:3])
    assert "Is something wrong?" in str(fitted.report(full=True))
    assert len(fitted.next_measurements(2, places=X)) == 2
    runs = simulator.run(40, along=12, random_state=0)
    assert diagnosis(runs, hs.Kriging()).fit(X, y, weights).best_cause_.kind == "periodic"
    model = diagnosis(simulator.run(60, random_state=0), hs.PolynomialChaos(degree=3))
    table = model.fit(X, y, weights).beta_scan(X, y, [0.3, 0.7])
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
