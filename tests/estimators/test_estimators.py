"""Both estimators: predictions, draws, and what they say about data they cannot use."""

import copy

import numpy as np
import pandas as pd
import pytest
from agreement import assert_same_numbers
from conftest import fall
from mixing import at_weight
from scipy import stats

import hybridsurrogate as hs

N_DRAWS = 400


@pytest.fixture(params=["fitted", "fitted_mixture"])
def model(request):
    return request.getfixturevalue(request.param)


@pytest.fixture(scope="module")
def exact(simulator, measured):
    """The fall without an emulator: its mean is known for every draw of gravity."""
    return hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=N_DRAWS, random_state=0
    ).fit(*measured)


# ---------------------------------------------------------------------------------- predictions


def test_shapes(model, measured):
    X = measured[0][:7]
    mean, sd = model.predict(X, return_std=True)
    lower, upper = model.predict_interval(X)
    for values in (model.predict(X), mean, sd, lower, upper):
        assert values.shape == (7,)
    assert model.sample_predictive_mean(X).shape == (N_DRAWS, 7)
    assert model.sample_posterior_predictive(X).shape == (N_DRAWS, 7)
    for n_draws in (1, 33, 3 * N_DRAWS):
        assert model.sample_predictive_mean(X, n_draws).shape == (n_draws, 7)
        assert model.sample_posterior_predictive(X, n_draws).shape == (n_draws, 7)
    with pytest.raises(ValueError, match="n_draws == 0, must be >= 1"):
        model.sample_predictive_mean(X, 0)


@pytest.mark.parametrize("method", ["sample_predictive_mean", "sample_posterior_predictive"])
def test_seeds_of_samples(model, measured, method):
    def sample(seed):
        return getattr(model, method)(measured[0], n_draws=50, random_state=seed)

    np.testing.assert_array_equal(sample(3), sample(3))
    assert (sample(3) != sample(4)).any()


def test_all_draws_of_one_posterior_once(fitted, measured):
    X, _ = measured
    draws = fitted.sample_predictive_mean(X)
    np.testing.assert_allclose(draws.mean(axis=0), fitted.predict(X))
    np.testing.assert_array_equal(draws, fitted.sample_predictive_mean(X, random_state=9))


def test_predictions_agree_with_draws(model, measured):
    X = measured[0][::6]
    draws = model.sample_posterior_predictive(X, n_draws=40_000, random_state=0)
    mean, sd = model.predict(X, return_std=True)
    error = sd / np.sqrt(N_DRAWS)
    assert np.abs((draws.mean(axis=0) - mean) / error).max() < 4
    np.testing.assert_allclose(draws.std(axis=0), sd, rtol=0.05)
    for level in (0.5, 0.9):
        lower, upper = model.predict_interval(X, level=level)
        inside = np.mean((draws > lower) & (draws < upper), axis=0)
        np.testing.assert_allclose(inside, level, atol=0.01)
        np.testing.assert_allclose(np.mean(draws < lower, axis=0), (1 - level) / 2, atol=0.01)


def test_interval_covers_new_measurements(model):
    rng = np.random.default_rng(2)
    t = rng.uniform(0.1, 3.9, 1000)
    y = fall(t, 9.3) + rng.normal(0, 1, 1000)
    lower, upper = model.predict_interval(t[:, None], level=0.9)
    assert 0.86 < hs.scoring.coverage(y, lower, upper) < 0.95


@pytest.mark.parametrize("level", [0, 1, -0.1, 2])
def test_level_of_an_interval(fitted, level):
    with pytest.raises(ValueError, match="level =="):
        fitted.predict_interval([[1.0]], level=level)


def test_mean_of_a_log_normal_is_in_the_units_of_y(simulator, measured):
    X, _ = measured
    rng = np.random.default_rng(3)
    y = fall(X[:, 0], 9.3) * np.exp(rng.normal(0, 0.2, len(X)))
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), likelihood="lognormal", random_state=0
    ).fit(X, y)
    gravity, sigma = model.posterior_.values, model.posterior_.sigma[:, None]
    medians = fall(X[:, 0], gravity)
    np.testing.assert_allclose(
        model.predict(X), np.mean(medians * np.exp(sigma**2 / 2), axis=0), rtol=1e-9
    )
    lower, upper = model.predict_interval(X)
    assert (lower > 0).all()
    assert 0.75 < hs.scoring.coverage(y, lower, upper) <= 1
    assert sigma.mean() == pytest.approx(0.2, abs=0.08)


# ------------------------------------------------------------------------------ log densities


