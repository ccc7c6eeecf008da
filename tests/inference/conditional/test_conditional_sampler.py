"""Step 2: the measured world given each draw of the coefficients, against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from problems import make_problem
from scipy import special, stats

import hybridsurrogate as hs
from hybridsurrogate.inference.conditional.grid import _finer, _grid, log_density_of_pairs
from hybridsurrogate.inference.conditional.pairwise_squares import (
    MeasuredGiven,
    SharedDraws,
    one_node_each,
    squares_of_factors,
    squares_of_pairs,
)
from hybridsurrogate.inference.conditional.sampler import (
    _draw_columns,
    _log_density,
    exchanged,
    held_out,
    near_draws,
    second_step,
)
from hybridsurrogate.inference.procedure import given_draws
from hybridsurrogate.model.observation import MeasuredModel


def parabola(t, **parameters):
    """A polynomial in t whose coefficients are the parameters."""
    return sum(parameters[name] * t**k for k, name in enumerate("abc") if name in parameters)


@pytest.mark.parametrize(
    ("n", "columns"),
    [(7, range(5)), (7, [0, 1, 0, 1, 2, 1, 0, 2, 2]), (3, range(8)), (40, range(8))],
)
def test_squares_of_factors_are_those_of_their_products(n, columns):
    """Whether features share their factor of the inputs or not, of few rows and of many."""
    rng = np.random.default_rng(0)
    of_inputs = rng.standard_normal((n, max(columns) + 1))[:, list(columns)]
    of_parameters = rng.standard_normal((300, len(columns)))
    residual, c = rng.standard_normal(n), 100 + rng.standard_normal((11, len(columns)))
    features = of_inputs * of_parameters[:, None]
    expected = np.sum((residual[:, None] - features @ c.T) ** 2, axis=1)
    draws = SharedDraws(c)
    told = squares_of_factors(of_inputs, of_parameters, residual, draws)
    np.testing.assert_allclose(told, expected, rtol=1e-8)
    rest = np.broadcast_to(residual[:, None], (300, n, 1))
    np.testing.assert_allclose(squares_of_pairs(features, rest, draws), expected, rtol=1e-8)


@pytest.mark.parametrize("names", ["a", "ab", "abc"])
def test_second_step_draws_from_the_exact_conditional(names):
    """Given coefficients that make the surrogate a parabola, step 2 is a linear regression.

    Every draw has its own intercept, so each has its own conditional; all are checked at once by
    where the draws lie in their exact distributions.
    """
    priors = {
        name: stats.norm(mean, 1.0) for name, mean in zip(names, (1, -0.5, 0.3), strict=False)
    }
    simulator = hs.Simulator(parabola, {"t": (-1, 1)}, priors)
    rng = np.random.default_rng(8)
    X = np.linspace(-1, 1, 10)[:, None]
    y = 1.4 - 0.7 * X[:, 0] * ("b" in names) + 0.5 * X[:, 0] ** 2 * ("c" in names)
    y += rng.normal(0, 0.3, 10)
    noise_prior = stats.halfnorm(scale=0.5)
    degree = {"a": 1, "ab": 2, "abc": 3}[names]
    problem = make_problem(
        simulator.run(256, random_state=0),
        hs.PolynomialChaos(degree, stats.norm(0, 10)),
        hs.Normal(),
        noise_prior,
        (),
        ("t",),
        X,
        y,
    )
    runs = problem.simulation
    c = np.linalg.solve(runs.ff, runs.fy)
    # the emulator is exact
    assert runs.yy - c @ runs.fy < 1e-6

    S = 3000
    shift = rng.normal(0, 0.3, S)
    coefficients = np.tile(c, (S, 1))
    coefficients[:, 0] += shift
    powers = np.column_stack([X[:, 0] ** k for k in range(len(names))])
    mean0 = np.array([prior.mean() for prior in priors.values()])
    # rough draws, as from a first step that knows less
    rough = np.column_stack(
        [rng.normal(0.3, 0.6, (S, len(names))), rng.normal(np.log(0.3), 0.3, S)]
    )
    given = given_draws(problem, coefficients)
    drawn = second_step(given, rough, np.random.RandomState(0))
    values = problem.model.values(drawn.z)

    # where each parameter lies given sigma: standard normal after whitening
    whitened = np.empty_like(values)
    log_sigma = np.linspace(np.log(0.05), np.log(3), 400)
    below = np.empty(S)
    for s in range(S):
        precision = powers.T @ powers / drawn.sigma[s] ** 2 + np.eye(len(names))
        right = powers.T @ (y - shift[s]) / drawn.sigma[s] ** 2 + mean0
        root = np.linalg.cholesky(precision)
        whitened[s] = root.T @ (values[s] - np.linalg.solve(precision, right))
    # and sigma with the parameters integrated out, by quadrature
    size, axes = np.linalg.eigh(powers @ powers.T)
    along = ((y - powers @ mean0)[:, None] - shift).T @ axes
    variance = np.maximum(size, 0) + np.exp(2 * log_sigma)[:, None]
    log_density = -0.5 * (along[:, None] ** 2 / variance).sum(axis=2)
    log_density += -0.5 * np.log(variance).sum(axis=1)
    log_density += noise_prior.logpdf(np.exp(log_sigma)) + log_sigma
    cumulative = np.cumsum(np.exp(log_density - log_density.max(axis=1, keepdims=True)), axis=1)
    cumulative /= cumulative[:, -1:]
    for s in range(S):
        below[s] = np.interp(np.log(drawn.sigma[s]), log_sigma, cumulative[s])

    assert stats.kstest(below, "uniform").statistic < 0.04
    for column in whitened.T:
        assert stats.kstest(column, "norm").statistic < 0.04
    np.testing.assert_allclose(np.cov(whitened.T), np.eye(len(names)), atol=0.1)
    assert np.isnan(drawn.effective_draws) == (len(names) < 3)


@pytest.mark.parametrize("effects", [(), (hs.Offset(), hs.Periodic("t"))], ids=["plain", "causes"])
def test_proposals_weigh_what_the_rows_say_by_hand(effects):
    """Rows are Gaussian given coefficients, their covariance dense with those of causes."""
    priors = {name: stats.norm(0.5, 1.0) for name in "abc"}
    runs = hs.Simulator(parabola, {"t": (-1, 1)}, priors).run(64, random_state=0)
    rng = np.random.default_rng(3)
    X = np.linspace(-1, 1, 9)[:, None]
    y = rng.standard_normal(9)
    noise_prior = stats.halfnorm(scale=0.5)
    problem = make_problem(
        runs, hs.PolynomialChaos(2), hs.Normal(), noise_prior, effects, ("t",), X, y
    )
    model = problem.model
    c = rng.standard_normal((5, len(model.basis.coefficient_mean)))
    given = MeasuredGiven(model, X, y, np.ones(9), c, noise_prior, problem.scale)
    u = np.column_stack([rng.standard_normal((4, model.n_unknowns)), rng.normal(-1, 0.5, 4)])
    assert model.factorises
    told = _log_density(given, u, given.draws)
    for j, (*z, log_sigma) in enumerate(u):
        parts = model.parts(X, model.values(np.array([z])))
        H = parts.columns[0] * model.column_sd
        rows = stats.multivariate_normal(cov=np.exp(2 * log_sigma) * np.eye(9) + H @ H.T)
        prior = noise_prior.logpdf(np.exp(log_sigma)) + log_sigma - 0.5 * np.dot(z, z)
        expected = [rows.logpdf(y - parts.known[0] - parts.features[0] @ one) + prior for one in c]
        # constants of the normal distribution are left out
        constant = 0.5 * 9 * np.log(2 * np.pi)
        np.testing.assert_allclose(told[j], np.array(expected) + constant, rtol=1e-8)


@pytest.mark.parametrize(
    "effects",
    [(hs.Bump("t"),), (hs.Offset(), hs.Trend("t")), (hs.Offset(), hs.Bump("t"))],
    ids=["formed", "products", "both"],
)
def test_rows_that_factorise_or_not_weigh_the_same(effects, monkeypatch):
    rng = np.random.default_rng(4)
    runs = hs.Simulator(parabola, {"t": (-1, 1)}, {"a": stats.norm(0, 1)}).run(64, random_state=0)
    X = np.linspace(-1, 1, 30)[:, None]
    y = rng.standard_normal(30)
    prior, weights = stats.halfnorm(scale=0.5), rng.integers(1, 4, 30).astype(float)
    problem = make_problem(runs, hs.PolynomialChaos(3), hs.Normal(), prior, effects, ("t",), X, y)
    model = problem.model
    c = rng.standard_normal((6, len(model.basis.coefficient_mean)))
    u = np.column_stack([rng.standard_normal((50, model.n_unknowns)), rng.normal(-1, 0.5, 50)])
    which = np.arange(50) % 6

    def weighed():
        given = MeasuredGiven(model, X, y, weights, c, prior, problem.scale)
        columns = _draw_columns(replace(given, c=c[which]), u, np.random.RandomState(0))
        pairs = log_density_of_pairs(given, u, which)
        return _log_density(given, u, given.draws), pairs, columns

    by_factors = weighed()
    monkeypatch.setattr(MeasuredModel, "factorises", False)
    for told, expected in zip(by_factors, weighed(), strict=True):
        np.testing.assert_allclose(told, expected, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(by_factors[1], by_factors[0][np.arange(50), which], rtol=1e-9)


def test_rows_are_read_a_few_times_however_many_draws_there_are(monkeypatch):
    """Rows whose features factorise: the time for a draw, or a node, does not grow with them."""
    simulator = hs.Simulator(parabola, {"t": (-1, 1)}, {"a": stats.norm(0, 1)})
    runs = simulator.run(64, random_state=0)
    t = np.linspace(-1, 1, 301)
    y = 0.3 + np.random.default_rng(6).normal(0, 0.2, 301)
    read, factors = [], MeasuredModel.factors
    monkeypatch.setattr(
        MeasuredModel,
        "factors",
        lambda model, X, values: (read.append(len(X)), factors(model, X, values))[1],
    )
    times = []
    for n_draws in (50, 1000):
        read.clear()
        hs.PowerScaledSurrogate(runs, hs.PolynomialChaos(3), n_draws=n_draws, random_state=0).fit(
            t[:, None], y
        )
        times.append(read.count(301))
    assert times[0] == times[1] <= 5


def test_proposals_with_next_to_no_noise_count_for_nothing():
    """More columns of a cause than rows, so that rounding may make their covariance indefinite."""
    rng = np.random.default_rng(5)
    runs = hs.Simulator(parabola, {"t": (-1, 1)}, {"a": stats.norm(0, 1)}).run(64, random_state=0)
    X, y = np.linspace(-1, 1, 20)[:, None], rng.standard_normal(20)
    prior = stats.halfnorm(scale=0.5)
    effects = (hs.GaussianProcessDiscrepancy(),)
    problem = make_problem(runs, hs.PolynomialChaos(3), hs.Normal(), prior, effects, ("t",), X, y)
    c = rng.standard_normal((6, len(problem.model.basis.coefficient_mean)))
    given = MeasuredGiven(problem.model, X, y, np.ones(20), c, prior, problem.scale)
    z = rng.standard_normal((30, problem.model.n_unknowns))
    u = np.column_stack([z, np.repeat([-1.0, -12.0, -25.0], 10)])
    log_density = _log_density(given, u, given.draws)
    assert np.isfinite(log_density[:10]).all()
    assert log_density[10:].max() < log_density[:10].min() - 50


def test_only_cells_that_hold_mass_and_their_neighbours_are_cut():
    low, high = np.array([0.0, 10.0]), np.array([5.0, 20.0])
    nodes, width = _grid(low, high, 5)
    share = np.full(25, 1e-9)
    share[7] = 1.0  # x in 1..2, y in 14..16
    finer, cell = _finer(nodes, share, width, 3)
    np.testing.assert_allclose(cell, width / 3)
    assert len(finer) == 9 * 9
    np.testing.assert_allclose(finer.min(axis=0) - cell / 2, [0.0, 12.0], atol=1e-9)
    np.testing.assert_allclose(finer.max(axis=0) + cell / 2, [3.0, 18.0])
    # each cell once
    assert len(np.unique(np.round(finer, 9), axis=0)) == 81


def constant_and_line(n, S, outlier=0.0):
    """Rows y = c + a t + noise: given c, the posterior of a and sigma is known on a grid."""
    runs = hs.Simulator(parabola, {"t": (-1, 1)}, {"b": stats.norm(0, 1)}).run(64, random_state=0)
    rng = np.random.default_rng(5)
    X = np.linspace(-1, 1, n)[:, None]
    y = 0.4 * X[:, 0] + rng.normal(0, 0.3, n)
    y[n // 2] += outlier
    prior = stats.halfnorm(scale=0.5)
    problem = make_problem(
        runs, hs.PolynomialChaos(2, stats.norm(0, 10)), hs.Normal(), prior, (), ("t",), X, y
    )
    c = np.tile(np.linalg.solve(problem.simulation.ff, problem.simulation.fy), (S, 1))
    c[:, 0] += rng.normal(0, 0.1, S)
    return problem, c


def on_a_grid(given):
    """Nodes u, and their log densities with each coefficient draw, close together."""
    z, log_sigma = np.linspace(-2, 3, 61), np.linspace(-2.5, 1.5, 60)
    u = np.stack(np.meshgrid(z, log_sigma, indexing="ij"), axis=-1).reshape(-1, 2)
    values = given.model.values(u[:, :-1])
    parts = given.model.parts(given.X, values)
    sigma = np.exp(u[:, 1])
    out = stats.norm.logpdf(u[:, 0]) + given.noise_prior.logpdf(sigma) + u[:, 1]
    mean = parts.features @ given.c.T + parts.known[..., None]
    rows = stats.norm.logpdf(given.y[:, None], mean, sigma[:, None, None])
    return u, out[:, None] + rows.sum(axis=1)


def test_draws_of_other_coefficients_serve_by_their_shares():
    """A draw of each conditional posterior becomes many of each, with its moments."""
    problem, c = constant_and_line(12, 400)
    given = given_draws(problem, c)
    u, log_density = on_a_grid(given)
    exact = np.exp(log_density - special.logsumexp(log_density, axis=0))
    random = np.random.RandomState(0)
    own = u[one_node_each(exact, random)]
    told = own[exchanged(given, own, 100, random)]
    mean, square = exact.T @ u, exact.T @ u**2
    error = np.sqrt(square - mean**2) / np.sqrt(100)
    assert np.std((told.mean(axis=1) - mean) / error) < 1.3
    np.testing.assert_allclose(told.mean(axis=(0, 1)), mean.mean(axis=0), atol=0.03)
    np.testing.assert_allclose(
        (told**2).mean(axis=(0, 1)), square.mean(axis=0), rtol=0.1, atol=0.02
    )
    # noises follow the intercepts
    assert np.polyfit(mean[:, 1], told.mean(axis=1)[:, 1], 1)[0] == pytest.approx(1, abs=0.15)


@pytest.mark.parametrize("outlier", [0.0, 4.0])
def test_a_held_out_row_has_its_exact_density(outlier):
    """Also of a row that is 13 standard deviations away, of which draws without it say nothing."""
    problem, c = constant_and_line(12, 30, outlier)
    rest = np.arange(12) != 6
    others = replace(problem, X=problem.X[rest], y=problem.y[rest], weights=problem.weights[rest])
    all_rows, others = given_draws(problem, c), given_draws(others, c)
    (u, log_all), (_, log_others) = on_a_grid(all_rows), on_a_grid(others)
    expected = special.logsumexp(log_all, axis=0) - special.logsumexp(log_others, axis=0)
    near = [near_draws(u, special.softmax(given.mean(axis=1))) for given in (log_others, log_all)]
    told = held_out(others, all_rows, near, np.random.RandomState(0))
    np.testing.assert_allclose(told - 0.5 * np.log(2 * np.pi), expected, atol=0.15)
