import numpy as np
import pytest
from scipy import integrate, special, stats

import hybridsurrogate as hs
from hybridsurrogate.likelihoods import (
    BetaBinomial,
    Binomial,
    CustomLikelihood,
    LogNormal,
    NegativeBinomial,
    Normal,
    Poisson,
    StudentT,
    as_likelihood,
)

ETA = np.array([[-0.5, 0.2, 1.3], [0.0, 1.0, -2.0]])
SIGMA = np.array([[0.3], [0.8]])
Y = np.array([0.4, 1.5, 2.5])

CASES = [
    (Normal(), stats.norm(ETA, SIGMA)),
    (LogNormal(), stats.lognorm(s=SIGMA, scale=np.exp(ETA))),
]


@pytest.mark.parametrize(("likelihood", "distribution"), CASES)
def test_is_the_distribution_of_scipy(likelihood, distribution):
    np.testing.assert_allclose(likelihood.log_density(Y, ETA, SIGMA), distribution.logpdf(Y))
    np.testing.assert_allclose(likelihood.mean(ETA, SIGMA), distribution.mean())
    np.testing.assert_allclose(likelihood.variance(ETA, SIGMA), distribution.var())
    np.testing.assert_allclose(likelihood.inverse(ETA), distribution.median())


@pytest.mark.parametrize(("likelihood", "distribution"), CASES)
def test_draws_have_the_distribution(likelihood, distribution):
    random = np.random.RandomState(0)
    shape = (4000, *ETA.shape)
    draws = likelihood.sample(np.broadcast_to(ETA, shape), SIGMA, random)
    assert draws.shape == shape
    u = distribution.cdf(draws)
    for index in np.ndindex(ETA.shape):
        assert stats.kstest(u[:, *index], "uniform").pvalue > 1e-3


@pytest.mark.parametrize(("likelihood", "distribution"), CASES)
def test_transform_and_back(likelihood, distribution):
    np.testing.assert_allclose(likelihood.inverse(likelihood.link(Y)), Y)
    step = 1e-6
    slope = (likelihood.link(Y + step) - likelihood.link(Y - step)) / (2 * step)
    np.testing.assert_allclose(likelihood.log_jacobian(Y), np.log(slope), atol=1e-8)


PRECISION = SIGMA**-2.0
OTHERS = [
    (StudentT(5.0), stats.t(5.0, loc=ETA, scale=SIGMA), Y),
    (Poisson(), stats.poisson(np.exp(ETA) + 0 * SIGMA), np.round(Y)),
    (
        NegativeBinomial(),
        stats.nbinom(PRECISION, PRECISION / (PRECISION + np.exp(ETA))),
        np.round(Y),
    ),
    (
        BetaBinomial(7),
        stats.betabinom(7, PRECISION * special.expit(ETA), PRECISION * special.expit(-ETA)),
        np.array([0.0, 3.0, 7.0]),
    ),
]


@pytest.mark.parametrize(("likelihood", "distribution", "y"), OTHERS)
def test_others_are_those_of_scipy(likelihood, distribution, y):
    discrete = isinstance(distribution.dist, stats.rv_discrete)
    density = distribution.logpmf if discrete else distribution.logpdf
    np.testing.assert_allclose(likelihood.log_density(y, ETA, SIGMA), density(y))
    np.testing.assert_allclose(likelihood.mean(ETA, SIGMA), distribution.mean())
    np.testing.assert_allclose(
        likelihood.variance(ETA, SIGMA) + 0 * SIGMA, distribution.var() + 0 * ETA
    )
    random = np.random.RandomState(0)
    draws = likelihood.sample(np.broadcast_to(ETA, (20_000, *ETA.shape)), SIGMA, random)
    error = np.sqrt(distribution.var() / 20_000)
    assert (np.abs(draws.mean(axis=0) - distribution.mean()) < 4.5 * error).all()
    np.testing.assert_allclose(draws.var(axis=0), distribution.var() + 0 * ETA, rtol=0.15)


SMOOTH = [Normal(), LogNormal(), Poisson(), NegativeBinomial(), BetaBinomial(6)]


@pytest.mark.parametrize("likelihood", SMOOTH)
def test_derivatives_are_those_of_the_density(likelihood):
    y = np.maximum(np.round(Y), 1.0)
    step = 1e-4
    density = [likelihood.log_density(y, ETA + d, SIGMA) for d in (-step, 0, step)]
    gradient, curvature = likelihood.derivatives(y, ETA, SIGMA)
    np.testing.assert_allclose(
        gradient, (density[2] - density[0]) / (2 * step), rtol=1e-5, atol=1e-7
    )
    second = -(density[2] - 2 * density[1] + density[0]) / step**2
    np.testing.assert_allclose(curvature, second, rtol=1e-4)


def test_a_small_sigma_makes_a_negative_binomial_a_poisson():
    y = np.round(Y)
    np.testing.assert_allclose(
        NegativeBinomial().log_density(y, ETA, np.array([[1e-6]])),
        Poisson().log_density(y, ETA, SIGMA),
        atol=1e-5,
    )


