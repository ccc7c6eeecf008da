import numpy as np
import pytest
from scipy import stats

import hybridsurrogate as hs
from hybridsurrogate.priors import (
    check_priors,
    from_normal,
    prior_range,
    to_normal,
    truncated_normal,
)


def test_truncated_normal_is_in_the_units_of_the_parameter():
    prior = truncated_normal(2.0, 0.5, 1, 3)
    assert prior.support() == (1, 3)
    assert prior.median() == pytest.approx(2.0)
    x = np.array([1.5, 2.5, 2.9])
    untruncated = stats.norm(2.0, 0.5)
    mass = untruncated.cdf(3) - untruncated.cdf(1)
    np.testing.assert_allclose(prior.pdf(x), untruncated.pdf(x) / mass)


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ((0, 0, -1, 1), "sd must be positive, got 0"),
        ((0, 1, 1, -1), "low must be below high, got low=1 and high=-1"),
        ((20, 1, 0, 6), r"A normal\(20, 1\) has no mass between 0 and 6: move the bounds"),
        ((0, 1, 9, 12), "has no mass between 9 and 12"),
        ((np.nan, 1, 0, 6), "mean must be a finite number, got nan"),
    ],
)
def test_truncated_normal_refuses(arguments, match):
    with pytest.raises(ValueError, match=match):
        truncated_normal(*arguments)


def test_priors_must_be_frozen_distributions():
    assert list(check_priors({"a": stats.norm(0, 1), "b": stats.uniform()})) == ["a", "b"]
    assert check_priors(None) == {}
    with pytest.raises(TypeError, match=r"must be a dict of name to prior, .*got \['rate'\]"):
        check_priors(["rate"])
    for wrong in (1.0, "normal", (0, 1)):
        with pytest.raises(TypeError, match=r"prior of 'rate' must be a frozen scipy.stats"):
            check_priors({"rate": wrong})


def test_range_replaces_infinite_ends_by_quantiles():
    assert prior_range(stats.uniform(2, 3)) == (2, 5)
    low, high = prior_range(stats.halfnorm(scale=2))
    assert low == 0
    assert high == pytest.approx(stats.halfnorm(scale=2).isf(0.001))
    assert prior_range(stats.norm(), tail=0.025) == pytest.approx((-1.96, 1.96), abs=1e-3)


@pytest.mark.parametrize(
    "prior",
    [stats.norm(3, 2), stats.uniform(-1, 4), stats.halfnorm(scale=0.5), stats.gamma(2.0)],
)
def test_normal_coordinates_and_back(prior):
    z = np.linspace(-6, 6, 25)[:, None]
    values = from_normal([prior], z)
    assert (np.diff(values[:, 0]) > 0).all()
    np.testing.assert_allclose(to_normal([prior], values), z, atol=1e-5)


class Norm(type(stats.norm)):
    """A distribution of the user's own, under a name that scipy has, too."""

    def _ppf(self, q):
        return 3.0 + super()._ppf(q)

    def _isf(self, q):
        return 3.0 + super()._isf(q)

    def _pdf(self, x):
        return super()._pdf(x - 3.0)


@pytest.mark.parametrize(
    "prior",
    [
        stats.gamma(2.0, 1.0, 3.0),
        stats.gamma(scale=3.0, a=2.0),
        stats.beta(2, 3, loc=-1),
        # without bends: the table is exact for them
        stats.rv_histogram((np.array([1.0]), np.array([0.0, 4.0])))(loc=2.0),
        Norm(name="norm")(loc=1.0, scale=2.0),
    ],
)
def test_quantiles_however_the_numbers_are_given(prior):
    # a second prior of the family must not get the first one's numbers
    from_normal([stats.gamma(5.0), stats.norm()], np.zeros((1, 2)))
    z = np.array([-2.0, -0.4, 0.3, 1.7])
    expected = prior.ppf(stats.norm.cdf(z))
    np.testing.assert_allclose(from_normal([prior], z[:, None])[:, 0], expected, rtol=1e-8)


@pytest.mark.parametrize(("decades", "error"), [(2, 2e-10), (6, 2e-8), (12, 2e-7)])
def test_quantiles_of_a_prior_over_many_decades(decades, error):
    prior = stats.loguniform(10 ** (-decades / 2), 10 ** (decades / 2))
    z = np.linspace(-3, 3, 1001)
    expected = prior.ppf(stats.norm.cdf(z))
    np.testing.assert_allclose(from_normal([prior], z[:, None])[:, 0], expected, rtol=error)


def test_coordinates_of_several_priors_keep_their_columns():
    priors = [stats.norm(10, 1), stats.uniform(0, 2)]
    values = from_normal(priors, np.zeros((2, 3, 2)))
    assert values.shape == (2, 3, 2)
    np.testing.assert_allclose(values[..., 0], 10)
    np.testing.assert_allclose(values[..., 1], 1)


def test_standard_normal_coordinates_have_the_prior():
    z = np.random.default_rng(0).standard_normal((2000, 1))
    prior = truncated_normal(0.9, 0.05, 0.6, 1.4)
    assert stats.kstest(from_normal([prior], z)[:, 0], prior.cdf).pvalue > 0.01


def test_coordinates_stay_finite_at_the_ends_of_the_support():
    prior = stats.uniform(0, 1)
    assert np.isfinite(to_normal([prior], [[0.0], [1.0]])).all()
    assert np.isfinite(from_normal([stats.norm()], [[-1e6], [1e6]])).all()


class Counted(stats.rv_continuous):
    """A uniform distribution that counts the quantiles it is asked for."""

    asked = 0

    def _pdf(self, x):
        return np.ones_like(x)

    def _cdf(self, x):
        return x

    def _ppf(self, q):
        Counted.asked += np.size(q)
        return q

    def _isf(self, q):
        Counted.asked += np.size(q)
        return 1 - q


def test_each_quantile_is_asked_for_once():
    """Where scipy has to invert a distribution function, as of von Mises, one takes 2 ms."""
    prior = Counted(a=0, b=1, name="counted")()
    z = np.linspace(-3, 3, 31)
    np.testing.assert_allclose(from_normal([prior], z[:, None])[:, 0], stats.norm.cdf(z), atol=1e-9)
    assert Counted.asked <= 2001  # the nodes of the table


@pytest.mark.slow
@pytest.mark.parametrize("prior", [stats.vonmises(4), stats.invgauss(1e-9)])
def test_priors_that_scipy_inverts(prior):
    z = np.array([-2.0, 0.0, 1.0])
    expected = prior.ppf(stats.norm.cdf(z))
    np.testing.assert_allclose(from_normal([prior], z[:, None])[:, 0], expected, rtol=1e-6)


@pytest.mark.parametrize("prior", [stats.norm(np.nan, 1), stats.norm(0, -1), stats.uniform(0, 0)])
def test_priors_of_numbers_that_make_none(prior):
    with pytest.raises(ValueError, match="prior of 'g' has no finite median"):
        hs.Simulator(lambda t, g: t, {"t": (0, 1)}, {"g": prior})
