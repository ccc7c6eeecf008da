"""The diagnosis under likelihoods that are not normal: counts, heavy tails, one's own."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import integrate, stats

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.search.exact_scores import scored
from hybridsurrogate.inference.laplace import Design, PredictorPart, gaussian_fit
from hybridsurrogate.inference.posterior_sampler import evidence_around
from hybridsurrogate.inference.procedure import make_target
from hybridsurrogate.likelihoods import Binomial, NegativeBinomial, Poisson, StudentT
from hybridsurrogate.likelihoods.base import Likelihood
from hybridsurrogate.model.rows.measured_data import ObservedRows

RATE = hs.Simulator(
    lambda year, rate: rate + 0 * year,
    inputs={"year": (1960, 2000)},
    parameters={"rate": hs.truncated_normal(20, 8, 1, 60)},
    output="accidents",
)
FALL = hs.Simulator(
    lambda t, a, k: a * np.exp(-k * t),
    inputs={"t": (0, 40)},
    parameters={
        "a": hs.truncated_normal(20, 5, 5, 40),
        "k": hs.truncated_normal(0.03, 0.02, 0, 0.1),
    },
)


def diagnosed(simulator, x, y, likelihood, cv=None, max_causes=None):
    model = hs.PowerScaledSurrogate(
        simulator,
        surrogate=hs.ExactSurrogate(),
        likelihood=likelihood,
        n_draws=300,
        random_state=0,
    )
    return hs.DiscrepancyDiagnosis(model, cv=cv, max_causes=max_causes, random_state=0).fit(
        x[:, None], y
    )


@pytest.fixture(scope="module")
def yearly():
    year = np.arange(1960, 2000.0)
    counts = np.random.default_rng(0).poisson(np.where(year < 1980, 20, 11))
    return year, counts.astype(float), diagnosed(RATE, year, counts.astype(float), "poisson", cv=2)


@pytest.mark.slow
def test_yearly_counts_name_the_year_in_which_their_rate_fell(yearly):
    found = yearly[2]
    assert found.p_value_ < 0.05
    assert found.best_cause_.kind == "step"
    _, low, high = found.best_cause_.estimates["location"]
    assert low < 1980 < high
    _, low, high = found.best_cause_.estimates["amplitude"]
    assert low < np.log(11 / 20) < high
    assert found.gain_.elpd_difference > 0


@pytest.mark.slow
def test_report_of_counts_speaks_of_their_likelihood(yearly):
    text = str(yearly[2].report(full=True))
    assert "Under the Poisson likelihood the cause acts on log accidents" in text
    assert "log-normal" not in text


@pytest.mark.slow
def test_extended_simulation_of_counts_falls(yearly):
    simulator = yearly[2].extended_simulator_
    before, after = simulator(
        np.array([[1970.0], [1990.0]]),
        np.repeat([[20.0, 1980.0, np.log(0.55)]], 2, axis=0),
    )
    assert after / before == pytest.approx(0.55)


@pytest.mark.slow
def test_counts_at_a_steady_rate_are_adequate():
    year = np.arange(1960, 2000.0)
    alarms = 0
    for seed in range(5):
        counts = np.random.default_rng(seed).poisson(3.0, 40).astype(float)
        alarms += diagnosed(RATE, year, counts, "poisson").verdict_ != "adequate"
    # at a rate of 5 % more than two of five have a chance of one in 860
    assert alarms <= 2


@pytest.mark.slow
def test_outliers_in_student_t_data_raise_no_alarm():
    t, rng = np.linspace(0, 40, 60), np.random.default_rng(3)
    y = 22 * np.exp(-0.03 * t) + 0.7 * rng.standard_t(4, 60)
    y[[10, 30]] += [-9, 15]
    assert diagnosed(FALL, t, y, "student-t").verdict_ == "adequate"


def laplace(scale=1.0):
    return hs.CustomLikelihood(
        lambda y, eta, sigma: -np.abs(y - eta) / sigma - np.log(2 * sigma),
        lambda eta, sigma: eta,
        lambda eta, sigma, random_state: random_state.laplace(eta, sigma),
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", ["student-t", "own"])
def test_a_step_is_found_under_heavy_tails(name):
    t, rng = np.linspace(0, 40, 60), np.random.default_rng(3)
    noise = rng.standard_t(4, 60) if name == "student-t" else rng.laplace(size=60)
    mean = 22 * np.exp(-0.03 * t) * np.where(t > 20, 0.6, 1)
    likelihood = "student-t" if name == "student-t" else laplace()
    found = diagnosed(FALL, t, mean + noise, likelihood)
    assert found.p_value_ < 0.05
    assert "step" in found.indistinguishable_
    _, low, high = found.best_cause_.estimates["location"]
    # between the rows to either side
    assert low < 20.34
    assert high > 19.66


@pytest.mark.slow
def test_successes_name_what_makes_them_fewer():
    t, rng = np.linspace(0, 40, 60), np.random.default_rng(3)
    share = np.where(t > 20, 0.25, 0.6)
    simulator = hs.Simulator(
        lambda t, p: 30 * p + 0 * t,
        inputs={"t": (0, 40)},
        parameters={"p": stats.beta(2, 2)},
        output="hits",
    )
    found = diagnosed(simulator, t, rng.binomial(30, share).astype(float), Binomial(trials=30))
    assert found.verdict_ == "named"
    assert found.best_cause_.kind == "step"


def test_evidence_by_importance_is_that_of_quadrature():
    """One parameter and no cause: the integral over the rate is one-dimensional."""
    year = np.arange(1960, 1980.0)
    counts = np.random.default_rng(1).poisson(20, 20).astype(float)
    model = hs.PowerScaledSurrogate(
        RATE, surrogate=hs.ExactSurrogate(), likelihood="poisson", random_state=0
    ).fit(year[:, None], counts)
    problem = model.inference_.problem
    found = evidence_around(
        make_target(problem, 0.0, 1.0), np.zeros((1, 2)), np.random.RandomState(0)
    )
    prior = RATE.parameters["rate"]
    expected, _ = integrate.quad(
        lambda rate: prior.pdf(rate) * np.exp(stats.poisson(rate).logpmf(counts).sum() + 60),
        *(10, 35),
        epsabs=1e-12,
    )
    # 1000 proposals of which most count
    assert found == pytest.approx(np.log(expected) - 60, abs=0.05)


def test_normal_rows_keep_their_closed_form():
    y = 20 - np.linspace(0, 9, 30) ** 0.9
    # a curve without noise is no kind, and two of them with a row left out imitate it
    found = diagnosed(FALL, np.linspace(0, 40, 30), y, "normal", max_causes=1)
    assert scored(found.search_) is found.search_


@pytest.mark.parametrize(
    ("likelihood", "sigma"), [(Poisson(), 1.0), (NegativeBinomial(), 0.4), (StudentT(), 0.7)]
)
def test_information_is_the_mean_square_of_the_score(likelihood, sigma):
    eta = np.log([[2.0, 20.0]])
    told = likelihood.information(eta, np.array([[sigma]]))
    sampled = Likelihood.information(likelihood, eta, np.array([[sigma]]))
    # of 400 samples the relative standard error is sqrt((kurtosis - 1) / 400), at most 0.09 here:
    # a kurtosis of 4 is that of the negative binomial
    np.testing.assert_allclose(sampled, told, rtol=0.35)


def test_binomial_is_scipys():
    eta, y = np.array([[-2.0, 0.0, 1.5]]), np.array([0.0, 7.0, 12.0])
    share = 1 / (1 + np.exp(-eta))
    likelihood = Binomial(trials=12)
    expected = stats.binom(12, share)
    np.testing.assert_allclose(likelihood.log_density(y, eta, None), expected.logpmf(y))
    np.testing.assert_allclose(likelihood.mean(eta, None), expected.mean())
    np.testing.assert_allclose(likelihood.variance(eta, None), expected.var())
    np.testing.assert_allclose(likelihood.link(likelihood.inverse(eta)), eta)


@pytest.mark.parametrize(("y", "word"), [([0.0, 13.0], "0 to 12"), ([0.5, 1.0], "shares")])
def test_what_are_no_successes_is_refused(y, word):
    with pytest.raises(ValueError, match=word):
        Binomial(trials=12).check(np.array(y))


@pytest.mark.parametrize("likelihood", ["normal", "poisson"])
def test_a_fit_tells_its_evidence_and_the_error(likelihood):
    """By quadrature over the rate, and over sigma where there is one."""
    year = np.arange(1960, 1980.0)
    counts = np.random.default_rng(1).poisson(20, 20).astype(float)
    noise = stats.halfnorm(scale=5)
    model = hs.PowerScaledSurrogate(
        RATE,
        surrogate=hs.ExactSurrogate(),
        likelihood=likelihood,
        noise_prior=noise if likelihood == "normal" else None,
        random_state=0,
    ).fit(year[:, None], counts)
    rate = np.linspace(10, 35, 801)
    if likelihood == "poisson":
        log_density = stats.poisson(rate[:, None]).logpmf(counts).sum(axis=1)
    else:
        sigma = np.linspace(1, 15, 600)
        rows = stats.norm(rate[:, None], sigma[:, None, None]).logpdf(counts[:, None, None].T[0])
        given_sigma = np.exp(rows.sum(axis=2) + 60) * noise.pdf(sigma)[:, None]
        log_density = np.log(integrate.trapezoid(given_sigma, sigma, axis=0)) - 60
    density = RATE.parameters["rate"].pdf(rate) * np.exp(log_density + 60)
    expected = np.log(integrate.trapezoid(density, rate)) - 60
    told = model.diagnostics_
    assert 0 < told.log_evidence_error < 0.05
    assert abs(told.log_evidence - expected) < 4 * told.log_evidence_error


@pytest.mark.slow
def test_two_causes_of_counts_are_both_named():
    t, rng = np.linspace(0, 40, 80), np.random.default_rng(3)
    rate = 40 * np.exp(-0.03 * t + 0.3 * np.sin(2 * np.pi * t / 7)) * np.where(t > 20, 0.6, 1)
    simulator = hs.Simulator(
        lambda t, a, k: a * np.exp(-k * t),
        inputs={"t": (0, 40)},
        parameters={
            "a": hs.truncated_normal(40, 10, 5, 80),
            "k": hs.truncated_normal(0.03, 0.02, 0, 0.1),
        },
    )
    model = hs.PowerScaledSurrogate(
        simulator,
        surrogate=hs.ExactSurrogate(),
        likelihood="poisson",
        n_draws=300,
        random_state=0,
    )
    diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, max_causes=2, random_state=0)
    found = {
        cause.kind: cause.estimates
        for cause in diagnosis.fit(t[:, None], rng.poisson(rate).astype(float)).found_causes_
    }
    assert found.keys() == {"periodic", "step"}
    _, low, high = found["periodic"]["period"]
    assert low < 7 < high
    _, low, high = found["step"]["location"]
    assert low < 20.3 < high


def test_counts_of_a_rate_that_explodes_leave_no_singular_matrix():
    """Proposals far off give rows so much weight that the prior is lost in rounding."""
    design = np.ones((1, 40, 2))
    rows = ObservedRows(np.full(40, 1e9), np.ones(40))
    part = PredictorPart(rows, np.full((1, 40), 45.0), design, np.ones((1, 1)), Poisson())
    fit = gaussian_fit(Design([part], np.arange(2)), np.ones((1, 1)), 0)
    assert np.isfinite(fit.mode).all()
