"""What every likelihood must hold, registered or with nothing but a log density and samples."""

import pickle
import re

import numpy as np
import pytest
from few_kinds import all_but
from scipy import special, stats

import hybridsurrogate as hs
from hybridsurrogate import likelihoods
from hybridsurrogate.likelihoods import LIKELIHOODS, CustomLikelihood, Likelihood, as_likelihood
from hybridsurrogate.likelihoods.base import register

ETA = np.array([[0.3, 0.9, 2.0], [0.0, 1.5, 2.5]])
SIGMA = np.array([[0.3], [0.8]])
N = 8_000


class Laplace(Likelihood):
    """Nothing but a density and samples."""

    name = "Laplace"
    rough = True

    def log_density(self, y, eta, sigma):
        return -np.abs(y - eta) / sigma - np.log(2 * sigma)

    def sample(self, eta, sigma, random_state):
        return random_state.laplace(eta, sigma)


class Gamma(Likelihood):
    """Positive, with mean exp(eta) and relative scatter sigma."""

    name = "gamma"
    log_scale = True

    def log_density(self, y, eta, sigma):
        shape = np.asarray(sigma) ** -2.0
        rate = shape * np.exp(-np.asarray(eta))
        return (
            special.xlogy(shape - 1, y) - rate * y + shape * np.log(rate) - special.gammaln(shape)
        )

    def sample(self, eta, sigma, random_state):
        return random_state.gamma(sigma**-2.0, np.exp(eta) * sigma**2)


class Logistic(Likelihood):
    """No second parameter, and a scatter below one."""

    name = "logistic"
    has_scale = False

    def log_density(self, y, eta, sigma):
        return stats.logistic.logpdf(y, eta, 0.05)

    def sample(self, eta, sigma, random_state):
        return random_state.logistic(eta, 0.05)


def log_normal(y, eta, sigma):
    return -0.5 * ((y - eta) / sigma) ** 2 - np.log(sigma) - 0.5 * np.log(2 * np.pi)


NORMAL = CustomLikelihood(log_normal, sample_function=lambda eta, s, random: random.normal(eta, s))
ALONE = {
    "double-exponential": (Laplace(), stats.laplace(ETA, SIGMA)),
    "gamma": (Gamma(), stats.gamma(SIGMA**-2.0, scale=np.exp(ETA) * SIGMA**2)),
    "logistic": (Logistic(), stats.logistic(ETA, 0.05)),
    "custom": (NORMAL, stats.norm(ETA, SIGMA)),
}
ALL = LIKELIHOODS | {name: likelihood for name, (likelihood, _) in ALONE.items()}
each = pytest.mark.parametrize("likelihood", ALL.values(), ids=[*ALL])


def drawn(likelihood, n=N):
    """Return n draws for each eta, (n, 2, 3)."""
    many = np.broadcast_to(ETA, (n, *ETA.shape))
    return likelihood.sample(many, SIGMA, np.random.RandomState(1))


@pytest.mark.parametrize("name", LIKELIHOODS)
def test_a_name_is_known_and_its_class_public(name):
    likelihood = LIKELIHOODS[name]
    assert as_likelihood(name) is likelihood
    own = type(likelihood).__name__
    assert getattr(hs, own) is getattr(likelihoods, own) is type(likelihood)
    assert own in hs.__all__
    assert own in likelihoods.__all__
    assert eval(repr(likelihood), vars(hs)) == likelihood
    assert pickle.loads(pickle.dumps(likelihood)) == likelihood


@each
def test_draws_are_possible_and_on_the_scale_of_eta(likelihood):
    y = drawn(likelihood, 200)
    assert y.shape == (200, *ETA.shape)
    for one in y:
        likelihood.check(one.ravel())
        assert np.isfinite(likelihood.log_density(one, ETA, SIGMA)).all()
    assert np.isfinite(likelihood.working(y[0].ravel())).all()
    output = likelihood.inverse(ETA)
    np.testing.assert_allclose(likelihood.inverse(likelihood.link(output)), output)


@pytest.mark.slow
@pytest.mark.parametrize("likelihood", LIKELIHOODS.values(), ids=[*LIKELIHOODS])
def test_mean_and_variance_are_those_of_the_draws(likelihood):
    y = drawn(likelihood)
    variance = y.var(axis=0)
    error = np.sqrt(variance / len(y))
    assert (np.abs(likelihood.mean(ETA, SIGMA) - y.mean(axis=0)) < 4.5 * error).all()
    # of a Student-t with four degrees of freedom the fourth moment is infinite
    tolerance = 0.3 if isinstance(likelihood, hs.StudentT) else 0.12
    np.testing.assert_allclose(
        np.broadcast_to(likelihood.variance(ETA, SIGMA), ETA.shape), variance, rtol=tolerance
    )


