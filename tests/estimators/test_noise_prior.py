"""Priors of the noise that know it well."""

import numpy as np
import pytest
from scipy import stats

import hybridsurrogate as hs

SIMULATOR = hs.Simulator(lambda t, a: a * t, {"t": (0, 10)}, {"a": hs.truncated_normal(3, 1, 0, 6)})
T = np.linspace(0, 10, 20)[:, None]
Y = 2 * T[:, 0] + 0.1 * np.random.default_rng(0).standard_normal(20)


@pytest.mark.parametrize("surrogate", [hs.ExactSurrogate(), hs.PolynomialChaos(2)], ids=repr)
@pytest.mark.parametrize(
    ("prior", "low", "high"),
    [
        (hs.truncated_normal(0.1, 0.01, 0.07, 0.13), 0.07, 0.13),
        (stats.uniform(0.08, 0.04), 0.08, 0.12),
        (stats.lognorm(s=0.01, scale=0.1), 0.09, 0.11),
        (stats.uniform(0.5, 2.0), 0.5, 2.5),
    ],
    ids=["normal", "uniform", "log-normal", "above the noise"],
)
def test_draws_of_the_noise_stay_where_a_prior_has_them(surrogate, prior, low, high):
    exact = isinstance(surrogate, hs.ExactSurrogate)
    simulation = SIMULATOR if exact else SIMULATOR.run(40, random_state=0)
    model = hs.PowerScaledSurrogate(simulation, surrogate, noise_prior=prior, random_state=0)
    model.fit(T, Y)
    assert low <= model.posterior_.sigma.min() < model.posterior_.sigma.max() <= high
    # five standard deviations at a noise of 0.5
    assert np.median(model.posterior_.values) == pytest.approx(2, abs=0.1)
