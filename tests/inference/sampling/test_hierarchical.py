"""Coordinates of hierarchies: there and back, their volume, and draws against quadrature."""

import numpy as np
import pandas as pd
import pytest
from batches import DECAY, batches
from scipy import special, stats

import hybridsurrogate as hs
from hybridsurrogate.inference.procedure import make_target
from hybridsurrogate.inference.sampling.hierarchical import hierarchies, standardised
from hybridsurrogate.inference.sampling.modes import starting_points

SPREAD = {"experiment": "batch", "by_experiment": {"rate": "spread"}}


def target_of(by, seed=0, **data):
    X, y, _ = batches(seed, n=4, rows=6, **data)
    model = hs.PowerScaledSurrogate(
        DECAY, surrogate=hs.ExactSurrogate(), experiment="batch", by_experiment=by, random_state=0
    ).fit(X, y)
    return make_target(model.inference_.problem, 0.0, 1.0)


@pytest.mark.parametrize("by", [{"rate": "spread"}, {"rate": "spread", "level": "spread"}])
def test_there_and_back(by):
    target = target_of(by)
    starts = starting_points(target, np.random.RandomState(0))
    coordinates = standardised(target.model, target.search_density, starts)
    points = np.random.default_rng(1).standard_normal((20, target.n_dimensions))
    back, log_volume = coordinates.points(coordinates.of(points))
    np.testing.assert_allclose(back, points, rtol=1e-6, atol=1e-6)
    # the volume by differences
    x, step = coordinates.of(points[:1]), 1e-5
    moved = [
        (coordinates.points(x + step * e)[0] - coordinates.points(x - step * e)[0])[0] / (2 * step)
        for e in np.eye(target.n_dimensions)
    ]
    expected = np.linalg.slogdet(np.array(moved))[1]
    np.testing.assert_allclose(log_volume[0], expected, rtol=1e-4, atol=1e-4)


def test_there_are_none_without_a_spread():
    assert hierarchies(target_of({"rate": "own"}).model) == []


@pytest.mark.parametrize("spread", [0.8, 0.0], ids=["informative", "next to nothing"])
def test_spread_agrees_with_quadrature(spread):
    # the output is the parameter itself: given mean, spread and sigma, batch means are normal
    rng = np.random.default_rng(4)
    n, rows = 6, 4
    levels = 1.0 + spread * rng.standard_normal(n)
    y = levels[:, None] + 0.3 * rng.standard_normal((n, rows))
    prior, noise_prior = stats.norm(0, 2), stats.halfnorm(scale=0.5)
    simulator = hs.Simulator(lambda x, p: p + 0 * x, {"x": (0, 1)}, {"p": prior})
    X = pd.DataFrame({"x": rng.uniform(size=n * rows), "batch": np.repeat(np.arange(n), rows)})
    model = hs.PowerScaledSurrogate(
        simulator,
        surrogate=hs.ExactSurrogate(),
        noise_prior=noise_prior,
        experiment="batch",
        by_experiment={"p": "spread"},
        n_draws=4000,
        random_state=0,
    ).fit(X, y.ravel())
    assert model.diagnostics_.khat < 0.7
    # half-Cauchy with the prior's sd as scale; grids by quantiles of the priors
    share, of_mean, of_sigma = ((np.arange(k) + 0.5) / k for k in (400, 200, 100))
    s = 2.0 * np.tan(0.5 * np.pi * share[:, None, None])
    m = prior.ppf(of_mean)[None, :, None]
    sigma = noise_prior.ppf(of_sigma)[None, None, :]
    means, within = y.mean(axis=1), np.sum((y - y.mean(axis=1, keepdims=True)) ** 2)
    variance = s**2 + sigma**2 / rows
    squares = np.sum((means - 0) ** 2) - 2 * m * means.sum() + n * m**2
    log_density = -0.5 * squares / variance - 0.5 * n * np.log(variance)
    log_density = log_density - 0.5 * within / sigma**2 - n * (rows - 1) * np.log(sigma)
    constant = -0.5 * n * rows * np.log(2 * np.pi) - 0.5 * n * np.log(rows)
    log_evidence = special.logsumexp(log_density) - np.log(log_density.size) + constant
    fitted = model.diagnostics_
    assert fitted.log_evidence == pytest.approx(log_evidence, abs=4 * fitted.log_evidence_error)
    weight = np.exp(log_density - log_density.max()).sum(axis=(1, 2))
    expected = np.interp([0.1, 0.5, 0.9], np.cumsum(weight) / weight.sum(), s[:, 0, 0])
    found = np.quantile(model.posterior_.estimates(0)["spread"], [0.1, 0.5, 0.9])
    np.testing.assert_allclose(found, expected, rtol=0.08, atol=0.015)
