"""Rows that may be scored though nothing could be fitted to them."""

import numpy as np
import pytest
from agreement import assert_same_numbers
from sklearn.base import clone

import hybridsurrogate as hs


def test_one_row_can_be_scored_but_not_fitted(fitted, measured):
    X, y = measured
    one = (np.arange(len(y)) == 3).astype(float)
    alone = fitted.score(X[3:4], y[3:4])
    assert fitted.score(X[3:4], y[3:4], sample_weight=[2.0]) == pytest.approx(alone)
    assert fitted.score(X, y, sample_weight=one) == pytest.approx(alone)
    with pytest.raises(ValueError, match="leaves 1 sample"):
        clone(fitted).fit(X, y, sample_weight=one)


def test_impossible_rows_under_a_likelihood_of_ones_own_are_scored_as_such():
    own = hs.CustomLikelihood(
        lambda y, eta, sigma: np.where(y > 0, -y / np.exp(eta) - eta, -np.inf),
        lambda eta, sigma: np.exp(eta),
        lambda eta, sigma, random_state: random_state.exponential(np.exp(eta)),
        log_scale=True,
        has_scale=False,
    )
    rng = np.random.default_rng(0)
    X, y = np.linspace(0, 1, 20)[:, None], rng.exponential(2.0, 20)
    model = hs.PowerScaledSurrogate(
        surrogate=hs.PolynomialChaos(1), likelihood=own, n_draws=100, random_state=0
    ).fit(X, y)
    assert model.log_predictive_density(X[:1], [0.0]) == -np.inf
    both = model.log_predictive_density(X[:2], [0.0, 1.0])
    assert both[0] == -np.inf
    assert_same_numbers(both[1:], model.log_predictive_density(X[1:2], [1.0]))
    with pytest.raises(ValueError, match=r"log_density_function of .* for every measured value"):
        clone(model).fit(X, np.zeros(20))