@pytest.mark.slow
@each
def test_the_density_is_that_of_the_draws(likelihood):
    """The score has mean zero, and its mean square is the information (Bartlett's identities)."""
    y, step = drawn(likelihood), 1e-5
    ahead, behind = (likelihood.log_density(y, ETA + d, SIGMA) for d in (step, -step))
    score = (ahead - behind) / (2 * step)
    error = score.std(axis=0) / np.sqrt(len(y))
    assert (np.abs(score.mean(axis=0)) < 4.5 * error).all()
    if not likelihood.rough:  # else the information is that of a smoothed density
        information, squares = likelihood.information(ETA, SIGMA), score**2
        expected = squares.mean(axis=0)
        # where there is no formula it is an average of 400 samples
        alone = any(likelihood is one for one, _ in ALONE.values())
        error = 4.5 * squares.std(axis=0) / np.sqrt(400) if alone else 0.15 * expected
        assert (np.abs(information - expected) < error).all()


@each
def test_derivatives_climb(likelihood):
    """The slope is that of what an optimiser climbs, and the curvature is positive."""
    y = drawn(likelihood, 2)[0]
    width = np.full(ETA.shape, 0.2) if likelihood.rough else None
    gradient, curvature = likelihood.derivatives(y, ETA, SIGMA, width)
    assert (curvature > 0).all()
    step = 1e-4
    ahead, behind = (likelihood.smoothed(y, ETA + d, SIGMA, width) for d in (step, -step))
    slope = (ahead - behind) / (2 * step)
    # nine nodes see a kink but roughly
    tolerance = (0.3 if likelihood.rough else 1e-2) * np.sqrt(curvature)
    assert (np.abs(gradient - slope) < tolerance).all()


@each
def test_a_prior_of_the_noise(likelihood):
    prior = likelihood.noise_prior(2.0)
    assert prior.support()[0] >= 0
    assert np.isfinite(prior.ppf(0.5))


@pytest.mark.parametrize(("likelihood", "distribution"), ALONE.values(), ids=[*ALONE])
def test_mean_and_variance_are_averages_of_samples(likelihood, distribution):
    sd, mean, excess = (distribution.stats(moments=m) + 0 * ETA for m in ("v", "m", "k"))
    variance, sd = sd, np.sqrt(sd)
    assert (np.abs(likelihood.mean(ETA, SIGMA) - mean) < 4.5 * sd / np.sqrt(400)).all()
    error = variance * np.sqrt((excess + 2) / 400)
    assert (np.abs(likelihood.variance(ETA, SIGMA) - variance) < 4.5 * error).all()


def test_a_density_alone_is_fitted_and_scored_and_asked_for_samples(simulation, measured):
    X, y = measured
    alone, normal = (
        hs.PowerScaledSurrogate(
            simulation, surrogate=hs.PolynomialChaos(2), likelihood=likelihood, n_draws=200,
            random_state=0,
        ).fit(X, y)
        for likelihood in (CustomLikelihood(log_normal), "normal")
    )  # fmt: skip
    assert alone.score(X, y) == pytest.approx(normal.score(X, y), abs=0.05)
    for ask in (alone.predict, alone.predict_interval):
        with pytest.raises(ValueError, match=r"user's own .* log density alone.*sample_function"):
            ask(X)
    with pytest.raises(ValueError, match=r"log density alone.*sample_function"):
        hs.DiscrepancyDiagnosis(alone, cv=None, random_state=0).fit(X, y)


def test_counts_by_samples():
    with_sample = CustomLikelihood(
        lambda y, eta, sigma: stats.poisson.logpmf(y, np.exp(eta)),
        sample_function=lambda eta, sigma, random_state: random_state.poisson(np.exp(eta)) * 1.0,
        log_scale=True,
        has_scale=False,
    )
    with_sample.check_training(np.array([3.0, 5.0, 8.0]))
    mean = with_sample.mean(ETA, SIGMA)
    np.testing.assert_allclose(mean, np.exp(ETA), atol=4.5 * np.sqrt(np.exp(ETA.max()) / 400))


def test_what_cannot_be_registered():
    before = dict(LIKELIHOODS)
    with pytest.raises(TypeError, match=re.escape("register('gamma', ...) needs a Likelihood")):
        register("gamma", stats.gamma)
    with pytest.raises(ValueError, match=r"'normal' is that of Normal"):
        register("normal", Laplace())
    assert before == LIKELIHOODS


def test_a_users_likelihood_in_a_diagnosis_with_alternatives():
    """Clones of the estimator have copies of it, and their predictions are averaged."""
    simulator = hs.Simulator(
        lambda t, level: level * np.exp(-t / 5), {"t": (0, 10)}, {"level": stats.norm(5, 1)}
    )
    random = np.random.default_rng(0)
    t = np.sort(random.uniform(0, 10, 40))
    y = 5.5 * np.exp(-t / 5) + 0.2 * t + 0.3 * random.laplace(size=40)
    model = hs.PowerScaledSurrogate(
        simulator, hs.ExactSurrogate(), likelihood=Laplace(), n_draws=100, random_state=0
    )
    settings = {"exclude": all_but("trend"), "cv": None, "n_replicates": 19}
    found = hs.DiscrepancyDiagnosis(model, **settings, random_state=0).fit(t[:, None], y)
    assert found.verdict_ != "adequate"
    assert len(found.extended_estimator_.estimators_) > 1
    assert np.isfinite(found.predict(t[:, None])).all()
    assert Laplace() == Laplace() != Logistic()
