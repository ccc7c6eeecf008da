"""What the inference returns, against closed forms."""

import numpy as np
import pytest
from moments import assert_gaussian
from problems import make_problem
from scipy import special, stats

import hybridsurrogate as hs
from hybridsurrogate.inference.conjugate.collapsed import CollapsedPosterior
from hybridsurrogate.model.statistics import powers_of

NOISE = 0.5
# a noise prior that leaves nothing to learn about sigma
TIGHT = stats.lognorm(s=1e-4, scale=NOISE)


def known_sigma_fit(simulation, X, y, beta, n_draws=20_000, degree=1, **parameters):
    return hs.PowerScaledSurrogate(
        simulation,
        surrogate=hs.PolynomialChaos(degree, coefficient_prior=stats.norm(0.3, 2)),
        beta=beta,
        noise_prior=TIGHT,
        n_draws=n_draws,
        random_state=0,
        **parameters,
    ).fit(X, y)


def line_features(x, low, high):
    """Intercept and the orthonormal polynomial of degree one."""
    return np.column_stack([np.ones(len(x)), np.sqrt(1.5) * (2 * x - low - high) / (high - low)])


def conjugate(features, y, noise_variance, mean, sd):
    """Posterior mean and covariance of Bayesian linear regression with independent noise."""
    weighted = features / np.asarray(noise_variance)[:, None]
    precision = np.full(features.shape[1], 1.0) / np.square(sd)
    covariance = np.linalg.inv(features.T @ weighted + np.diag(precision))
    return covariance @ (weighted.T @ y + mean * precision), covariance


@pytest.fixture(scope="module")
def line():
    """Runs and measurements of two lines that disagree; there are no unknown parameters."""
    rng = np.random.default_rng(4)
    run_x, x = rng.uniform(0, 2, 15), np.linspace(0, 2, 9)
    runs = hs.SimulationData(
        run_x, None, 1 + 2 * run_x + rng.normal(0, NOISE, 15), inputs={"x": (0, 2)}
    )
    return runs, x[:, None], 2 - 1 * x + rng.normal(0, NOISE, 9)


def test_conjugate_regression_on_measured_data_alone():
    x = np.linspace(-1, 3, 12)
    y = 1 + 0.5 * x + np.cos(30 * x) / 2
    model = known_sigma_fit(None, x[:, None], y, beta=0.5)
    expected = conjugate(line_features(x, -1, 3), y, np.full(12, NOISE**2), 0.3, 2)
    assert_gaussian(model.posterior_.coefficients, *expected)
    np.testing.assert_allclose(model.posterior_.sigma, NOISE, rtol=1e-3)


@pytest.mark.parametrize(
    ("beta", "run_power", "measured_power"),
    [(0.0, 0, 1), (0.2, 0.25, 1), (0.5, 1, 1), (0.8, 1, 0.25), (1.0, 1, 0)],
)
def test_a_power_of_a_likelihood_is_a_noise_variance(line, beta, run_power, measured_power):
    runs, X, y = line
    assert powers_of(beta) == pytest.approx((run_power, measured_power))
    used, variance = [], []
    for rows, power in ((runs, run_power), (line, measured_power)):
        x, values = (rows.X, rows.y) if rows is runs else (X, y)
        if power:
            used.append((line_features(x[:, 0], 0, 2), values))
            variance += [NOISE**2 / power] * len(values)
    features, values = (np.concatenate(pieces) for pieces in zip(*used, strict=True))
    expected = conjugate(features, values, variance, 0.3, 2)
    assert_gaussian(known_sigma_fit(runs, X, y, beta).first_step_.coefficients, *expected)


@pytest.fixture(scope="module")
def drifting():
    """Runs of a function of one input and one parameter, and measurements of something else."""
    rng = np.random.default_rng(6)
    x, omega = rng.uniform(0, 1, 20), rng.uniform(-1, 1, 20)
    runs = hs.SimulationData(
        x,
        omega,
        x * omega + omega**2,
        inputs={"x": (0, 1)},
        parameters={"omega": hs.truncated_normal(0.2, 0.5, -1, 1)},
    )
    X = np.linspace(0, 1, 8)[:, None]
    return runs, X, 0.4 + np.sin(3 * X[:, 0])


