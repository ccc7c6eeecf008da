"""What the inference returns, against closed forms."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import special, stats

import hybridsurrogate as hs
from hybridsurrogate.estimators.problem import make_problem
from hybridsurrogate.inference.collapsed import CollapsedPosterior
from hybridsurrogate.inference.ensemble import EnsembleSampler
from hybridsurrogate.inference.importance import importance_draws
from hybridsurrogate.inference.modes import Gaussian, find_modes
from hybridsurrogate.inference.pareto import pareto_smooth
from hybridsurrogate.inference.powers import powers_of
from hybridsurrogate.inference.shared_nodes import squares_of_factors
from hybridsurrogate.inference.starts import further_points
from hybridsurrogate.inference.two_step import second_step

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
    covariance = np.linalg.inv(features.T @ weighted + np.eye(features.shape[1]) / sd**2)
    return covariance @ (weighted.T @ y + np.full(features.shape[1], mean / sd**2)), covariance


def assert_gaussian(draws, mean, covariance, error=5.0):
    """Moments of draws agree with a Gaussian within their Monte Carlo error."""
    n, d = draws.shape
    whitened = np.linalg.solve(np.linalg.cholesky(covariance), (draws - mean).T)
    assert np.abs(whitened.mean(axis=1)).max() < error / np.sqrt(n)
    np.testing.assert_allclose(np.cov(whitened), np.eye(d), atol=error * np.sqrt(2 / n))


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


@pytest.mark.parametrize("effects", [(), (hs.Offset(), hs.Periodic("x"))], ids=["plain", "causes"])
@pytest.mark.parametrize("beta", [0.0, 0.2, 0.5, 0.8, 1.0])
def test_collapsed_density_is_the_dense_gaussian(drifting, beta, effects):
    """Integrating coefficients out by hand: rows are Gaussian with a dense covariance."""
    runs, X, y = drifting
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
        model, X, y, problem.weights, problem.simulation, *powers, noise_prior, problem.scale
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
    np.testing.assert_allclose(target.log_density(u), expected, rtol=1e-6, atol=1e-4)


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
        problem.simulation,
        1.0,
        1.0,
        problem.noise_prior,
        problem.scale,
    )
    u = np.random.default_rng(0).normal(-0.5, 0.5, (23, 2))
    whole = target.log_density(u), target.draw_coefficients(u, np.random.RandomState(0))[0]
    monkeypatch.setattr("hybridsurrogate.inference.collapsed._BLOCK", 250)
    cut = target.log_density(u), target.draw_coefficients(u, np.random.RandomState(0))[0]
    for one, other in zip(whole, cut, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-10)


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


# ------------------------------------------------------------------------------------ samplers

_MEAN = np.array([1.0, -2.0, 0.5])
_ROOT = np.array([[2.0, 0.0, 0.0], [0.9, 0.3, 0.0], [-0.4, 0.05, 0.1]])
_COVARIANCE = _ROOT @ _ROOT.T


def gaussian(x):
    # scipy drops the axis of a single point
    return np.atleast_1d(stats.multivariate_normal(_MEAN, _COVARIANCE).logpdf(x)) + 4.2


def test_mode_of_a_gaussian_is_the_gaussian():
    (mode,) = find_modes(gaussian, np.zeros((2, 3)))
    np.testing.assert_allclose(mode.mean, _MEAN, atol=1e-3)
    np.testing.assert_allclose(mode.factor @ mode.factor.T, _COVARIANCE, rtol=1e-2, atol=1e-3)
    assert mode.log_mass == pytest.approx(4.2, abs=0.01)


def test_importance_draws_of_a_gaussian():
    modes = find_modes(gaussian, np.zeros((1, 3)))
    result = importance_draws(gaussian, modes, 30_000, 10_000, np.random.RandomState(0))
    assert_gaussian(result.draws, _MEAN, _COVARIANCE)
    assert result.log_evidence == pytest.approx(4.2, abs=0.01)
    # weights under a proposal with heavier tails are bounded
    assert result.khat < 0
    assert result.effective_draws > 20_000


def student(x):
    target = stats.multivariate_t([3.0, 0.0], [[2.0, 0.5], [0.5, 1.0]], df=7)
    return np.atleast_1d(target.logpdf(x))


def test_importance_draws_of_coefficients_with_heavier_tails_than_their_proposal():
    def density(points):  # u normal; eight further dimensions two-sided exponential, twice as wide
        u, e = points[:, :1], points[:, 1:]
        return -0.5 * (u[:, 0] - 1.0) ** 2 - np.abs(e / 2).sum(axis=1) * np.sqrt(2)

    modes = find_modes(lambda u: -0.5 * (u[:, 0] - 1.0) ** 2, np.zeros((1, 1)))
    result = importance_draws(density, modes, 60_000, 20_000, np.random.RandomState(0), n_noise=8)
    assert result.khat < 0.7
    assert result.draws[:, 0].mean() == pytest.approx(1.0, abs=0.05)
    np.testing.assert_allclose(result.draws[:, 1:].var(axis=0), 4.0, rtol=0.12)


def test_lines_through_a_mode_find_another_one_in_the_tail_of_a_prior():
    def density(u):  # at z = -5.5 a mode that random starts would miss
        main = -0.5 * ((u[:, 0] - 2) ** 2 + u[:, 1] ** 2)
        return np.logaddexp(main, 8 - 50 * (u[:, 0] + 5.5) ** 2 - 0.5 * u[:, 1] ** 2) - u[:, 2] ** 2

    target = SimpleNamespace(model=SimpleNamespace(n_parameters=2), search_density=density)
    points = further_points(target, np.array([2.0, 0.0, 0.0]))
    assert len(points) == 1
    np.testing.assert_allclose(points[0], [-5.5, 0, 0], atol=0.2)


def test_importance_draws_of_a_student_t():
    modes = find_modes(student, np.zeros((1, 2)))
    result = importance_draws(student, modes, 60_000, 20_000, np.random.RandomState(1))
    assert result.log_evidence == pytest.approx(0.0, abs=0.01)
    assert result.khat < 0.5
    for k, (centre, scale) in enumerate([(3.0, np.sqrt(2.0)), (0.0, 1.0)]):
        cdf = stats.t(7, centre, scale).cdf(result.draws[:, k])
        for level in (0.01, 0.1, 0.5, 0.9, 0.99):
            error = np.sqrt(level * (1 - level) / 20_000)
            assert np.mean(cdf < level) == pytest.approx(level, abs=5 * error)


def test_importance_draws_follow_a_bend():
    # x is standard normal, y and z are normal around x^2: the mode shows little of either arm
    def banana(u):
        bent = u[:, 1:] - u[:, :1] ** 2
        return -0.5 * u[:, 0] ** 2 - 0.5 * np.sum((bent / 0.7) ** 2, axis=1)

    modes = find_modes(banana, np.zeros((1, 3)))
    found = [
        importance_draws(banana, modes, 3000, 3000, np.random.RandomState(seed))
        for seed in range(8)
    ]
    levels = np.array([0.05, 0.95])
    ends = np.mean([np.quantile(one.draws[:, :2], levels, axis=0) for one in found], axis=0)
    # what lies below the ends of the intervals, in truth; of y by quadrature over x
    nodes = stats.norm.ppf((np.arange(4000) + 0.5) / 4000)
    below = stats.norm.cdf((ends[:, 1, None] - nodes**2) / 0.7).mean(axis=1)
    # Monte Carlo error 0.2 points; 24 other seeds are off by up to 0.7, see `_GOOD_KHAT`
    np.testing.assert_allclose(stats.norm.cdf(ends[:, 0]), levels, atol=0.01)
    np.testing.assert_allclose(below, levels, atol=0.01)
    constant = 1.5 * np.log(2 * np.pi) + 2 * np.log(0.7)
    assert np.mean([one.log_evidence for one in found]) == pytest.approx(constant, abs=0.02)


def test_khat_condemns_a_proposal_that_is_too_narrow():
    modes = find_modes(lambda x: -0.5 * np.sum((50 * x) ** 2, axis=1), np.zeros((1, 2)))
    narrow = importance_draws(
        lambda x: -0.1 * np.log1p(np.sum(x**2, axis=1)),
        modes,
        2000,
        500,
        np.random.RandomState(0),
        max_rounds=1,
    )
    assert narrow.khat > 0.7


def test_khat_does_not_condemn_the_steps_of_a_plateau():
    # what is proposed from, times one to six: bounded weights, whose few largest look like a tail
    base = stats.t(5, scale=1.1)

    def steps(x):
        z = x[:, 0]
        high = np.where(np.abs(z + 0.5) < 0.006, 6.0, 1 + 1e-3 * np.tanh(z))
        return base.logpdf(z) + np.log(np.where(np.abs(z - 0.5) < 0.02, 2.0, high))

    modes = [Gaussian(np.zeros(1), np.eye(1))]
    found = importance_draws(steps, modes, 2000, 2000, np.random.RandomState(0), max_rounds=1)
    at, log_proposal = found.proposals.points, found.proposals.log_density
    assert pareto_smooth(steps(at) - log_proposal)[1] > 0.7
    assert found.khat <= 0
    inside = np.abs(found.draws[:, 0] - 0.5) < 0.02
    mass = 2 * np.diff(base.cdf([0.48, 0.52]))[0]
    total = 1 + mass / 2 + 5 * np.diff(base.cdf([-0.506, -0.494]))[0]
    # resampled from as many, of weight two: the variance of a count, times three
    assert inside.mean() == pytest.approx(mass / total, abs=4 * np.sqrt(3 * mass / 2000))


@pytest.mark.parametrize("df", [1.5, 4, 30])
def test_pareto_smoothing_is_that_of_arviz(df, arviz):
    log_weight = np.random.default_rng(0).standard_t(df, size=2000)
    smoothed, khat = pareto_smooth(log_weight)
    smoothed = np.exp(smoothed - special.logsumexp(smoothed))
    if arviz.__version__.startswith("0."):
        expected, expected_khat = arviz.psislw(log_weight)
    else:
        from arviz_stats.base import array_stats

        # there the argument is a log likelihood, whose negative is the log weight
        expected, expected_khat = array_stats.psislw(-log_weight)
    assert khat == pytest.approx(float(expected_khat), abs=0.01)
    np.testing.assert_allclose(smoothed, np.exp(expected), atol=2e-3 * smoothed.max())


def test_ensemble_draws_of_a_gaussian_in_four_dimensions():
    rng = np.random.default_rng(0)
    root = np.tril(rng.normal(size=(4, 4))) + 2 * np.eye(4)
    mean, covariance = np.array([5.0, 0.0, -1.0, 2.0]), root @ root.T
    target = stats.multivariate_normal(mean, covariance)

    def log_density(x):
        return np.atleast_1d(target.logpdf(x))

    modes = find_modes(log_density, np.zeros((1, 4)))
    run = EnsembleSampler().run(log_density, modes, 4000, np.random.RandomState(0))
    assert run.converged
    assert 0.1 < run.acceptance < 0.9
    assert run.autocorrelation_time > 1
    assert run.effective_draws > 1000
    assert_gaussian(run.draws, mean, covariance, error=5 * np.sqrt(4000 / run.effective_draws))


def bimodal(x):
    """Two Gaussians ten apart, the narrower one with three quarters of the mass."""
    first = np.log(0.75) + stats.multivariate_normal([0.0, 0.0], 0.25).logpdf(x)
    second = np.log(0.25) + stats.multivariate_normal([10.0, 0.0], 1.0).logpdf(x)
    return np.logaddexp(first, second)


def test_ensemble_draws_weigh_two_modes():
    modes = find_modes(bimodal, np.array([[0.5, 0.5], [9.0, 0.0]]))
    assert len(modes) == 2
    run = EnsembleSampler().run(bimodal, modes, 2000, np.random.RandomState(0))
    right = run.draws[:, 0] > 5
    assert right.mean() == pytest.approx(0.25, abs=0.06)
    assert run.draws[right].mean(axis=0) == pytest.approx([10.0, 0.0], abs=0.2)
    assert run.draws[~right].std(axis=0) == pytest.approx([0.5, 0.5], rel=0.1)


def test_ensemble_that_cannot_start_says_so():
    modes = find_modes(gaussian, np.zeros((1, 3)))
    with pytest.raises(ValueError, match="minus infinity at every walker"):
        EnsembleSampler().run(
            lambda x: np.full(len(x), -np.inf), modes, 100, np.random.RandomState(0)
        )


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


def squared(x, omega):
    return omega**2 * x


def test_a_jump_beside_a_period_needs_no_ensemble():
    # the density of a jump's location has edges: first proposals miss them, wider ones do not
    t = np.linspace(0, 10, 30)
    noise = 0.1 * np.random.default_rng(0).standard_normal(30)
    y = 3 * np.exp(-0.3 * t) + 0.5 * (t > 4) + 0.3 * np.sin(2 * np.pi * t / 2.5) + noise
    simulator = hs.Simulator(
        lambda t, start, rate: start * np.exp(-rate * t),
        inputs={"t": (0, 10)},
        parameters={
            "start": hs.truncated_normal(3, 1, 0, 6),
            "rate": hs.truncated_normal(0.3, 0.1, 0, 1),
        },
    )
    model = hs.PowerScaledSurrogate(
        simulator,
        surrogate=hs.ExactSurrogate(),
        effects=[hs.Step("t"), hs.Periodic("t")],
        n_draws=300,
        random_state=0,
    ).fit(t[:, None], y)
    assert model.diagnostics_.sampler == "importance"
    posterior = model.posterior_
    assert posterior.estimates(0)["location"].mean() == pytest.approx(4, abs=0.35)
    assert posterior.estimates(1)["period"].mean() == pytest.approx(2.5, abs=0.1)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_place_of_a_jump_has_the_exact_posterior(seed):
    """Between two rows the place does not matter: the gaps' probabilities have a closed form."""
    n, rng = 12, np.random.default_rng(seed)
    t = np.sort(rng.uniform(0, 10, n))
    y = 1.0 * (t > 5) + 0.5 * rng.standard_normal(n)
    simulator = hs.Simulator(
        lambda t, level: level + 0 * t, inputs={"t": (0, 10)}, parameters={"level": stats.norm()}
    )
    model = hs.PowerScaledSurrogate(
        simulator,
        surrogate=hs.ExactSurrogate(),
        noise_prior=stats.halfnorm(scale=0.5),
        effects=[hs.Step("t")],
        n_draws=4000,
        random_state=0,
    ).fit(t[:, None], y)
    amplitude_sd = model.posterior_.model.column_sd[0]
    sigma = np.linspace(0.1, 2, 100)
    weight = stats.halfnorm(scale=0.5).pdf(sigma)
    share = []
    for gap in range(n - 1):
        jump = (np.arange(n) > gap).astype(float)
        known = np.ones((n, n)) + amplitude_sd**2 * np.outer(jump, jump)
        density = [stats.multivariate_normal(cov=known + s**2 * np.eye(n)).pdf(y) for s in sigma]
        share.append((t[gap + 1] - t[gap]) * weight @ density)
    found, _ = np.histogram(model.posterior_.estimates(0)["location"], bins=t)
    # at least 1000 of the proposals are effective, and a row lies on the rise now and then
    assert 0.5 * np.abs(found / 4000 - share / np.sum(share)).sum() < 0.05


