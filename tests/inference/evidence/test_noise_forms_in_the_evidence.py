"""The evidence for other forms of noise, and what a diagnosis makes of it."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hidden_effects.cases import make_case
from lines import FORMS, LEVEL, LINE, problem_of, weigh
from scipy import stats
from scipy.special import logsumexp

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.search.context import SearchContext
from hybridsurrogate.diagnosis.search.null_test import null_test, replicates
from hybridsurrogate.diagnosis.search.search import predict_locally, search
from hybridsurrogate.inference.evidence.grid import make_grid
from hybridsurrogate.inference.evidence.linearised import linearise
from hybridsurrogate.inference.evidence.marginal_likelihood import scan
from hybridsurrogate.likelihoods.student_t import log_shape
from hybridsurrogate.model.statistics import emulator_posterior


def test_evidence_of_outliers_is_close_to_quadrature():
    t = np.linspace(0, 4, 40)
    prior = stats.halfnorm(scale=1.5)
    level, log_sigma = np.linspace(0, 2.5, 61), np.linspace(np.log(0.05), np.log(4), 61)
    density = stats.norm(1, 0.5).logpdf(level)[:, None] + prior.logpdf(np.exp(log_sigma))
    density += log_sigma + np.log((level[1] - level[0]) * (log_sigma[1] - log_sigma[0]))
    # the trapezoidal rule over the prior of the share, which is log-uniform
    shares, weight = np.geomspace(0.01, 0.4, 21), np.full(21, 1 / 20)
    weight[[0, -1]] /= 2
    for seed in range(2):
        for wild in {}, {4: 3.0}, {1: -2.0, 7: 5.0}, {3: 2.0, 9: -3.0, 30: 6.0}:
            y = 1.3 + t + 0.3 * np.random.default_rng(seed).standard_normal(40)
            y[[*wild]] += [*wild.values()]
            problem, about = problem_of(t[:, None], y, LEVEL, prior)
            context = SearchContext.of(problem, emulator_posterior(problem.model.basis, None))
            (found,) = search(context, [hs.Outliers().prepare(about)]).candidates[1:]
            z = (y - level[:, None, None] - t) / np.exp(log_sigma)[:, None]
            rows = [np.sum(log_shape(z, one) - log_sigma[:, None], axis=2) for one in shares]
            brute = logsumexp(np.array(rows) + density, b=weight[:, None, None])
            assert brute - found.log_evidence == pytest.approx(0.0, abs=0.2)


def test_evidence_of_noise_that_follows_the_output_equals_the_marginal_likelihood():
    t = np.linspace(0, 4, 9)
    y = 1.2 + t + 0.3 * np.random.default_rng(1).standard_normal((2, 9))
    problem, context = problem_of(t[:, None], y[0], LEVEL)
    cause = hs.NoiseOfMean().prepare(context)
    model = problem.model.with_effects((cause,))
    grid, sigma = make_grid(model), 0.4
    z = np.full(model.n_unknowns, 0.2)
    parts = linearise(model, problem.X, emulator_posterior(model.basis, None), grid, z)

    def fixed_sigma(squares):
        return -0.5 * 9 * np.log(2 * np.pi * sigma**2) - 0.5 * squares / sigma**2

    found = scan(parts, y, sigma, fixed_sigma, np.array([1.0]))
    # the noise is that of the simulation at the point of linearisation
    eta = 1 + 0.2 * 0.5 + t
    size = np.sqrt(np.mean(y[0] ** 2))
    for k, exponent in enumerate(grid.points[:, 0]):
        factor = np.hypot(eta / size, 0.05) ** exponent
        covariance = 0.25 + np.diag((sigma * factor) ** 2)
        expected = stats.multivariate_normal(1 + t, covariance).logpdf(y) + grid.log_weight[k]
        np.testing.assert_allclose(found[:, k], expected, atol=1e-5)


def test_evidence_of_autocorrelation_equals_the_marginal_likelihood():
    t = np.linspace(0, 10, 16)
    y = 1.2 + 2 * t + np.random.default_rng(1).standard_normal((2, 16))
    problem, context = problem_of(t[:, None], y[0])
    cause = hs.Autocorrelation("t").prepare(context)
    model = problem.model.with_effects((cause,))
    grid, sigma, sizes = make_grid(model), 0.4, np.array([0.3, 1.0])
    parts = linearise(model, problem.X, emulator_posterior(model.basis, None), grid, grid.neutral)

    def fixed_sigma(squares):
        return -0.5 * 16 * np.log(2 * np.pi * sigma**2) - 0.5 * squares / sigma**2

    found = scan(parts, y, sigma, fixed_sigma, sizes)
    line = 0.5**2 + 0.3**2 * np.outer(t, t) + sigma**2 * np.eye(16)
    for k, length in enumerate(grid.points[:, 0]):
        columns = cause.columns({"t": t}, {"length": np.full(16, length), "amplitude": np.ones(16)})
        process = columns @ columns.T / np.mean(np.sum(columns**2, axis=1))
        terms = [
            stats.multivariate_normal(1 + 2 * t, line + s**2 * process).logpdf(y) for s in sizes
        ]
        expected = logsumexp(terms, axis=0) - np.log(2) + grid.log_weight[k]
        np.testing.assert_allclose(found[:, k], expected, atol=1e-6)


@pytest.mark.parametrize(
    ("form", "name"),
    [
        ("noise: mean", "noise(output)"),
        ("noise: tails", "noise(outliers)"),
        ("noise: autocorrelation", "noise(day, autocorrelated)"),
    ],
)
def test_blind_cases_are_named(form, name):
    first = []
    for seed in range(3):
        case = make_case(form, 4.0, seed, n_rows=60, simulation="epidemic")
        first.append(weigh(case.X[:, :1], case.y, case.simulator)[1])
    assert first.count(name) >= 2, first


def test_nothing_is_named_where_nothing_is_wrong():
    t = np.linspace(0, 10, 60)
    above = []
    for seed in range(4):
        y = 1 + 2 * t + np.random.default_rng(seed).standard_normal(60)
        found, first = weigh(t[:, None], y, forms=(*FORMS, "trend"))
        assert first == "none"
        above += [w.log_evidence - found.candidates[0].log_evidence for w in found.candidates[1:4]]
    assert np.mean(np.array(above) < 0) >= 0.8
    test = null_test(found, 100, np.random.RandomState(0))
    assert np.mean(test.replicates > 1) < 0.1


def test_outliers_are_no_part_of_the_statistic():
    t = np.linspace(0, 10, 30)
    y = 1 + 2 * t + np.random.default_rng(0).standard_normal(30)
    found, _ = weigh(t[:, None], y, forms=("noise: tails", "trend"))
    none, tails = (w for w in found.candidates if w.cause is None or "outliers" in w.cause.acts_on)
    trends = [w for w in found.candidates if w is not tails]
    both, trend, alone = (
        null_test(replace(found, candidates=some), 9, np.random.RandomState(0))
        for some in (found.candidates, trends, [none, tails])
    )
    np.testing.assert_array_equal(both.replicates, trend.replicates)
    assert both.statistic == trend.statistic
    assert alone.p_value == 1.0


@pytest.mark.slow
def test_a_diagnosis_names_outliers_and_predicts_without_them():
    rng = np.random.default_rng(0)
    frame = pd.DataFrame({"t": np.linspace(0, 10, 50)})
    y = 1 + 2 * frame.t.to_numpy() + 0.3 * rng.standard_normal(50)
    y[::10] += 6
    model = hs.PowerScaledSurrogate(
        LINE, surrogate=hs.ExactSurrogate(), random_state=0, n_draws=100
    )
    found = hs.DiscrepancyDiagnosis(
        model, causes=[hs.Outliers(), hs.NoiseOfMean()], cv=None, max_causes=2, random_state=0
    ).fit(frame, y)
    assert found.best_cause_.kind == "noise"
    _, low, high = found.best_cause_.estimates["share"]
    assert low < 0.1 < high
    assert found.extended_simulator_ is None
    assert "times as much as the others" in found.best_cause_.latex
    _, variance = predict_locally(found.search_, found.search_.candidates[0], np.array([[5.0]]))
    assert variance[0] > 1


def test_replicates_beside_accepted_noise_have_that_noise():
    rng = np.random.default_rng(0)
    t = np.linspace(0, 10, 120)
    sd = 0.1 * (1 + t)  # eleven times as large in the end
    y = 1 + 2 * t + sd * rng.standard_normal(120)
    found, name = weigh(t[:, None], y, forms=("noise", "trend"))
    assert name == "noise(t)"
    first = next(w for w in found.candidates if w.cause and w.cause.name == name)
    problem = replace(found.problem, model=found.problem.model.with_effects((first.cause,)))
    others = [w.cause for w in found.candidates if w.cause and w is not first]
    beside = search(SearchContext.of(problem, found.context.emulator), others, first)
    drawn = replicates(beside, 400, np.random.RandomState(0))
    spread = drawn.std(axis=0)
    expected = sd[-40:].mean() / sd[:40].mean()
    assert spread[-40:].mean() / spread[:40].mean() == pytest.approx(expected, rel=0.25)
