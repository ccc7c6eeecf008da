import warnings

import numpy as np
import pytest
from agreement import assert_same_numbers
from scipy import special, stats

import hybridsurrogate as hs
from hybridsurrogate.arviz_groups import arviz_groups
from hybridsurrogate.model.posterior import Diagnostics, Posterior

GOOD = Diagnostics("importance", -0.2, 900.0, np.nan, 1)


def test_good_draws_raise_no_warning():
    assert GOOD.problems() == []
    GOOD.warn()


@pytest.mark.parametrize(
    ("diagnostics", "match"),
    [
        (Diagnostics("importance", 0.83, 900.0, np.nan, 1), r"k-hat of step 1 is 0.83 \(limit 0.7"),
        (Diagnostics("emcee", np.nan, 31.0, 120.0, 1), "step 1 has only 31 effective draws"),
        (
            Diagnostics("importance", 0.1, 900.0, np.nan, 1, "importance", 1.2, 50.0),
            "k-hat of step 2 is 1.20",
        ),
        (
            Diagnostics("importance", 0.1, 900.0, np.nan, 1, "importance", 0.1, 3.2),
            "step 2 rests on 3.2 effective proposals",
        ),
    ],
)
def test_doubtful_draws_warn_with_the_number_and_its_limit(diagnostics, match):
    with pytest.warns(hs.SamplingWarning, match=match) as record:
        diagnostics.warn()
    assert ("sampler='emcee'" in str(record[0].message)) == (diagnostics.sampler != "emcee")


def test_fit_warns_where_it_was_called(simulation, measured):
    model = hs.PowerScaledSurrogate(
        simulation,
        surrogate=hs.PolynomialChaos(2),
        sampler=hs.EnsembleSampler(max_steps=20),
        random_state=0,
    )
    with pytest.warns(hs.SamplingWarning, match="stopped after 20 steps") as record:
        model.fit(*measured)
    assert record[0].filename == __file__


def test_take_keeps_draws_together(fitted):
    posterior = fitted.posterior_
    index = np.array([5, 0, 5])
    some = posterior.take(index)
    assert some.n_draws == 3
    for name in ("values", "sigma", "coefficients", "effect_coefficients"):
        np.testing.assert_array_equal(getattr(some, name), getattr(posterior, name)[index])


def test_prediction_in_blocks_is_the_same(fitted, measured, monkeypatch):
    X, _ = measured
    eta, noise = fitted.posterior_.eta(X)
    monkeypatch.setattr("hybridsurrogate.model.posterior.LARGE_BLOCK", 5000)
    again, noise_again = fitted.posterior_.eta(X)
    np.testing.assert_allclose(eta, again, rtol=1e-12)
    assert_same_numbers(noise, noise_again)


def test_prediction_by_factors_is_that_by_features(simulation, measured, monkeypatch):
    X, y = measured
    posterior = (
        hs.PowerScaledSurrogate(
            simulation,
            surrogate=hs.PolynomialChaos(2),
            effects=[hs.Trend("t")],
            n_draws=100,
            random_state=0,
        )
        .fit(X, y)
        .posterior_
    )
    parts = posterior.model.parts(X, posterior.values)
    expected = parts.known + np.einsum("jnp,jp->jn", parts.features, posterior.coefficients)
    expected += np.einsum("jnq,jq->jn", parts.columns, posterior.effect_coefficients)
    # the features of all draws are not formed
    monkeypatch.delattr("hybridsurrogate.model.observation.MeasuredModel.simulated")
    eta, noise = posterior.eta(X)
    np.testing.assert_allclose(eta, expected, rtol=1e-12)
    assert_same_numbers(noise, np.repeat(posterior.sigma[:, None], len(X), axis=1))


def test_memory_for_intervals_is_bounded(fitted, measured, monkeypatch):
    X, y = measured
    expected = fitted.interval_holds(X, y, [0.5, 0.9])
    monkeypatch.setattr("hybridsurrogate.prediction.mixture.LARGE_BLOCK", 5 * fitted.n_draws)
    lengths, eta = [], Posterior.eta
    monkeypatch.setattr(Posterior, "eta", lambda p, X: (lengths.append(len(X)), eta(p, X))[1])
    assert_same_numbers(fitted.interval_holds(X, y, [0.5, 0.9]), expected)
    assert max(lengths) == 5


def test_named_draws(fitted):
    named = fitted.posterior_.named()
    assert list(named) == ["gravity", "sigma", "coefficients"]
    assert named["gravity"].shape == named["sigma"].shape == (400,)
    # two variables up to degree 2 are six terms
    assert named["coefficients"].shape == (400, 6)


def test_names_of_causes_do_not_hide_each_other(simulation, measured):
    X, y = measured
    model = hs.PowerScaledSurrogate(
        simulation,
        surrogate=hs.PolynomialChaos(2),
        effects=[hs.Step("t"), hs.Bump("t")],
        n_draws=100,
        random_state=0,
    )
    with warnings.catch_warnings():
        # nothing steps or bumps here: how well that is sampled is beside the point
        warnings.simplefilter("ignore", hs.SamplingWarning)
        named = model.fit(X, y).posterior_.named()
    assert set(named) == {
        *("gravity", "step_0_location", "bump_1_location", "width"),
        *("sigma", "coefficients", "effect_coefficients"),
    }
    assert named["effect_coefficients"].shape == (100, 2)


def group(data, name):
    """A group of an InferenceData or of a DataTree."""
    return data[name]


