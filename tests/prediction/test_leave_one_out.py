"""Leave-one-out scores of rows that are equal, and of weighted ones."""

import time
from dataclasses import replace

import numpy as np
import pytest
from agreement import assert_same_numbers
from scipy import stats
from scipy.stats import multivariate_normal, uniform
from sklearn.base import clone

import hybridsurrogate as hs
from hybridsurrogate.prediction.leave_one_out import without_each

LINE = hs.PolynomialChaos(1)


@pytest.fixture(scope="module")
def copies():
    """Eight rows, each twice."""
    rng = np.random.default_rng(0)
    t = np.linspace(0.2, 3.8, 8)
    return np.repeat(t, 2)[:, None], np.repeat(100 - 4.5 * t**2 + rng.normal(0, 2, 8), 2)


def models(simulation):
    return [
        hs.PowerScaledSurrogate(surrogate=hs.PolynomialChaos(2), n_draws=4000, random_state=0),
        hs.PowerScaledSurrogate(simulation, surrogate=LINE, n_draws=4000, random_state=0),
        hs.PredictiveWeightedSurrogate(
            simulation, surrogate=hs.PolynomialChaos(2), n_draws=4000, random_state=0
        ),
    ]


@pytest.mark.parametrize("which", [0, 1, 2], ids=["measured", "both", "mixture"])
def test_one_of_two_equal_rows_is_left_out(simulation, copies, which):
    X, y = copies
    model = models(simulation)[which].fit(X, y)
    loo = model.loo()
    assert_same_numbers(loo.pointwise[::2], loo.pointwise[1::2])
    for i in (0, 6, 14):
        rest = np.arange(16) != i
        exact = clone(model).fit(X[rest], y[rest]).log_predictive_density(X[[i]], y[[i]])[0]
        assert loo.pointwise[i] == pytest.approx(exact, abs=0.1)


def test_a_row_of_weight_two_is_two_rows_there_too(copies):
    X, y = copies
    model = hs.PowerScaledSurrogate(surrogate=hs.PolynomialChaos(2), random_state=0)
    twice = clone(model).fit(X, y).loo()
    weighted = clone(model).fit(X[::2], y[::2], sample_weight=np.full(8, 2.0)).loo()
    assert_same_numbers(weighted.pointwise, twice.pointwise[::2])
    assert weighted.elpd == pytest.approx(twice.elpd)
    assert weighted.standard_error == pytest.approx(twice.standard_error)


def test_copies_of_different_weights_leave_their_own(copies):
    X, y = copies
    weights = np.tile([0.25, 0.75], 8)
    model = hs.PowerScaledSurrogate(surrogate=hs.PolynomialChaos(2), n_draws=4000, random_state=0)
    pointwise = clone(model).fit(X, y, sample_weight=weights).loo().pointwise
    for i in (0, 1):
        less = np.where(np.arange(16) == i, 0.0, weights)
        exact = clone(model).fit(X, y, sample_weight=less).log_predictive_density(X[[i]], y[[i]])[0]
        assert pointwise[i] == pytest.approx(exact, abs=0.05)


def test_a_bad_row_is_fitted_anew_without_one_copy():
    rng = np.random.default_rng(1)
    t = np.linspace(0, 1, 12)
    y = t + 0.05 * rng.standard_normal(12)
    y[11] += 5
    X, y = np.append(t, t[11])[:, None], np.append(y, y[11])
    model = hs.PowerScaledSurrogate(surrogate=LINE, n_draws=8000, random_state=0)
    loo = clone(model).fit(X, y, sample_weight=[*np.ones(11), 0.1, 1]).loo()
    assert loo.khat[12] > 0.7
    without = clone(model).fit(X[:-1], y[:-1], sample_weight=[*np.ones(11), 0.1])
    exact = without.log_predictive_density(X[-1:], y[-1:])[0]
    assert loo.pointwise[12] == pytest.approx(exact, rel=0.1)


def test_few_draws_leave_fewer_rows_to_importance_sampling():
    """A k-hat of 0.6 is fine with thousands of draws, and off by 1.4 nats with a hundred."""
    x = np.linspace(0, 4, 8)
    X, y = x[:, None], 1 + 1.2 * x + 0.1 * np.cos(9 * x)
    noise = stats.halfnorm(scale=y.std())
    model = hs.PowerScaledSurrogate(surrogate=LINE, noise_prior=noise, random_state=0)
    exact = np.empty(8)
    for i in range(8):
        rest = np.arange(8) != i
        fit = clone(model).set_params(n_draws=20_000).fit(X[rest], y[rest])
        exact[i] = fit.log_predictive_density(X[[i]], y[[i]])[0]
    misses = []
    for seed in range(12):
        loo = clone(model).set_params(n_draws=100, random_state=seed).fit(X, y).loo()
        between = (loo.khat > 0.5) & (loo.khat <= 0.7)
        misses.extend((loo.pointwise - exact)[between])
        assert loo.n_refits == np.sum(loo.khat > 0.5)
    assert len(misses) > 5
    assert np.sqrt(np.mean(np.square(misses))) < 0.5


def test_stacking_does_not_depend_on_whether_copies_are_equal(simulation, copies):
    X, y = copies
    near = y + np.tile([0, 1e-9], 8)
    model = hs.PredictiveWeightedSurrogate(
        simulation, surrogate=LINE, beta="stacking", n_draws=2000, random_state=0
    )
    equal, apart = (clone(model).fit(X, outputs).beta_ for outputs in (y, near))
    assert equal == pytest.approx(apart, abs=0.03)


