"""Unknowns that data tell together only: draws reach along their ridge as far as priors do."""

import warnings

import numpy as np
import pytest
from scipy import integrate, stats

import hybridsurrogate as hs

A = hs.truncated_normal(5, 1, 1, 9)
DECAY = hs.Simulator(
    lambda t, a, k: a * np.exp(-k * t),
    inputs={"t": (0, 10)},
    parameters={"a": A, "k": hs.truncated_normal(0.3, 0.1, 0.05, 0.8)},
)
SIZE, RATE = 1.9 * 5.2, 0.33
# the other unknown's value and derivative in the size, given a
EXCHANGED = {
    "gain": (hs.Gain(), stats.loglaplace(3), lambda a: SIZE / a, lambda a: 1 / a),
    "delay": (hs.Delay("t"), stats.t(1, scale=1), lambda a: np.log(SIZE / a) / RATE, np.ones_like),
}


@pytest.mark.parametrize("noise", [1e-2, 1e-4, 1e-5])
@pytest.mark.parametrize("kind", EXCHANGED)
def test_two_exchangeable_unknowns_are_as_uncertain_as_their_priors(kind, noise):
    effect, prior, value, derivative = EXCHANGED[kind]
    t = np.linspace(0, 10, 40)
    y = SIZE * np.exp(-RATE * t) + noise * np.random.default_rng(2).standard_normal(40)
    model = hs.PowerScaledSurrogate(
        DECAY, surrogate=hs.ExactSurrogate(), effects=[effect], n_draws=1000, random_state=0
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model.fit(t[:, None], y)
    # on the ridge a is alone: its prior times that of the other and the derivative
    a = np.linspace(1, 9, 4001)
    density = A.pdf(a) * prior.pdf(value(a)) * derivative(a)
    density /= integrate.trapezoid(density, a)
    mean = integrate.trapezoid(a * density, a)
    sd = np.sqrt(integrate.trapezoid((a - mean) ** 2 * density, a))
    drawn = model.posterior_.values[:, 0]
    # some 500 effective draws: four standard errors
    assert drawn.mean() == pytest.approx(mean, abs=4 * sd / np.sqrt(500))
    assert drawn.std() == pytest.approx(sd, rel=4 / np.sqrt(2 * 500))
    assert model.diagnostics_.sampler == "importance"