# what is asserted is the number of effective draws; a fit may warn of its k-hat all the same
@pytest.mark.filterwarnings("ignore::hybridsurrogate.SamplingWarning")
@pytest.mark.parametrize("seed", range(4))
def test_the_place_of_a_jump_is_proposed_well_whatever_rows_are_held_out(seed):
    # in a slow simulation the rate follows the place: proposals have to follow both
    rng = np.random.default_rng(seed)
    t = np.sort(rng.uniform(1, 100, 40))
    y = np.log1p(t) + 0.1 * (t > 35) + 0.05 * rng.standard_normal(40)
    simulator = hs.Simulator(
        lambda t, rate: rate * np.log1p(t),
        inputs={"t": (1, 100)},
        parameters={"rate": hs.truncated_normal(1.0, 0.3, 0.2, 2.0)},
    )
    model = hs.PowerScaledSurrogate(
        simulator,
        surrogate=hs.ExactSurrogate(),
        effects=[hs.Step("t")],
        sampler="importance",
        n_draws=400,
        random_state=0,
    )
    effective = []
    for _ in range(5):
        rows = np.sort(rng.permutation(40)[:32])
        effective.append(model.fit(t[rows, None], y[rows]).diagnostics_.effective_draws)
    # a quarter of the proposals; where they stay around one mode a tenth and less remains
    assert min(effective) > 300


