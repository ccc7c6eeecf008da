"""The first step of densities whose constant and moments are known: each of its ways to draw.

Gaussians around modes; several of them; a ridge straightened; proposals that bend, more and more;
an ensemble. Hierarchies have coordinates of their own, in test_hierarchical, and the place of a
jump narrow proposals along it, in test_adaptive_importance; their constants are compared there.
"""

from dataclasses import replace

import numpy as np
import pytest
from problems import make_problem
from scipy import stats

import hybridsurrogate as hs
from hybridsurrogate.inference import posterior_sampler
from hybridsurrogate.inference.posterior_sampler import evidence_around, first_step
from hybridsurrogate.inference.procedure import make_target
from hybridsurrogate.likelihoods import as_likelihood

LOG_2PI = np.log(2 * np.pi)


class Known:
    """The posterior of three parameters, with another density in its place."""

    is_exact = True
    n_noise = 0

    def __init__(self, log_density):
        simulator = hs.Simulator(
            lambda t, a, b, c: a + b * t + c * t**2,
            inputs={"t": (-1, 1)},
            parameters={name: stats.norm(0, 1) for name in "abc"},
        )
        t = np.linspace(-1, 1, 20)
        rows = ("t",), t[:, None], np.cos(40 * t)
        normal, exact = as_likelihood("normal"), hs.ExactSurrogate()
        problem = make_problem(simulator, exact, normal, None, (), *rows)
        self.target, self.log_density = make_target(problem, 0.0, 1.0), log_density

    def __getattr__(self, name):
        return getattr(self.target, name)

    def with_model(self, model):
        return self

    def search_density(self, u):
        # scipy's densities of one point are numbers
        return np.reshape(self.log_density(u), len(u))

    extended_log_density = joint_log_density = search_density

    def to_ensemble(self, points):
        return points

    def resolved(self, points, random_state):
        return points, np.empty((len(points), 0)), np.empty((len(points), 0))

    from_ensemble = resolved


def drawn(log_density, seed=0):
    return first_step(Known(log_density), "auto", 2000, np.random.RandomState(seed))


def log_constant(diagnostics, n=4):
    """Return the log of the integral of the density over all n unknowns.

    The evidence is that of standard normal coordinates whose constants the density leaves out.
    """
    return diagnostics.log_evidence + 0.5 * (n - 1) * LOG_2PI


def effective(found):
    """Independent draws with the error of these: of the weights, and of choosing by them."""
    return 1 / (1 / found.diagnostics.effective_draws + 1 / len(found.u))


def assert_moments(found, mean, covariance):
    """Means and covariances, each within four standard errors of so many effective draws."""
    n, sd = effective(found), np.sqrt(np.diag(covariance))
    z = (found.u - mean) / sd
    np.testing.assert_allclose(z.mean(axis=0), 0, atol=4 / np.sqrt(n))
    correlation = covariance / np.outer(sd, sd)
    np.testing.assert_allclose(z.T @ z / len(z), correlation, atol=4 * np.sqrt(2 / n))


MEAN = np.array([0.4, -0.8, 0.2, -1.5])
FACTOR = np.array([[0.3, 0, 0, 0], [0.2, 0.1, 0, 0], [-0.1, 0.3, 0.5, 0], [0, 0, 0.05, 0.2]])
GAUSSIAN = stats.multivariate_normal(MEAN, FACTOR @ FACTOR.T)


def test_a_gaussian_is_drawn_as_it_is():
    found = drawn(lambda u: 3.0 + GAUSSIAN.logpdf(u))
    assert found.diagnostics.sampler == "importance"
    assert log_constant(found.diagnostics) == pytest.approx(3.0, abs=0.02)
    assert_moments(found, MEAN, GAUSSIAN.cov)
    again = evidence_around(
        Known(lambda u: 3.0 + GAUSSIAN.logpdf(u)), MEAN[None] + 0.3, np.random.RandomState(0)
    )
    assert again == pytest.approx(found.diagnostics.log_evidence, abs=0.02)


def test_each_of_two_modes_has_its_share():
    away = np.array([2.5, 0, 0, 0])

    def density(u):
        first, second = GAUSSIAN.logpdf(u), GAUSSIAN.logpdf(u - away)
        return np.logaddexp(np.log(0.7) + first, np.log(0.3) + second)

    found = drawn(density)
    assert found.diagnostics.n_modes == 2
    assert log_constant(found.diagnostics) == pytest.approx(0.0, abs=0.05)
    n = effective(found)
    # midway: more than four standard deviations from either
    share = np.mean(found.u[:, 0] > MEAN[0] + 1.25)
    assert share == pytest.approx(0.3, abs=4 * np.sqrt(0.21 / n))


THICK = 1e-4