def test_log_density_of_one_draw_is_that_of_scipy(exact, measured):
    X, y = measured
    one = copy.copy(exact)
    one.posterior_ = exact.posterior_.take(np.array([7]))
    gravity, sigma = one.posterior_.values[0, 0], one.posterior_.sigma[0]
    expected = stats.norm(fall(X[:, 0], gravity), sigma).logpdf(y)
    np.testing.assert_allclose(one.log_predictive_density(X, y), expected)


def test_log_density_is_the_mean_density_of_all_draws(exact, measured):
    X, y = measured
    gravity, sigma = exact.posterior_.values, exact.posterior_.sigma[:, None]
    density = stats.norm(fall(X[:, 0], gravity), sigma).pdf(y)
    expected = np.log(density.mean(axis=0))
    np.testing.assert_allclose(exact.log_predictive_density(X, y), expected)
    assert exact.score(X, y) == pytest.approx(expected.mean())
    weight = np.arange(len(y))
    assert exact.score(X, y, sample_weight=weight) == pytest.approx(
        np.sum(weight * expected) / weight.sum()
    )


@pytest.mark.parametrize("beta", [0.0, 0.3, 1.0])
def test_predictive_weighting_mixes_densities_exactly(fitted_mixture, measured, beta):
    X, y = measured
    simulated, free = (at_weight(fitted_mixture, b).log_predictive_density(X, y) for b in (1, 0))
    mixed = at_weight(fitted_mixture, beta)
    np.testing.assert_allclose(
        np.exp(mixed.log_predictive_density(X, y)),
        beta * np.exp(simulated) + (1 - beta) * np.exp(free),
    )
    # and the mean and variance are those of the mixture
    means, sds = zip(
        *(at_weight(fitted_mixture, b).predict(X, return_std=True) for b in (1, 0)),
        strict=True,
    )
    mean, sd = mixed.predict(X, return_std=True)
    weights = np.array([[beta], [1 - beta]])
    expected = np.sum(weights * means, axis=0)
    np.testing.assert_allclose(mean, expected)
    second = np.sum(weights * (np.square(sds) + np.square(means)), axis=0)
    np.testing.assert_allclose(sd, np.sqrt(second - expected**2), rtol=1e-6)


def test_predictive_weighting_draws_from_both_in_proportion(simulation, measured):
    X, y = measured
    # measured data far from the simulation: every draw shows where it came from
    model = hs.PredictiveWeightedSurrogate(
        simulation, surrogate=hs.PolynomialChaos(2), beta=0.25, random_state=0
    )
    with pytest.warns(hs.ExtrapolationWarning, match="outside all that was simulated"):
        model.fit(X, y + 500)
    simulated = at_weight(model, 1).predict(X).mean()
    free = at_weight(model, 0).predict(X).mean()
    assert free - simulated > 100
    draws = model.sample_predictive_mean(X, n_draws=4000, random_state=0).mean(axis=1)
    share = np.mean(np.abs(draws - simulated) < np.abs(draws - free))
    # five standard deviations of a binomial
    assert share == pytest.approx(0.25, abs=5 * np.sqrt(0.25 * 0.75 / 4000))


def test_predictive_weighting_without_a_simulation_is_the_measured_surrogate(measured):
    X, y = measured
    models = [
        hs.PredictiveWeightedSurrogate(beta=beta, n_draws=100, random_state=0).fit(X, y)
        for beta in (0.1, 1.0)
    ]
    assert_same_numbers(models[0].predict(X), models[1].predict(X))
    assert models[0].simulation_posterior_ is None
    assert set(models[0].diagnostics_) == {"measured"}


def test_predictive_weighting_of_an_exact_simulation(simulator, measured):
    model = hs.PredictiveWeightedSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=100, random_state=0
    ).fit(*measured)
    assert model.simulation_posterior_.coefficients.shape == (100, 0)
    assert model.measured_posterior_.coefficients.shape == (100, 4)
    assert model.predict([[2.0]]) == pytest.approx(fall(2.0, 9.3), abs=1.5)


# ------------------------------------------------------------------------------ causes, draws


@pytest.mark.parametrize("n_draws", [120, 333])
@pytest.mark.parametrize("sampler", ["auto", "importance", "emcee"])
def test_number_of_draws(simulation, measured, n_draws, sampler):
    model = hs.PowerScaledSurrogate(
        simulation,
        surrogate=hs.PolynomialChaos(2),
        sampler=sampler,
        n_draws=n_draws,
        random_state=0,
    ).fit(*measured)
    for posterior in (model.posterior_, model.first_step_):
        assert posterior.n_draws == n_draws
        assert posterior.values.shape == (n_draws, 1)
        assert posterior.coefficients.shape == (n_draws, 6)
    expected = "emcee" if sampler == "emcee" else "importance"
    assert model.diagnostics_.sampler == expected
    assert model.diagnostics_.second_step == "grid"


