"""Surrogates of several outputs: each output is that of a surrogate of its own."""

import numpy as np
import pytest
from scipy.stats import uniform

import hybridsurrogate as hs
from hybridsurrogate.surrogates.basis import Domain
from hybridsurrogate.surrogates.families.stacked import built_for_each


def domain_of(X, omega, eta, names):
    return Domain(
        np.array([[0.0, 10.0], [0.0, 1.0]]) if X.shape[1] > 1 else np.array([[0.0, 10.0]]),
        np.array([[0.1, 0.5]]),
        float(np.mean(eta)),
        float(np.std(eta)),
        None,
        X,
        omega,
        eta,
        names,
        ("k",),
    )


@pytest.mark.parametrize(
    "surrogate",
    [hs.PolynomialChaos(3), hs.Kriging(), hs.GaussianProcess()],
)
@pytest.mark.parametrize("curves", [False, True])
def test_each_output_is_its_own_surrogate(surrogate, curves):
    simulator = hs.Simulator(
        lambda t, k: (np.exp(-k * t), 5 + np.sin(t * k)),
        {"t": (0, 10)},
        {"k": uniform(0.1, 0.4)},
        output=("h", "q"),
    )
    runs = simulator.run(12 if curves else 60, along=9 if curves else None, random_state=0)
    single = runs.single_output(np.ones(2))
    whole = built_for_each(
        surrogate, domain_of(single.X, single.omega, single.y, single.input_names), ("h", "q")
    )
    random = np.random.default_rng(1)
    X, omega = random.uniform(0, 10, (7, 1)), random.uniform(0.1, 0.5, (7, 1))
    which = np.array([0, 1, 1, 0, 1, 0, 0])
    stacked = np.column_stack([X, which])
    hyper = np.array([[prior.median() for prior in whole.hyperpriors.values()]])
    fixed = whole.given(hyper[0])
    p = len(whole.coefficient_mean)
    c = random.standard_normal(p)
    output = fixed.output(stacked, omega, c)
    outer = fixed.outer_output(stacked, omega[:3], c)
    known, features = fixed.outer(stacked, omega[:3])
    error = fixed.error(stacked, omega)
    first = 0
    for k in range(2):
        own = surrogate.build(domain_of(runs.X, runs.omega, runs.y[:, k], ("t",)))
        n = len(own.hyperpriors)
        q = len(own.coefficient_mean)
        one = own.given(hyper[0, k * n : (k + 1) * n])
        mine = c[first : first + q]
        here = which == k
        np.testing.assert_allclose(
            output[here], one.output(X[here], omega[here], mine), rtol=1e-8, atol=1e-10
        )
        np.testing.assert_allclose(
            outer[:, here], one.outer_output(X[here], omega[:3], mine), rtol=1e-8, atol=1e-10
        )
        told = one.outer(X[here], omega[:3])
        np.testing.assert_allclose(known[:, here], told[0], rtol=1e-8, atol=1e-10)
        np.testing.assert_allclose(
            features[:, here, first : first + q], told[1], rtol=1e-8, atol=1e-10
        )
        alone = one.error(X[here], omega[here])
        np.testing.assert_allclose(
            (error @ error.T)[np.ix_(here, here)], alone @ alone.T, rtol=1e-8, atol=1e-12
        )
        # outputs have no coefficient in common
        others = np.delete(features[:, here], np.arange(first, first + q), axis=2)
        assert not np.any(others)
        first += q
