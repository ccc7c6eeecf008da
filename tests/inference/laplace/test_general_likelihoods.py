"""Posteriors under likelihoods that are not normal, against methods that share no code."""

import math

import numpy as np
import pytest
from scipy import special, stats
from scipy.stats import halfnorm, norm

import hybridsurrogate as hs
from hybridsurrogate.datasets import make_log_sin, make_sir
from hybridsurrogate.surrogates.families.polynomial_chaos import multi_indices


def legendre_features(points, ranges, degree):
    """The conventions of the package, by numpy's Legendre polynomials."""
    scaled = [
        (2 * x - low - high) / (high - low) for x, (low, high) in zip(points, ranges, strict=True)
    ]
    orders = np.arange(degree + 1)
    tables = [np.polynomial.legendre.legvander(x, degree) * np.sqrt(orders + 0.5) for x in scaled]
    shape = np.broadcast_shapes(*(np.shape(x) for x in scaled))
    columns = []
    for powers in multi_indices(len(ranges), degree):
        factors = [table[..., k] for table, k in zip(tables, powers, strict=True)]
        term = np.broadcast_to(math.prod(factors), shape)
        columns.append(term if powers.any() else np.ones(shape))
    return np.stack(columns, axis=-1)


def random_walk(log_density, start, covariance, n_steps, seed):
    """Metropolis chains side by side (n_chains, d); returns their second halves."""
    rng = np.random.default_rng(seed)
    points, value = start.copy(), log_density(start)
    d = start.shape[1]
    root = np.linalg.cholesky(covariance) * 2.38 / np.sqrt(d)
    kept = []
    for step in range(n_steps):
        trial = points + rng.standard_normal(points.shape) @ root.T * rng.choice([0.3, 1.0])
        new = log_density(trial)
        take = np.log(rng.uniform(size=len(points))) < new - value
        points[take], value[take] = trial[take], new[take]
        if step >= n_steps // 2 and step % 5 == 0:
            kept.append(points.copy())
    return np.concatenate(kept)


def by_hand(case, degree, likelihood, noise_prior):
    """Return the log posterior of [omega, log sigma, c] for both sources at full power."""
    simulation, prior = case.simulation, next(iter(case.simulation.parameters.values()))
    ranges = [*simulation.input_ranges.values(), *simulation.parameter_ranges.values()]
    runs = legendre_features([*simulation.X.T, *simulation.omega.T], ranges, degree)
    constants = [constant.value for constant in simulation.assumed.values()]
    low, high = prior.support()

    def log_density(points):
        omega, log_sigma, c = points[:, 0], points[:, 1], points[:, 2:]
        out = prior.logpdf(omega) + noise_prior.logpdf(np.exp(log_sigma)) + log_sigma
        out += norm(0, 5).logpdf(c).sum(axis=1)
        held = np.clip(omega, low, high)
        rows = legendre_features([case.X[:, 0], held[:, None], *constants], ranges, degree)
        sigma = np.exp(log_sigma)[:, None]
        out += likelihood(simulation.y, c @ runs.T, sigma).sum(axis=1)
        out += likelihood(case.y, (rows @ c[:, :, None])[..., 0], sigma).sum(axis=1)
        return np.where(np.isfinite(out), out, -np.inf)

    return log_density


def negative_binomial(y, eta, sigma):
    precision, mean = sigma**-2.0, np.exp(eta)
    ways = special.gammaln(y + precision) - special.gammaln(precision) - special.gammaln(y + 1)
    return ways - precision * np.log1p(mean / precision) + y * (eta - np.log(precision + mean))


def student_t(y, eta, sigma):
    # of four degrees of freedom: 3 / 8 (1 + z^2 / 4)^(-5 / 2)
    return np.log(0.375 / sigma) - 2.5 * np.log1p(((y - eta) / sigma) ** 2 / 4)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("likelihood", "density", "make", "degree"),
    [
        ("negative-binomial", negative_binomial, lambda: make_sir(
            add_one=False, round_counts=True, random_state=3), 3),
        ("student-t", student_t, lambda: make_log_sin(random_state=3), 2),
    ],
    ids=["negative-binomial-22", "student-t-8"],
)  # fmt: skip
def test_posterior_is_that_of_a_random_walk(likelihood, density, make, degree):
    case = make()
    noise_prior = halfnorm(scale=1.0)
    model = hs.PowerScaledSurrogate(
        case.simulation,
        surrogate=hs.PolynomialChaos(degree, norm(0, 5)),
        likelihood=likelihood,
        noise_prior=noise_prior,
        beta=0.5,
        n_draws=3000,
        random_state=0,
    ).fit(case.X, case.y)
    first = model.first_step_
    ours = np.column_stack([first.values[:, 0], np.log(first.sigma), first.coefficients])
    # ours tell the chains how far to step, and where to start: half as wide and a standard
    # deviation off along the second widest direction, so that nothing agrees by itself
    variance, axes = np.linalg.eigh(np.cov(ours.T))
    centre = ours.mean(axis=0)
    start = centre + 0.5 * (ours[:150] - centre) + np.sqrt(variance[-2]) * axes[:, -2]
    log_density = by_hand(case, degree, density, noise_prior)
    theirs = random_walk(log_density, start, np.cov(ours.T), 800, seed=1)
    shift = (ours.mean(axis=0) - theirs.mean(axis=0)) / theirs.std(axis=0)
    assert np.abs(shift).max() < 0.15
    np.testing.assert_allclose(ours.std(axis=0), theirs.std(axis=0), rtol=0.10)