@pytest.mark.parametrize("n", [8, 3], ids=["many rows", "few rows"])
@pytest.mark.parametrize("effects", [(), (hs.Offset(), hs.Periodic("x"))], ids=["plain", "causes"])
@pytest.mark.parametrize("beta", [0.0, 0.2, 0.5, 0.8, 1.0])
def test_collapsed_density_is_the_dense_gaussian(drifting, beta, effects, n):
    """Integrating coefficients out by hand: rows are Gaussian with a dense covariance."""
    runs, X, y = drifting
    X, y = X[:n], y[:n]
    noise_prior = stats.halfnorm(scale=0.7)
    problem = make_problem(
        runs,
        hs.PolynomialChaos(2, stats.norm(0.1, 3)),
        hs.Normal(),
        noise_prior,
        effects,
        ("x",),
        X,
        y,
    )
    powers = powers_of(beta)
    model = problem.model
    target = CollapsedPosterior(
        model, X, y, problem.weights, *powers, noise_prior, problem.scale, problem.simulation
    )
    rng = np.random.default_rng(0)
    u = np.column_stack([rng.normal(size=(6, model.n_unknowns)), rng.normal(-1, 0.7, 6)])

    expected = np.empty(len(u))
    for j, (*z, log_sigma) in enumerate(u):
        values = model.values(np.array([z]))
        omega = values[0, 0]
        features = [_two_features(runs.X[:, 0], runs.omega[:, 0]), _two_features(X[:, 0], omega)]
        # causes act on measured rows only; their own coefficients have mean zero
        columns = model.added(X, values)[0] * model.column_sd
        added = [np.zeros((20, columns.shape[1])), columns]
        rows, variance, constant = [], [], 0.0
        for F, H, out, alpha in zip(features, added, (runs.y, y), powers, strict=True):
            if alpha:
                rows.append((F, H, out))
                variance += [np.exp(2 * log_sigma) / alpha] * len(out)
            # N(y; m, s^2)^alpha is N(y; m, s^2 / alpha) times this
            s2 = 2 * np.pi * np.exp(2 * log_sigma)
            constant -= 0.5 * alpha * len(out) * np.log(s2)
            constant += 0.5 * len(out) * np.log(s2 / alpha) if alpha else 0.0
        F, H, out = (np.concatenate(pieces) for pieces in zip(*rows, strict=True))
        covariance = 9 * F @ F.T + H @ H.T + np.diag(variance)
        expected[j] = (
            stats.multivariate_normal(0.1 * F.sum(axis=1), covariance).logpdf(out)
            + constant
            + noise_prior.logpdf(np.exp(log_sigma))
            + log_sigma
            - 0.5 * np.dot(z, z)
        )
    np.testing.assert_allclose(target.search_density(u), expected, rtol=1e-6, atol=1e-4)


def test_coefficients_given_few_rows_and_runs_are_the_conjugate_ones(drifting):
    runs, X, y = drifting
    X, y = X[:3], y[:3]
    surrogate = hs.PolynomialChaos(2, stats.norm(0.1, 3))
    problem = make_problem(runs, surrogate, hs.Normal(), None, (hs.Offset(),), ("x",), X, y)
    model, weights = problem.model, np.array([1.0, 2.0, 0.5])
    powers, sigma = (0.7, 0.4), 0.3
    target = CollapsedPosterior(
        model, X, y, weights, *powers, problem.noise_prior, problem.scale, problem.simulation
    )
    u = np.tile([0.4, np.log(sigma)], (20_000, 1))
    draws = np.hstack(target.draw_coefficients(u, np.random.RandomState(0)))
    omega = model.values(u[:1, :-1])[0, 0]
    run_rows = np.hstack([_two_features(runs.X[:, 0], runs.omega[:, 0]), np.zeros((20, 1))])
    rows = np.hstack([_two_features(X[:, 0], omega), np.ones((3, 1))])
    variance = sigma**2 / np.append(np.full(20, 0.7), 0.4 * weights)
    sd = np.append(np.full(6, 3.0), model.column_sd)
    features, out = np.vstack([run_rows, rows]), np.append(runs.y, y)
    # the prior mean of the cause's coefficient is zero
    mean = np.append(np.full(6, 0.1), 0.0)
    expected, covariance = conjugate(features, out - features @ mean, variance, 0.0, sd)
    assert_gaussian(draws, mean + expected, covariance)


def _two_features(x, omega):
    """All products of orthonormal polynomials up to degree two in x on [0, 1], omega on [-1, 1]."""
    x, omega = 2 * np.asarray(x) - 1, np.broadcast_to(omega, np.shape(x))

    def p(t, k):
        return np.sqrt(k + 0.5) * special.eval_legendre(k, t)

    terms = [(0, 1), (0, 2), (1, 0), (1, 1), (2, 0)]
    return np.column_stack([np.ones(len(x)), *(p(x, i) * p(omega, j) for i, j in terms)])


