"""Where the search for a size begins."""

from __future__ import annotations

import numpy as np
from problems import make_problem
from scipy import stats
from scipy.special import logsumexp

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.search.context import SearchContext
from hybridsurrogate.diagnosis.search.search import search
from hybridsurrogate.inference.evidence.grid import make_grid, refine
from hybridsurrogate.likelihoods import as_likelihood
from hybridsurrogate.model.context import make_context
from hybridsurrogate.model.statistics import emulator_posterior


def test_a_constant_assumed_at_the_end_of_its_prior_is_found():
    """All of a mixture is assumed to be matter, as in the first model of a universe."""
    simulator = hs.Simulator(
        lambda t, start, share: start + 3 * share * np.sqrt(t),
        inputs={"t": (0, 4)},
        parameters={"start": stats.norm(0, 0.3)},
        assumed={"share": hs.Assumed(1.0, stats.uniform(0, 1))},
    )
    t = np.linspace(0, 4, 40)
    y = 0.1 + 3 * 0.3 * np.sqrt(t) + 0.1 * np.random.default_rng(0).standard_normal(40)
    likelihood = as_likelihood("normal")
    X = t[:, None]
    problem = make_problem(simulator, hs.ExactSurrogate(), likelihood, None, (), ("t",), X, y)
    basis = problem.model.basis
    context = make_context(simulator, ("t",), 1, X, problem.scale, likelihood, basis, np.mean(y))
    wrong = hs.WrongConstant("share").prepare(context)
    model = problem.model.with_effects((wrong,))
    assert abs(make_grid(model).neutral).max() < 3
    found = search(SearchContext.of(problem, emulator_posterior(basis, None)), [wrong])
    none, one = found.candidates
    assert one.log_evidence > none.log_evidence + 20
    share = model.values(one.fit.mode.z[None])[0, -1]
    assert abs(share - 0.3) < 0.05
    # the evidence under the constant's own prior may be missed by the one in ten that a mixture of
    # ten scales gives the fitting one, and by a prior that is centred one sd off its middle
    shares = (np.arange(200) + 0.5) / 200
    exact = logsumexp(log_evidences(shares, t, y, problem.noise_prior)) - np.log(len(shares))
    loss = np.log(10) + (1 - stats.norm.ppf(0.3)) ** 2 / 2
    assert exact - loss < one.log_evidence < exact


def test_a_sure_place_is_paid_for():
    """Cells without hope are dropped: what is left had the whole prior, and places cost nothing."""
    simulator = hs.Simulator(lambda t: 0 * t, inputs={"t": (0, 60)})
    t = np.linspace(0, 60, 61)
    likelihood = as_likelihood("normal")
    X = t[:, None]
    problem = make_problem(simulator, hs.ExactSurrogate(), likelihood, None, (), ("t",), X, 0.1 * t)
    basis = problem.model.basis
    context = make_context(simulator, ("t",), 1, X, 1.0, likelihood, basis, 3.0)
    model = problem.model.with_effects((hs.Bump("t").prepare(context),))
    grid = make_grid(model)
    np.testing.assert_allclose(np.exp(grid.log_weight).sum(), 1.0, rtol=1e-6)
    sure = np.where(np.arange(len(grid.points)) == 5, 0.0, -500.0)
    finer = refine(model, grid, sure + grid.log_weight)
    assert len(finer.points) == 9
    np.testing.assert_allclose(
        np.exp(finer.log_weight).sum(), np.exp(grid.log_weight[5]), rtol=1e-6
    )


def log_evidences(shares, t, y, noise_prior):
    """Return the log evidence given each share, start and sigma integrated out on grids."""
    starts = np.linspace(-0.5, 0.7, 120)
    residual = y - 3 * shares[:, None] * np.sqrt(t)
    moments = (residual**2).sum(1), residual.sum(1)
    squares = moments[0][:, None] - 2 * starts * moments[1][:, None] + len(t) * starts**2
    logs = np.linspace(np.log(0.04), np.log(0.3), 80)
    sigma = np.exp(logs)
    weights = noise_prior.logpdf(sigma) + logs + np.log(logs[1] - logs[0])
    weights = weights - len(t) * np.log(sigma) - len(t) / 2 * np.log(2 * np.pi)
    terms = weights - squares[:, :, None] / (2 * sigma**2)
    priors = stats.norm(0, 0.3).logpdf(starts) + np.log(starts[1] - starts[0])
    return logsumexp(terms + priors[:, None], axis=(1, 2))