@pytest.mark.slow
def test_full_ensemble_agrees_with_importance_draws(simulation):
    rng = np.random.default_rng(4)
    t = np.linspace(0.2, 3.8, 30)
    runs = hs.SimulationData(
        simulation.X,
        simulation.omega,
        rng.poisson(np.maximum(simulation.y, 0.1)),
        inputs={"t": (0, 4)},
        parameters=simulation.parameters,
    )
    y = rng.poisson(100 - 9.3 / 2 * t**2)
    draws = []
    for sampler in ("importance", "emcee"):
        model = hs.PowerScaledSurrogate(
            runs,
            surrogate=hs.PolynomialChaos(2, norm(0, 5)),
            likelihood="poisson",
            sampler=sampler,
            n_draws=4000,
            random_state=0,
        ).fit(t[:, None], y)
        assert model.diagnostics_.sampler == sampler
        assert model.diagnostics_.converged
        first = model.first_step_
        draws.append(np.column_stack([first.values[:, 0], first.coefficients]))
    one, other = draws
    shift = (one.mean(axis=0) - other.mean(axis=0)) / other.std(axis=0)
    assert np.abs(shift).max() < 0.15
    np.testing.assert_allclose(one.std(axis=0), other.std(axis=0), rtol=0.10)


@pytest.mark.slow
def test_a_likelihood_without_scale_reports_none(measured):
    X, y = measured
    model = hs.PowerScaledSurrogate(
        surrogate=hs.PolynomialChaos(2), likelihood="poisson", n_draws=100, random_state=0
    ).fit(X, np.round(y))
    assert "sigma" not in model.posterior_.named()
    low, high = model.predict_interval(np.repeat(X, 40, axis=0))
    assert low.shape == (1280,)
    assert (low == np.round(low)).all()
    # what is asked beside a row does not change its interval by more than the draws
    few = model.predict_interval(X)
    np.testing.assert_allclose(low[::40], few[0], atol=2)
    np.testing.assert_allclose(high[::40], few[1], atol=2)


@pytest.mark.slow
def test_custom_normal_is_the_normal(simulation, measured):
    own = hs.CustomLikelihood(
        lambda y, eta, sigma: stats.norm.logpdf(y, eta, sigma),
        lambda eta, sigma: eta,
        lambda eta, sigma, random_state: random_state.normal(eta, sigma),
    )
    X, y = measured
    models = [
        hs.PowerScaledSurrogate(
            simulation,
            surrogate=hs.PolynomialChaos(2),
            likelihood=likelihood,
            noise_prior=halfnorm(scale=5),
            beta=0.4,
            n_draws=2000,
            random_state=0,
        ).fit(X, y)
        for likelihood in ("normal", own)
    ]
    one, other = (model.posterior_ for model in models)
    for name in ("gravity", "sigma"):
        a, b = one.named()[name], other.named()[name]
        assert abs(a.mean() - b.mean()) < 0.15 * a.std()
        assert b.std() == pytest.approx(a.std(), rel=0.1)
    assert models[0].score(X, y) == pytest.approx(models[1].score(X, y), abs=0.02)
    low, high = models[1].predict_interval(X)
    expected = models[0].predict_interval(X)
    np.testing.assert_allclose(low, expected[0], atol=0.25)
    np.testing.assert_allclose(high, expected[1], atol=0.25)


@pytest.mark.parametrize(
    ("likelihood", "spoil", "match"),
    [
        ("poisson", lambda y: y - 200, r"Poisson likelihood needs counts .* is negative"),
        ("negative-binomial", lambda y: y + 0.5, r"negative binomial .* is no whole number"),
        (hs.StudentT(df=0), lambda y: y, "needs a df that is positive"),
        (
            hs.CustomLikelihood(
                lambda y, eta, sigma: np.full_like(eta, np.nan), lambda e, s: e, lambda e, s, r: e
            ),
            lambda y: y,
            "log_density_function of .* is NaN or infinite for every measured value",
        ),
        (
            hs.CustomLikelihood(lambda y, eta, sigma: 0.0, lambda e, s: e, lambda e, s, r: e),
            lambda y: y,
            r"log_density_function .* must return the shape of eta, \(2, 32\), got \(\)",
        ),
    ],
    ids=["negative", "fraction", "df", "nan", "shape"],
)
def test_bad_values_and_functions(likelihood, spoil, match, measured):
    X, y = measured
    with pytest.raises(ValueError, match=match):
        hs.PowerScaledSurrogate(likelihood=likelihood).fit(X, spoil(np.round(y)))


@pytest.mark.slow
def test_diagnosis_of_runs_takes_heavy_tails(simulation, measured):
    """Nothing is wrong; an emulator stands for the simulation, so that screening alone decides."""
    model = hs.PowerScaledSurrogate(
        simulation,
        surrogate=hs.PolynomialChaos(2),
        likelihood="student-t",
        n_draws=300,
        random_state=0,
    )
    diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, random_state=0).fit(*measured)
    assert diagnosis.verdict_ == "adequate"
    weighed = diagnosis.causes_.set_index("form")
    assert "likelihood is not normal" in weighed.loc["noise", "note"].tolist()[-1]