def test_large_batches_are_cut_without_a_seam(drifting, monkeypatch):
    runs, X, y = drifting
    problem = make_problem(runs, hs.PolynomialChaos(2), hs.Normal(), None, (), ("x",), X, y)
    target = CollapsedPosterior(
        problem.model,
        X,
        y,
        problem.weights,
        1.0,
        1.0,
        problem.noise_prior,
        problem.scale,
        problem.simulation,
    )
    u = np.random.default_rng(0).normal(-0.5, 0.5, (23, 2))
    whole = target.search_density(u), target.draw_coefficients(u, np.random.RandomState(0))[0]
    monkeypatch.setattr("hybridsurrogate.inference.conjugate.collapsed.LARGE_BLOCK", 250)
    cut = target.search_density(u), target.draw_coefficients(u, np.random.RandomState(0))[0]
    for one, other in zip(whole, cut, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-10)


@pytest.mark.filterwarnings("ignore:The measured outputs.*outside all that was simulated")
def test_beta_zero_ignores_the_runs(drifting):
    runs, X, y = drifting
    other = hs.SimulationData(
        runs.X, runs.omega, 7 - 3 * runs.y, runs.input_ranges, runs.parameters
    )
    draws = [
        known_sigma_fit(simulation, X, y, beta=0.0, n_draws=500, degree=2).first_step_
        for simulation in (runs, other)
    ]
    for name in ("values", "sigma", "coefficients"):
        np.testing.assert_allclose(getattr(draws[0], name), getattr(draws[1], name), rtol=1e-6)


@pytest.mark.filterwarnings("ignore:The measured outputs.*outside all that was simulated")
def test_beta_one_ignores_the_measured_data_in_step_one(drifting):
    runs, X, y = drifting
    models = [known_sigma_fit(runs, X, values, beta=1.0, degree=2) for values in (y, 5 + y[::-1])]
    first = [model.first_step_ for model in models]
    F = _two_features(runs.X[:, 0], runs.omega[:, 0])
    expected = conjugate(F, runs.y, np.full(20, NOISE**2), 0.3, 2)
    for posterior in first:
        assert_gaussian(posterior.coefficients, *expected)
        # and nothing is learnt about omega
        prior = runs.parameters["omega"]
        assert stats.kstest(posterior.values[::10, 0], prior.cdf).pvalue > 1e-3
    # while step two does look at the measured data
    assert np.abs(models[0].predict(X) - models[1].predict(X)).max() > 0.1


@pytest.mark.slow
def test_samplers_agree(drifting):
    runs, X, y = drifting
    importance, ensemble = (
        hs.PowerScaledSurrogate(
            runs,
            surrogate=hs.PolynomialChaos(2, stats.norm(0, 3)),
            noise_prior=stats.halfnorm(scale=0.5),
            sampler=sampler,
            n_draws=6000,
            random_state=0,
        ).fit(X, y)
        for sampler in ("auto", "emcee")
    )
    assert importance.diagnostics_.sampler == "importance"
    assert ensemble.diagnostics_.sampler == "emcee"
    assert ensemble.diagnostics_.autocorrelation_time > 1
    for step in ("first_step_", "posterior_"):
        one, other = getattr(importance, step), getattr(ensemble, step)
        for name in ("values", "sigma", "coefficients"):
            a, b = getattr(one, name), getattr(other, name)
            sd = a.std(axis=0)
            assert np.max(np.abs(a.mean(axis=0) - b.mean(axis=0)) / sd) < 0.15
            np.testing.assert_allclose(b.std(axis=0), sd, rtol=0.1)


# -------------------------------------------------------------------------------------- causes


def cooling(t, rate):
    return 80 * np.exp(-rate * t)


@pytest.mark.slow
def test_coefficients_of_causes_recover_a_line():
    simulator = hs.Simulator(
        cooling,
        inputs={"t": (0, 10)},
        parameters={"rate": hs.truncated_normal(0.3, 0.02, 0.1, 0.5)},
    )
    simulation = simulator.run(128, random_state=0)
    t = np.linspace(0, 10, 60)
    slopes, offsets = [], []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        y = cooling(t, 0.31) + 4 + 1.5 * (t - 5) + rng.normal(0, 1, 60)
        model = hs.PowerScaledSurrogate(
            simulation,
            surrogate=hs.PolynomialChaos(5),
            effects=[hs.Trend("t")],
            random_state=0,
        ).fit(t[:, None], y)
        offset = model.posterior_.estimates(0)["level"]
        slope = model.posterior_.estimates(0)["slope"]
        slopes.append((slope.mean() - 1.5) / slope.std())
        offsets.append((offset.mean() - 4.0) / offset.std())
        assert slope.std() < 0.5
        assert offset.std() < 2
    # in units of their own standard deviations
    for z in (slopes, offsets):
        assert np.abs(z).max() < 3
        assert np.mean(np.abs(z) < 1.645) >= 0.5