def test_two_modes_go_to_the_ensemble():
    simulator = hs.Simulator(
        squared, inputs={"x": (0, 1)}, parameters={"omega": stats.uniform(-2, 4)}
    )
    X = np.linspace(0, 1, 15)[:, None]
    y = X[:, 0] + 0.1 * np.cos(40 * X[:, 0])
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=2000, random_state=0
    ).fit(X, y)
    assert model.diagnostics_.sampler == "emcee"
    assert model.diagnostics_.n_modes == 2
    omega = model.posterior_.values[:, 0]
    assert np.mean(omega > 0) == pytest.approx(0.5, abs=0.1)
    assert np.abs(omega).mean() == pytest.approx(1.0, abs=0.05)


# -------------------------------------------------------------------------------------- step 2


def parabola(t, **parameters):
    """A polynomial in t whose coefficients are the parameters."""
    return sum(parameters[name] * t**k for k, name in enumerate("abc") if name in parameters)


def test_squares_of_factors_are_those_of_their_products():
    rng = np.random.default_rng(0)
    of_inputs, of_parameters = rng.standard_normal((7, 5)), rng.standard_normal((300, 5))
    residual, c = rng.standard_normal(7), 100 + rng.standard_normal((11, 5))
    features = of_inputs * of_parameters[:, None]
    expected = np.sum((residual[:, None] - features @ c.T) ** 2, axis=1)
    told = squares_of_factors(of_inputs, of_parameters, residual, c)
    np.testing.assert_allclose(told, expected, rtol=1e-8)


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
    drawn = second_step(
        problem.model,
        X,
        y,
        problem.weights,
        coefficients,
        noise_prior,
        problem.scale,
        rough,
        np.random.RandomState(0),
    )
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


# -------------------------------------------------------------------------------------- causes


def cooling(t, rate):
    return 80 * np.exp(-rate * t)


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