def test_to_arviz_has_the_groups_of_arviz(fitted, measured, arviz):
    X, y = measured
    data = fitted.to_arviz()
    posterior = group(data, "posterior")
    assert posterior["gravity"].dims == ("chain", "draw")
    assert posterior["gravity"].shape == (1, 400)
    assert posterior["coefficients"].shape == (1, 400, 6)
    np.testing.assert_array_equal(posterior["sigma"][0], fitted.posterior_.sigma)
    np.testing.assert_array_equal(group(data, "observed_data")["y"], y)
    pointwise = group(data, "log_likelihood")["y"]
    assert pointwise.shape == (1, 400, len(y))
    np.testing.assert_allclose(
        np.log(np.mean(np.exp(np.asarray(pointwise)[0]), axis=0)),
        fitted.log_predictive_density(X, y),
    )
    drawn = np.asarray(group(data, "posterior_predictive")["y"])[0]
    mean, sd = fitted.predict(X, return_std=True)
    assert drawn.shape == (400, len(y))
    assert np.abs((drawn.mean(axis=0) - mean) / (sd / 20)).max() < 4.5


def test_arviz_summarises_what_it_is_given(fitted, arviz):
    table = arviz.summary(fitted.to_arviz(), var_names=["gravity", "sigma"], kind="stats")
    assert list(table.index) == ["gravity", "sigma"]
    assert float(table.loc["gravity", "mean"]) == pytest.approx(
        fitted.posterior_.values.mean(), abs=0.02
    )


def test_to_arviz_of_a_mixture(fitted_mixture, measured):
    data = fitted_mixture.to_arviz()
    # coefficients and gravity belong to one of the two surrogates only
    assert set(group(data, "posterior").data_vars) == {"sigma"}
    assert group(data, "log_likelihood")["y"].shape == (1, 400, len(measured[1]))


def test_to_arviz_of_weights_that_change_with_the_row():
    """Each row has the draws that its own weight asks for, not those of the mean weight."""
    simulator = hs.Simulator(
        lambda t, level: level + 0 * t, {"t": (0, 10)}, {"level": stats.norm(0, 2)}
    )
    t = np.linspace(0, 10, 40)[:, None]
    y = 3 * np.sin(t[:, 0]) + 0.1 * np.random.default_rng(0).standard_normal(40)
    model = hs.PredictiveWeightedSurrogate(
        simulator.run(64, random_state=0),
        hs.PolynomialChaos(8),
        beta=lambda X: np.clip(1.4 - 0.2 * X[:, 0], 0, 1),
        n_draws=2000,
        random_state=0,
    ).fit(t, y)
    weight = model.beta(t)
    data = model.to_arviz()
    told = np.asarray(group(data, "log_likelihood")["y"])[0]
    mean = special.logsumexp(told, axis=0) - np.log(len(told))
    # densities of the half that the weights leave to the other surrogate are known to a few percent
    np.testing.assert_allclose(mean, model.log_predictive_density(t, y), atol=0.15)
    drawn = np.asarray(group(data, "posterior_predictive")["y"])[0]
    ratio = drawn.std(axis=0) / model.predict(t, return_std=True)[1]
    # a share of a few percent of the draws is not known to a tenth
    known = (weight == 0) | ((weight > 0.2) & (weight < 0.8)) | (weight == 1)
    assert known.sum() > 30
    assert np.abs(ratio - 1)[known].max() < 0.1
    assert group(data, "posterior")["sigma"].shape == (1, 2000)


def test_parameters_called_like_dimensions_of_arviz_are_kept():
    simulator = hs.Simulator(
        lambda t, draw, chain: draw + chain * t,
        {"t": (0, 1)},
        {"draw": stats.norm(0, 1), "chain": stats.norm(0, 1)},
    )
    t = np.linspace(0, 1, 8)[:, None]
    model = hs.PowerScaledSurrogate(simulator, surrogate=hs.ExactSurrogate(), random_state=0)
    posterior = group(model.fit(t, 0.5 + t[:, 0] ** 2).to_arviz(), "posterior")
    assert {"parameter_draw", "parameter_chain"} < set(posterior.data_vars)
    np.testing.assert_array_equal(posterior["parameter_draw"][0], model.posterior_.values[:, 0])


def test_groups_of_both_generations_of_arviz(arviz):
    data = arviz_groups({"posterior": {"a": np.arange(4.0)}, "observed_data": {"y": np.ones(2)}})
    expected = "InferenceData" if arviz.__version__.startswith("0.") else "DataTree"
    assert type(data).__name__ == expected
    assert group(data, "posterior")["a"].shape == (1, 4)
    assert group(data, "observed_data")["y"].shape == (2,)


def test_parameters_keep_their_names():
    """The noise and the coefficients give way to parameters of the simulation called so."""
    simulator = hs.Simulator(
        lambda t, sigma, coefficients: sigma * t + coefficients,
        {"t": (0, 10)},
        {
            "sigma": hs.truncated_normal(3, 1, 0, 6),
            "coefficients": hs.truncated_normal(0, 1, -3, 3),
        },
    )
    t = np.linspace(0, 10, 20)[:, None]
    y = 2 * t[:, 0] + 0.1 * np.random.default_rng(0).standard_normal(20)
    model = hs.PowerScaledSurrogate(
        simulator.run(60, random_state=0), hs.PolynomialChaos(2), n_draws=300, random_state=0
    ).fit(t, y)
    named = model.posterior_.named()
    assert np.median(named["sigma"]) == pytest.approx(2, abs=0.1)
    assert np.median(named["coefficients"]) == pytest.approx(0, abs=0.3)
    np.testing.assert_array_equal(named["noise_sigma"], model.posterior_.sigma)
    np.testing.assert_array_equal(named["surrogate_coefficients"], model.posterior_.coefficients)
    assert {"sigma", "noise_sigma"} <= set(model.to_arviz().posterior.data_vars)
