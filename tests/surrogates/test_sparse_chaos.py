"""Polynomial chaos of few terms: those that foresee the runs."""

import numpy as np
import pytest
from sklearn.linear_model import LinearRegression
from sklearn.model_selection import LeaveOneOut, cross_val_predict

import hybridsurrogate as hs
from hybridsurrogate.surrogates import Domain
from hybridsurrogate.surrogates.families.polynomial_chaos import _least_left_out


def friedman(u):
    return (
        10 * np.sin(np.pi * u[:, 0] * u[:, 1])
        + 20 * (u[:, 2] - 0.5) ** 2
        + 10 * u[:, 3]
        + 5 * u[:, 4]
    )


def basis(surrogate, n, d=10, seed=0):
    u = np.random.default_rng(seed).uniform(size=(n, d))
    y, ranges = friedman(u), np.tile([0.0, 1.0], (d, 1))
    domain = Domain(ranges[:1], ranges[1:], y.mean(), y.std(), None, u[:, :1], u[:, 1:], y)
    return surrogate.build(domain), u, y


def missed(surrogate, n=200):
    """Return the error at new runs in shares of their spread."""
    built, u, y = basis(surrogate, n)
    terms = built.features(u[:, :1], u[:, 1:])
    fit = LinearRegression(fit_intercept=False).fit(terms, y - built.known(u[:, :1], u[:, 1:]))
    new = np.random.default_rng(1).uniform(size=(2000, u.shape[1]))
    told = built.output(new[:, :1], new[:, 1:], fit.coef_)
    return np.sqrt(np.mean((told - friedman(new)) ** 2)) / np.std(friedman(new))


def test_a_sparse_expansion_of_ten_inputs_is_closer_with_a_tenth_of_the_terms():
    sparse = hs.PolynomialChaos(5, sparse=True)
    assert missed(sparse) < 0.4 * min(missed(hs.PolynomialChaos(2)), missed(hs.PolynomialChaos(1)))
    # of 3003 terms
    assert len(basis(sparse, 200)[0].coefficient_mean) < 100


def test_inputs_that_do_nothing_are_left_out():
    built, *_ = basis(hs.PolynomialChaos(5, sparse=True), 400)
    used = built.powers.any(axis=0)
    assert used[:5].all()
    # the five that do nothing have few terms among those that do
    assert np.sum(built.powers[:, 5:].any(axis=1)) < 0.3 * len(built.powers)
    assert not built.powers[0].any()  # the intercept comes first


def test_the_leave_one_out_error_is_that_of_fits_without_each_row():
    rng = np.random.default_rng(0)
    terms = rng.normal(size=(30, 6))
    y = terms[:, 0] + 0.5 * terms[:, 1] + 0.3 * rng.normal(size=30)
    terms /= np.sqrt(np.mean(terms**2, axis=0))
    errors = []
    for k in range(7):
        design = np.column_stack([np.ones(30), terms[:, :k]])
        fit = LinearRegression(fit_intercept=False)
        left = y - cross_val_predict(fit, design, y, cv=LeaveOneOut())
        trace = np.trace(np.linalg.inv(design.T @ design))
        errors.append(np.mean(left**2) * 30 / (30 - k - 1) * (1 + trace))
    assert _least_left_out(terms, y) == np.argmin(errors) == 2


def test_it_is_fitted_like_the_others():
    _, u, y = basis(hs.PolynomialChaos(3, sparse=True), 100, d=5)
    simulation = hs.SimulationData(u, None, y, inputs=list("abcde"))
    model = hs.PowerScaledSurrogate(
        simulation, surrogate=hs.PolynomialChaos(3, sparse=True), n_draws=100, random_state=0
    )
    model.fit(u[:30], y[:30] + 0.1 * np.random.default_rng(0).normal(size=30))
    assert np.sqrt(np.mean((model.predict(u) - y) ** 2)) < 0.5 * np.std(y)


@pytest.mark.parametrize("sparse", [1.5, "yes", None])
def test_what_is_neither_is_refused(sparse):
    with pytest.raises(TypeError, match=r"sparse must be True or False"):
        basis(hs.PolynomialChaos(3, sparse=sparse), 50)
