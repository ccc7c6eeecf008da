"""Unknowns that data tell together only: draws reach along their ridge as far as priors do."""

import warnings
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import integrate, stats

import hybridsurrogate as hs
from hybridsurrogate.inference import posterior_sampler
from hybridsurrogate.inference.sampling.axis_proposals import elongation, ridge_through
from hybridsurrogate.inference.sampling.modes import Gaussian

pytestmark = pytest.mark.numbers
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


def test_a_mode_beyond_the_end_of_a_prior_is_left_towards_the_data_alone():
    """Followed further out, the path would turn and come back over itself."""

    class Valley:
        model = SimpleNamespace(least_step=0.0)

        def search_density(self, x):
            exchanged = (x[:, 0] + x[:, 1] - 16) / 0.05
            return -0.5 * (exchanged**2 + np.sum(((x - 8) / 3) ** 2, axis=1))

    hessian = np.array([[1, 1, 0], [1, 1, 0], [0, 0, 0]]) / 0.05**2 + np.eye(3) / 9
    factor = np.linalg.cholesky(np.linalg.inv(hessian))
    ridge = ridge_through(Valley(), Gaussian(np.full(3, 8.0), factor, 0.0))
    assert np.all(np.diff(ridge.curve.x) > 0)
    assert ridge.curve.x[-1] < 8.2


def test_elongation_does_not_depend_on_the_axes():
    turned = np.array([[0.6, -0.8], [0.8, 0.6]])
    covariance = turned @ np.diag([100.0, 0.25]) @ turned.T
    mode = Gaussian(np.zeros(2), np.linalg.cholesky(covariance), 0.0)
    assert elongation(mode) == pytest.approx(np.sqrt(100.0 / 0.25))


@pytest.mark.parametrize(("limit", "is_followed"), [(300.0, False), (1.0, True)])
def test_a_thick_mode_is_not_followed(monkeypatch, limit, is_followed):
    """Following it costs more than all else, and its draws are no better than those there are."""
    followed = []

    def spy(*arguments):
        followed.append(arguments)

    settings = replace(posterior_sampler.SETTINGS, ridge_elongation=limit)
    monkeypatch.setattr(posterior_sampler, "SETTINGS", settings)
    monkeypatch.setattr(posterior_sampler, "ridge_through", spy)
    t = np.linspace(0, 10, 40)
    y = SIZE * np.exp(-RATE * t) + 0.5 * np.random.default_rng(2).standard_normal(40)
    effect = EXCHANGED["delay"][0]
    hs.PowerScaledSurrogate(
        DECAY, surrogate=hs.ExactSurrogate(), effects=[effect], n_draws=300, random_state=0
    ).fit(t[:, None], y)
    assert bool(followed) == is_followed


class Counted:
    """A density that counts how often it is asked."""

    def __init__(self, target):
        self.target, self.calls = target, 0

    def __getattr__(self, name):
        return getattr(self.target, name)

    def search_density(self, u):
        self.calls += 1
        return self.target.search_density(u)


def test_a_ridge_is_followed_by_few_calls(monkeypatch):
    """A call of a stiff solver takes a tenth of a second for one point as for a hundred."""
    calls, follow = [], posterior_sampler.ridge_through

    def counted(target, mode):
        spy = Counted(target)
        ridge = follow(spy, mode)
        calls.append((spy.calls, ridge))
        return ridge

    monkeypatch.setattr(posterior_sampler, "ridge_through", counted)
    t = np.linspace(0, 10, 40)
    y = SIZE * np.exp(-RATE * t) + 1e-3 * np.random.default_rng(2).standard_normal(40)
    hs.PowerScaledSurrogate(
        DECAY, surrogate=hs.ExactSurrogate(), effects=[EXCHANGED["gain"][0]], random_state=0
    ).fit(t[:, None], y)
    ((n, ridge),) = calls
    assert n < 350
    # along the whole ridge: all of the prior of the amplitude that the gain's allows
    assert len(ridge.curve.x) > 10
    assert np.ptp(ridge.curve.x) > 4