def test_diagnostics_of_easy_problems(exact, fitted, fitted_mixture):
    assert exact.diagnostics_.second_step == "none"
    assert fitted.diagnostics_.khat < 0.7
    assert fitted.diagnostics_.effective_draws > N_DRAWS / 2
    assert fitted.diagnostics_.n_modes == 1
    assert set(fitted_mixture.diagnostics_) == {"measured", "simulation"}


def constant_fall(t, gravity, drop_height):
    return drop_height - gravity / 2 * t**2


@pytest.fixture(scope="module")
def with_constant():
    simulator = hs.Simulator(
        constant_fall,
        inputs={"t": (0, 4)},
        parameters={"gravity": hs.truncated_normal(9.8, 1, 5, 15)},
        assumed={"drop_height": hs.Assumed(150, stats.uniform(140, 20))},
    )
    return simulator.run(64, random_state=0)


@pytest.mark.parametrize(
    ("effect", "likelihood"),
    [
        (hs.Offset(), "normal"),
        (hs.Trend("t"), "normal"),
        (hs.Periodic("t"), "normal"),
        (hs.Step("t"), "normal"),
        (hs.Bump("t"), "normal"),
        (hs.Gain(), "normal"),
        (hs.WrongConstant("drop_height"), "normal"),
        (hs.ParameterDrift("gravity", "t"), "normal"),
        (hs.MissingInput("humidity"), "normal"),
        (hs.GaussianProcessDiscrepancy(), "normal"),
        (hs.Trend("t", degree=2), "normal"),
        (hs.Periodic("t", harmonics=2), "normal"),
        (hs.Ramp("t"), "normal"),
        (hs.Decay("t"), "normal"),
        (hs.Saturation("t"), "normal"),
        (hs.Delay("t"), "normal"),
        (hs.ParameterDrift("gravity", "humidity"), "normal"),
        (hs.ParameterDrift("gravity", "t", shape="logistic"), "normal"),
        (hs.ParameterDrift("gravity", "t", shape="periodic"), "normal"),
        (hs.MissingInput("humidity", shape="quadratic"), "normal"),
        (hs.Interaction("t", "humidity"), "normal"),
        (hs.Noise("t"), "normal"),
        (hs.Noise("t"), "lognormal"),
        (hs.Delay("t"), "lognormal"),
        (hs.Offset(), "lognormal"),
        (hs.Gain(), "lognormal"),
        (hs.ParameterDrift("gravity", "t"), "lognormal"),
    ],
    ids=lambda value: getattr(value, "kind", value),
)
@pytest.mark.filterwarnings("ignore::hybridsurrogate.exceptions.SamplingWarning")
def test_every_kind_of_cause_is_accepted(with_constant, measured, effect, likelihood):
    # none of them is there: they must not hurt, and some have nothing to hold on to
    X, y = measured[0], measured[1] + 50
    frame = pd.DataFrame({"t": X[:, 0], "humidity": np.cos(5 * X[:, 0])})
    model = hs.PowerScaledSurrogate(
        with_constant,
        surrogate=hs.PolynomialChaos(2),
        likelihood=likelihood,
        effects=[effect],
        n_draws=100,
        random_state=0,
    ).fit(frame, y)
    mean, sd = model.predict(frame, return_std=True)
    assert np.sqrt(np.mean((mean - y) ** 2)) < 3
    assert np.isfinite(sd).all()
    estimates = model.posterior_.estimates(0)
    assert estimates
    assert all(draws.shape == (100,) for draws in estimates.values())


def test_gain_of_one_number_counts(simulation, measured):
    class Doubled(hs.Cause):
        def gain(self, X, theta):
            return 2.0

        def noise(self, X, theta):
            return 3.0

    X, y = measured
    plain, doubled = (
        hs.PowerScaledSurrogate(
            simulation,
            surrogate=hs.PolynomialChaos(2),
            beta=1.0,
            effects=effects,
            n_draws=1000,
            random_state=0,
        ).fit(X, values)
        for effects, values in (((), y), ([Doubled()], 2 * y))
    )
    np.testing.assert_allclose(doubled.predict(X), 2 * plain.predict(X), atol=1)
    # twice the scatter, seen through three times the noise
    ratio = doubled.posterior_.sigma.mean() / plain.posterior_.sigma.mean()
    assert ratio == pytest.approx(2 / 3, rel=0.1)
