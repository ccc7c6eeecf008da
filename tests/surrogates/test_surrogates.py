import doctest

import numpy as np
import pytest
from scipy import special, stats
from shared_files import needs_reference, reference_values

import hybridsurrogate as hs
from hybridsurrogate.surrogates import Basis, Domain, Surrogate
from hybridsurrogate.surrogates.families.polynomial_chaos import legendre, multi_indices

DOMAIN = Domain(
    np.array([[0.0, 4.0], [-1.0, 1.0]]), np.array([[10.0, 20.0]]), location=3.0, scale=2.0
)


def points(n, seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform([0, -1], [4, 1], (n, 2)), rng.uniform(10, 20, (n, 1))


def test_legendre_is_orthonormal():
    x, weight = np.polynomial.legendre.leggauss(20)
    values = legendre(x, 9)
    np.testing.assert_allclose((values * weight) @ values.T, np.eye(10), atol=1e-12)


def test_legendre_is_that_of_scipy():
    x = np.linspace(-1.2, 1.2, 7)
    for degree in (0, 1, 2, 5):
        expected = [np.sqrt(k + 0.5) * special.eval_legendre(k, x) for k in range(degree + 1)]
        np.testing.assert_allclose(legendre(x, degree), expected)


@pytest.mark.parametrize(("n", "degree"), [(1, 4), (2, 5), (3, 3), (4, 2)])
def test_terms_up_to_a_total_degree(n, degree):
    terms = multi_indices(n, degree)
    assert len(terms) == special.comb(n + degree, degree, exact=True)
    assert len(np.unique(terms, axis=0)) == len(terms)
    assert terms.sum(axis=1).max() == degree
    assert not terms[0].any()


@needs_reference
def test_order_of_the_terms_is_the_published_one():
    order = reference_values()["conventions"]["poly_order"]
    np.testing.assert_array_equal(multi_indices(2, 5)[1:], order)


def test_features_are_products_of_scaled_polynomials():
    basis = hs.PolynomialChaos(degree=3).build(DOMAIN)
    X, omega = points(11)
    scaled = np.column_stack([X[:, 0] / 2 - 1, X[:, 1], (omega[:, 0] - 15) / 5])
    expected = np.ones((11, 20))
    for k, powers in enumerate(multi_indices(3, 3)[1:], start=1):
        for column, degree in zip(scaled.T, powers, strict=True):
            expected[:, k] *= np.sqrt(degree + 0.5) * special.eval_legendre(degree, column)
    np.testing.assert_allclose(basis.features(X, omega), expected, atol=1e-12)


def test_parameters_are_held_at_the_ends_of_their_range_and_inputs_are_not():
    basis = hs.PolynomialChaos(degree=2).build(DOMAIN)
    X, _ = points(3)
    beyond, at_end = np.full((3, 1), 25.0), np.full((3, 1), 20.0)
    np.testing.assert_array_equal(basis.features(X, beyond), basis.features(X, at_end))
    assert (basis.features(X + 10, at_end) != basis.features(X, at_end)).any()


def test_default_prior_is_scale_aware_around_the_mean_of_the_output():
    basis = hs.PolynomialChaos(degree=2).build(DOMAIN)
    X, omega = points(3)
    np.testing.assert_array_equal(basis.known(X, omega), 3.0)
    np.testing.assert_array_equal(basis.coefficient_mean, 0.0)
    np.testing.assert_array_equal(basis.coefficient_sd, 10.0)


def test_given_prior_is_taken_as_it_is():
    basis = hs.PolynomialChaos(2, stats.uniform(-1, 2)).build(DOMAIN)
    X, omega = points(3)
    np.testing.assert_array_equal(basis.known(X, omega), 0.0)
    np.testing.assert_allclose(basis.coefficient_mean, 0.0, atol=1e-12)
    np.testing.assert_allclose(basis.coefficient_sd, 1 / np.sqrt(3))


def test_bad_arguments():
    with pytest.raises(ValueError, match="degree == 0, must be >= 1"):
        hs.PolynomialChaos(degree=0).build(DOMAIN)
    with pytest.raises(TypeError, match="degree must be an instance of"):
        hs.PolynomialChaos(degree=2.5).build(DOMAIN)
    with pytest.raises(TypeError, match="prior of 'coefficient_prior' must be a frozen"):
        hs.PolynomialChaos(coefficient_prior=5.0).build(DOMAIN)


def curve(X, omega):
    return np.sin(X[:, 0]) + omega[:, 0] * X[:, 1]


@pytest.mark.parametrize(
    "surrogate", [hs.PolynomialChaos(degree=4), hs.GaussianProcess(degree=3), hs.ExactSurrogate()]
)
def test_outer_is_features_of_all_pairs(surrogate):
    names = {"input_names": ("t", "x"), "parameter_names": ("a",)}
    domain = Domain(DOMAIN.input_ranges, DOMAIN.parameter_ranges, 3.0, 2.0, curve, **names)
    basis = surrogate.build(domain)
    X, _ = points(5)
    _, omega = points(7, seed=1)
    known, features = basis.outer(X, omega)
    p = len(basis.coefficient_mean)
    assert known.shape == (7, 5)
    assert features.shape == (7, 5, p)
    for j in range(7):
        repeated = np.repeat(omega[j : j + 1], 5, axis=0)
        np.testing.assert_allclose(known[j], basis.known(X, repeated))
        np.testing.assert_allclose(features[j], basis.features(X, repeated))
    c = np.random.default_rng(2).standard_normal(p)
    np.testing.assert_allclose(basis.outer_output(X, omega, c), known + features @ c)
    each = np.random.default_rng(3).standard_normal((7, p))
    expected = known + (features @ each[..., None])[..., 0]
    np.testing.assert_allclose(basis.outer_output(X, omega, each), expected)
    X, omega = points(6, seed=3)
    expected = basis.known(X, omega) + basis.features(X, omega) @ c
    np.testing.assert_allclose(basis.output(X, omega, c), expected)


def test_exact_surrogate_is_the_simulation_without_coefficients():
    domain = Domain(DOMAIN.input_ranges, DOMAIN.parameter_ranges, 3.0, 2.0, curve)
    basis = hs.ExactSurrogate().build(domain)
    X, omega = points(4)
    np.testing.assert_array_equal(basis.known(X, omega), curve(X, omega))
    assert basis.features(X, omega).shape == (4, 0)
    assert basis.coefficient_mean.shape == (0,)


def test_exact_surrogate_needs_a_simulation_that_can_be_called():
    with pytest.raises(ValueError, match=r"there is no callable one: pass a Simulator"):
        hs.ExactSurrogate().build(DOMAIN)


def test_a_surrogate_of_the_users_own(simulation, measured):
    """The class in the documentation works as it stands."""
    names = {}
    for example in doctest.DocTestFinder(recurse=False).find(Surrogate, globs={}):
        for step in example.examples:
            exec(step.source, names)
    model = hs.PowerScaledSurrogate(simulation, surrogate=names["Line"](), random_state=0)
    X, y = measured
    model.fit(X, y)
    assert issubclass(names["LineBasis"], Basis)
    assert model.posterior_.coefficients.shape == (1000, 3)
    # the fall is no line, but the line falls
    assert model.predict([[0.5]]) > model.predict([[3.5]]) + 30


def test_far_more_terms_than_rows_of_runs():
    """A fit of 5151 terms took minutes, of which the runs determine 80 at most."""
    rng = np.random.default_rng(0)
    t, g = rng.uniform(size=(2, 80))
    runs = hs.SimulationData(t, g, t * g, ["t"], {"g": stats.uniform(0, 1)})
    model = hs.PowerScaledSurrogate(runs, surrogate=hs.PolynomialChaos(degree=100))
    with pytest.raises(ValueError, match="5151 coefficients, more than 10 for each of the 80 rows"):
        model.fit(t[:10, None], t[:10])


@pytest.mark.parametrize("degree", [10**9, 10_000, 40])
def test_more_terms_than_memory(degree):
    simulator = hs.Simulator(
        lambda a, b, c, d: a * b + c * d, dict.fromkeys("abcd", (0, 1)), {}, vectorized=True
    )
    runs = simulator.run(32, random_state=0)
    model = hs.PowerScaledSurrogate(runs, surrogate=hs.PolynomialChaos(degree))
    with pytest.raises(ValueError, match=rf"PolynomialChaos\(degree={degree}\) has .* terms in 4"):
        model.fit(runs.X, runs.y)
