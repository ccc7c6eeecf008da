"""The density of a measurement from draws that leave next to no noise."""

import numpy as np
import pytest
from scipy import special, stats

import hybridsurrogate as hs


def line(x, level):
    return level + 0 * x


SIMULATOR = hs.Simulator(line, {"x": (0, 40)}, {"level": stats.norm(0, 1)})


def test_values_that_repeat_exactly_leave_a_density_elsewhere():
    # each place twice, with one value: a path through all of them has no noise left
    random = np.random.default_rng(0)
    x = np.repeat(np.arange(0, 40, 2.0), 2)
    y = np.repeat(random.standard_normal(20).round(1), 2)
    model = hs.PowerScaledSurrogate(
        SIMULATOR,
        hs.ExactSurrogate(),
        effects=[hs.Autocorrelation("x")],
        n_draws=400,
        random_state=0,
    ).fit(x[:, None], y)
    new = np.arange(1, 39, 2.0)[:, None]
    mean, sd = model.predict(new, return_std=True)
    assert np.all(sd > 1000 * model.posterior_.sigma.mean())
    for z in (0.0, 1.0, -2.0):
        density = model.log_predictive_density(new, mean + z * sd)
        # the tails are heavier than those of the normal distribution: sizes are inferred
        assert density.mean() == pytest.approx(np.mean(stats.norm.logpdf(z) - np.log(sd)), abs=0.4)


@pytest.mark.parametrize("noise", [0.01, 0.03, 0.1, 1.0])
def test_draws_give_the_density_in_closed_form(noise):
    """The level is known to 1: the density of a row is normal, of sd sqrt(1 + noise^2)."""
    # one row of next to no weight leaves the prior as it is
    scores = []
    for seed in range(20):
        model = hs.PowerScaledSurrogate(
            SIMULATOR,
            hs.ExactSurrogate(),
            noise_prior=stats.lognorm(0.01, scale=noise),
            n_draws=300,
            random_state=seed,
        )
        fitted = model.fit([[0.0], [1.0]], [0.0, 0.0], sample_weight=[1e-6, 1e-6])
        scores.append(fitted.log_predictive_density([[2.0]] * 3, [0.0, 1.0, 2.0]))
    exact = stats.norm.logpdf([0.0, 1.0, 2.0], 0, np.hypot(1, noise))
    error = np.array(scores) - exact
    assert np.all(np.abs(error.mean(axis=0)) < 3 * error.std(axis=0) / np.sqrt(20) + 0.1)
    assert error.std() < 0.4


def test_noise_that_is_large_is_left_as_it_is():
    x = np.linspace(0, 40, 20)[:, None]
    y = 0.5 + 0.3 * np.random.default_rng(0).standard_normal(20)
    model = hs.PowerScaledSurrogate(SIMULATOR, hs.ExactSurrogate(), n_draws=300, random_state=0)
    model.fit(x, y)
    each = stats.norm.logpdf(y, *model.posterior_.eta(x))
    np.testing.assert_allclose(
        model.log_predictive_density(x, y), special.logsumexp(each, axis=0) - np.log(300)
    )