def test_a_small_sigma_makes_a_beta_binomial_a_binomial():
    y = np.round(Y)
    few, tiny = BetaBinomial(5), np.array([[1e-6]])
    np.testing.assert_allclose(
        few.log_density(y, ETA, tiny), Binomial(5).log_density(y, ETA, SIGMA), atol=1e-5
    )
    np.testing.assert_allclose(
        few.information(ETA, tiny), Binomial(5).information(ETA, SIGMA), rtol=1e-5
    )


@pytest.mark.parametrize("trials", [2, 40, 1000])
def test_the_information_of_successes_that_scatter(trials):
    """The mean square of the score, over all that may come out."""
    y = np.arange(trials + 1.0)[:, None, None]
    likelihood = BetaBinomial(trials)
    mass = np.exp(likelihood.log_density(y, ETA, SIGMA))
    np.testing.assert_allclose(mass.sum(axis=0), 1.0)
    score, _ = likelihood.derivatives(y, ETA, SIGMA)
    exact = np.sum(mass * score**2, axis=0)
    np.testing.assert_allclose(likelihood.information(ETA, SIGMA), exact, rtol=0.03)


def test_single_trials_do_not_scatter():
    with pytest.raises(ValueError, match=r"needs two or more trials .* BetaBinomial\(trials="):
        hs.PowerScaledSurrogate(likelihood="beta-binomial").fit(
            np.arange(6.0)[:, None], np.array([0.0, 1, 0, 1, 1, 0])
        )


def test_only_the_log_normal_is_on_a_log_scale():
    assert LogNormal.log_scale
    assert not Normal.log_scale


def test_log_normal_needs_positive_values():
    Normal().check(np.array([-1.0, 0.0]))
    LogNormal().check(np.array([1e-9, 1.0]))
    with pytest.raises(ValueError, match=r"needs y > 0, but 2 of 4 measured .*row 1: 0\).*y \+ 1"):
        LogNormal().check(np.array([1.0, 0.0, 2.0, -3.0]))
    with pytest.raises(ValueError, match="1 of 2 simulated values"):
        LogNormal().check(np.array([1.0, -3.0]), "simulated")


def test_log_normal_far_out_overflows_in_silence():
    eta, sigma = np.array([[900.0]]), np.array([[2.0]])
    assert np.isfinite(LogNormal().inverse(eta))
    assert LogNormal().mean(eta, sigma) > 1e300
    assert LogNormal().variance(eta, sigma) > 1e300


def test_names():
    assert as_likelihood("normal") == Normal()
    assert as_likelihood("lognormal") == LogNormal()
    own = LogNormal()
    assert as_likelihood(own) is own
    for wrong in ("gamma", None, ["normal"]):
        with pytest.raises(ValueError, match=r"one of \['beta-binomial', 'binomial', 'logn"):
            as_likelihood(wrong)


def test_smoothed_density_of_a_student_t_is_its_mean_over_a_normal_kernel():
    likelihood, y = StudentT(df=4), np.array([0.5, -2.0, 6.0])
    eta, sigma, width = np.zeros((1, 3)), np.full((1, 1), 0.7), np.full((1, 3), 0.4)

    def mean(function):
        node = np.linspace(-8, 8, 4001)
        values = function(node) * stats.norm.pdf(node)[:, None]
        return integrate.trapezoid(values, node, axis=0)

    def density(node):
        return stats.t.logpdf(y, 4, loc=0.4 * node[:, None], scale=0.7)

    value = likelihood.smoothed(y, eta, sigma, width)[0]
    gradient, curvature = likelihood.derivatives(y, eta, sigma, width)
    np.testing.assert_allclose(value, mean(density), atol=1e-3)
    slope = mean(lambda node: node[:, None] * density(node)) / 0.4
    np.testing.assert_allclose(gradient[0], slope, atol=5e-3)
    second = -mean(lambda node: (node[:, None] ** 2 - 1) * density(node)) / 0.16
    expected = np.where(second > 0, second, 0.1 * slope**2)
    np.testing.assert_allclose(curvature[0], expected, atol=2e-2)


def test_kinks_of_a_users_density_are_smoothed_for_proposals():
    laplace = CustomLikelihood(
        lambda y, eta, sigma: -np.abs(y - eta) / sigma - np.log(2 * sigma),
        lambda eta, sigma: eta,
        lambda eta, sigma, random_state: random_state.laplace(eta, sigma),
    )
    eta = np.array([[0.0, 1.0]])
    _, curvature = laplace.derivatives(
        np.array([0.0, 1.0]), eta, np.ones((1, 1)), np.full((1, 2), 0.5)
    )
    # the second derivative of E|h e| is 2 phi(0) / h; nine nodes see the kink but roughly
    np.testing.assert_allclose(curvature, 2 * stats.norm.pdf(0) / 0.5, rtol=0.25)


def test_tails_without_squares_are_refused():
    # the quantile at a rounding error of 2e-16 is about 1e157 for a df of 0.1, 1e142 for 0.11
    with pytest.raises(ValueError, match=r"StudentT\(0.01\) has tails so heavy"):
        hs.StudentT(0.01).check(np.ones(3))
    hs.StudentT(0.11).check(np.ones(3))
