"""The best test of noise: densities by hand, and the power of a test of two variances."""

from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest
from hidden_effects import limits
from hidden_effects.cases import make_case
from scipy import stats


def test_outliers_may_be_any_rows():
    rng = np.random.default_rng(0)
    noise = 2 * rng.standard_normal((5, 9))
    density = np.zeros(5)
    for far in combinations(range(9), 3):  # three rows at least, of twice the size and once more
        sd = np.where(np.isin(np.arange(9), far), 3.0, 1.0)
        density += stats.norm(0, sd).pdf(noise).prod(axis=1) / 84
    usual = stats.norm(0, np.sqrt((3 * 9 + 6) / 9)).pdf(noise).prod(axis=1)
    found = limits.log_ratio("noise: tails", 1.0, None, noise)
    np.testing.assert_allclose(found, np.log(density / usual))


@pytest.mark.parametrize("form", ["noise", "noise: mean", "noise: autocorrelation"])
def test_other_forms_are_normal(form):
    case = make_case(form, 2.0, 0, 20)
    noise = np.random.default_rng(0).standard_normal((3, 20))
    drawn = limits.drawn(form, 2.0, case, 400_000, np.random.default_rng(1))
    covariance = np.cov(drawn.T)
    assert np.trace(covariance) / 20 == pytest.approx(1, abs=0.003)
    ratio = limits.log_ratio(form, 2.0, case, noise)
    # the density of what is drawn: half a square of up to 100 is known to 0.2 % (Wishart)
    own = stats.multivariate_normal(cov=covariance).logpdf(noise)
    np.testing.assert_allclose(ratio, own - stats.norm.logpdf(noise).sum(axis=1), atol=0.4)


def test_power_of_a_test_of_two_variances(monkeypatch):
    # half of the rows with four times the variance of the others
    n, sd = 40, np.repeat([np.sqrt(1.6), np.sqrt(0.4)], 20)
    monkeypatch.setattr(limits, "shape", lambda form, size, case: sd)
    monkeypatch.setattr(limits, "make_case", lambda *_: SimpleNamespace(y=np.zeros(n)))
    found = limits.best_power("noise", 1.0, n, n_cases=20)
    # the ratio knows a weighted sum of two chi-squares
    rng = np.random.default_rng(99)
    first, second = rng.chisquare(20, (2, 400_000))
    weights = 0.5 - 0.5 / 1.6, 0.5 - 0.5 / 0.4
    limit = np.quantile(weights[0] * first + weights[1] * second, 0.95)
    power = np.mean(weights[0] * 1.6 * first + weights[1] * 0.4 * second > limit)
    assert found == pytest.approx(power, abs=0.02)