def bent(u):
    """The second unknown follows the first on a curve, ten thousand times as long as thick."""
    return (
        stats.norm.logpdf(u[:, 0])
        + stats.norm.logpdf(u[:, 1], np.exp(u[:, 0] / 2), THICK)
        + stats.norm.logpdf(u[:, 2:], [0, -1.5], [0.05, 0.05]).sum(axis=1)
    )


def test_a_ridge_is_drawn_along_its_whole_length(monkeypatch):
    ridges, follow = [], posterior_sampler.ridge_through

    def spy(*arguments):
        ridges.append(follow(*arguments))
        return ridges[-1]

    monkeypatch.setattr(posterior_sampler, "ridge_through", spy)
    found = drawn(bent)
    assert len(ridges) == 1
    assert found.diagnostics.sampler == "importance"
    assert log_constant(found.diagnostics) == pytest.approx(0.0, abs=0.1)
    n = effective(found)
    assert found.u[:, 0].mean() == pytest.approx(0, abs=4 / np.sqrt(n))
    assert found.u[:, 0].std() == pytest.approx(1, abs=4 / np.sqrt(2 * n))
    off = (found.u[:, 1] - np.exp(found.u[:, 0] / 2)) / THICK
    assert off.std() == pytest.approx(1, abs=4 / np.sqrt(2 * n))


def bent_beside_a_loose_unknown(u):
    """The same where the data say less of a third unknown than of those on the curve."""
    return (
        stats.norm.logpdf(u[:, 0], 0, 0.7)
        + stats.norm.logpdf(u[:, 1], np.exp(u[:, 0] / 2), THICK)
        + stats.norm.logpdf(u[:, 2:], [0, -1.5], [1.0, 0.05]).sum(axis=1)
    )


def test_a_ridge_is_followed_along_an_unknown_that_is_on_it():
    found = drawn(bent_beside_a_loose_unknown)
    assert found.diagnostics.sampler == "importance"
    assert log_constant(found.diagnostics) == pytest.approx(0.0, abs=0.1)
    n = effective(found)
    for k, sd in ((0, 0.7), (2, 1.0)):
        assert found.u[:, k].mean() == pytest.approx(0, abs=4 * sd / np.sqrt(n))
        assert found.u[:, k].std() == pytest.approx(sd, abs=4 * sd / np.sqrt(2 * n))


# heavy in all directions at once: a Student-t of two degrees of freedom has no second moments
TAILS = stats.multivariate_t(MEAN, FACTOR @ FACTOR.T, df=2)


def test_proposals_that_bend_have_the_constant_of_heavy_tails(monkeypatch):
    # as where few draws count
    settings = replace(posterior_sampler.SETTINGS, min_effective_share=np.inf)
    monkeypatch.setattr(posterior_sampler, "SETTINGS", settings)
    found = drawn(TAILS.logpdf)
    assert found.diagnostics.sampler == "importance"
    assert log_constant(found.diagnostics) == pytest.approx(0.0, abs=0.05)
    n = effective(found)
    for k in range(4):
        marginal = stats.t(2, MEAN[k], np.sqrt(TAILS.shape[k, k]))
        for p in (0.05, 0.5, 0.95):
            share = np.mean(found.u[:, k] < marginal.ppf(p))
            assert share == pytest.approx(p, abs=4 * np.sqrt(p * (1 - p) / n))


THIN = 0.05


def thin_bend(u):
    """Three standard deviations of 0.05 around a parabola over a standard normal unknown."""
    off = (u[:, 1:] - np.outer(u[:, 0] ** 2, [0.6, -0.4, 0.5])) / THIN
    return -0.5 * u[:, 0] ** 2 - 0.5 * np.sum(off**2, axis=1)


@pytest.mark.parametrize("seed", range(3))
def test_draws_reach_the_tails_of_a_thin_bend(seed):
    """Gaussians around what is reached so far had 0.6 to 0.9 of the spread at k-hat 0.4 to 0.7."""
    found = drawn(thin_bend, seed)
    assert found.diagnostics.sampler == "importance"
    assert found.diagnostics.khat < 0.7
    n = effective(found)
    for p in (0.05, 0.25, 0.5, 0.75, 0.95):
        share = np.mean(found.u[:, 0] < stats.norm.ppf(p))
        assert share == pytest.approx(p, abs=4 * np.sqrt(p * (1 - p) / n))
    constant = 2 * np.log(2 * np.pi) + 3 * np.log(THIN)
    assert log_constant(found.diagnostics) == pytest.approx(constant, abs=0.1)


def test_an_ensemble_draws_what_importance_sampling_cannot(monkeypatch):
    # no k-hat is good enough
    monkeypatch.setattr(posterior_sampler, "KHAT_LIMIT", -np.inf)
    found = drawn(GAUSSIAN.logpdf)
    assert found.diagnostics.sampler == "emcee"
    assert found.diagnostics.converged
    assert_moments(found, MEAN, GAUSSIAN.cov)