# ------------------------------------------------------------------ coefficients integrated out


@pytest.fixture(scope="module")
def with_process():
    random = np.random.default_rng(0)
    t = np.linspace(0, 4, 40)
    y = 10 * np.exp(-0.6 * t) + np.sin(3 * t) + 0.3 * random.standard_normal(40)
    simulator = hs.Simulator(decay, inputs={"t": (0, 4)}, parameters={"rate": uniform(0.2, 1)})
    model = hs.KennedyOHaganSurrogate(simulator.run(60, random_state=0), random_state=0)
    return model.fit(t[:, None], y), t, y


def decay(t, rate):
    return 10 * np.exp(-rate * t)


def test_each_row_given_the_others_is_a_ratio_of_joint_densities(with_process):
    model, _, _ = with_process
    fit = model.inference_
    problem = replace(fit.problem, weights=np.tile([1.0, 2.0], 20))
    draws, index = fit.second.take(np.arange(3)), np.array([0, 1, 20])
    predicted, removed = without_each(problem, draws, index, np.ones(3))
    plain = replace(draws, effect_coefficients=np.zeros_like(draws.effect_coefficients))
    eta, scale = plain.eta(problem.X)
    columns = draws.model.added(problem.X, draws.values) * draws.model.column_sd
    for s in range(3):
        shared = columns[s] @ columns[s].T

        def log_density(weights, rows, s=s, shared=shared):
            w, noise = weights[rows], scale[s][rows] ** 2
            covariance = shared[np.ix_(rows, rows)] + np.diag(noise / w)
            value = multivariate_normal.logpdf(problem.y[rows], eta[s][rows], covariance)
            # N(y; f, s^2)^w over N(y; f, s^2 / w)
            return value + np.sum(0.5 * (1 - w) * np.log(2 * np.pi * noise) - 0.5 * np.log(w))

        for k, i in enumerate(index):
            less = problem.weights.copy()
            less[i] -= 1
            with_it = log_density(problem.weights, np.arange(40))
            without = log_density(less, np.flatnonzero(less > 0))
            assert removed[s, k] == pytest.approx(with_it - without, abs=1e-6)
            # what one unit of weight gave is the prediction of a measurement given the rest
            assert predicted[s, k] == pytest.approx(removed[s, k], abs=1e-9)


def test_a_process_needs_few_fits_without_a_row(with_process):
    model, t, y = with_process
    start = time.process_time()
    loo = model.loo()
    # 23 s with two inputs and 44 s under a Student-t, before; half a second here
    assert time.process_time() - start < 2
    assert loo.n_refits <= 1
    for i in (0, 20, 39):
        rest = np.arange(40) != i
        again = clone(model).set_params(n_draws=2000).fit(t[rest, None], y[rest])
        exact = again.log_predictive_density(t[[i], None], y[[i]])[0]
        assert loo.pointwise[i] == pytest.approx(exact, abs=0.15)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("estimator", "far"),
    [
        (hs.PowerScaledSurrogate, 0.0),
        (hs.PowerScaledSurrogate, 4.0),
        (hs.KennedyOHaganSurrogate, 0.0),
    ],
    ids=["scaled", "scaled, an outlier", "process"],
)
def test_moves_from_the_draws_of_a_fit_agree_with_fits_without_the_row(estimator, far):
    random = np.random.default_rng(4)
    t = np.sort(random.uniform(0, 4, 25))
    y = 10 * np.exp(-0.6 * t) + 0.5 * random.standard_normal(25)
    y[12] += far
    simulator = hs.Simulator(decay, inputs={"t": (0, 4)}, parameters={"rate": uniform(0.2, 1)})
    model = estimator(simulator.run(40, random_state=0), random_state=0)
    pointwise = clone(model).fit(t[:, None], y).loo().pointwise
    for i in (0, 6, 12, 24):
        rest = np.arange(25) != i
        again = clone(model).set_params(n_draws=2000).fit(t[rest, None], y[rest])
        exact = again.log_predictive_density(t[[i], None], y[[i]])[0]
        # of an outlier's density a tenth: its draws scatter as much
        assert pointwise[i] == pytest.approx(exact, abs=0.1, rel=0.1)


def test_rows_of_weight_zero_change_nothing():
    random = np.random.default_rng(5)
    t = np.linspace(0, 4, 12)
    y = 10 * np.exp(-0.6 * t) + 0.5 * random.standard_normal(12)
    simulator = hs.Simulator(decay, inputs={"t": (0, 4)}, parameters={"rate": uniform(0.2, 1)})
    runs = simulator.run(20, random_state=0)
    model = hs.KennedyOHaganSurrogate(runs, n_draws=200, random_state=0)
    weights = np.arange(12) % 4
    kept = weights > 0
    whole = clone(model).fit(t[:, None], y, sample_weight=weights).loo()
    rest = clone(model).fit(t[kept, None], y[kept], sample_weight=weights[kept]).loo()
    assert_same_numbers(whole.pointwise[kept], rest.pointwise)
    assert whole.elpd == pytest.approx(rest.elpd)
    assert np.isfinite(whole.pointwise).all()
