"""What every registered surrogate must hold."""

import pickle
import re

import numpy as np
import pytest
from sklearn.base import clone

import hybridsurrogate as hs
from hybridsurrogate import surrogates
from hybridsurrogate.surrogates import SURROGATES, Domain
from hybridsurrogate.surrogates.basis import register

RNG = np.random.default_rng(4)
INPUTS, PARAMETERS = np.array([[0.0, 4.0], [-1.0, 1.0]]), np.array([[10.0, 20.0]])
X = RNG.uniform(*INPUTS.T, (60, 2))
OMEGA = RNG.uniform(*PARAMETERS.T, (60, 1))

each = pytest.mark.parametrize("surrogate", SURROGATES.values(), ids=[*SURROGATES])


def curve(X, omega):
    return np.sin(X[:, 0]) + 0.1 * omega[:, 0] * X[:, 1]


def domain(shift=0.0):
    eta = curve(X, OMEGA) + shift
    return Domain(
        INPUTS,
        PARAMETERS,
        float(eta.mean()),
        float(eta.std()),
        simulate=lambda X, omega: curve(X, omega) + shift,
        X=X,
        omega=OMEGA,
        eta=eta,
        input_names=("t", "x"),
        parameter_names=("a",),
    )


def built(surrogate):
    """Return the basis, unknowns of the surrogate itself at the medians of their priors."""
    basis = surrogate.build(domain())
    return basis.given(np.array([float(p.ppf(0.5)) for p in basis.hyperpriors.values()]))


def words(surrogate):
    """Return how a surrogate is made, without the addresses of its functions and priors."""
    return re.sub("0x[0-9a-f]+", "", repr(surrogate))


@pytest.mark.parametrize("name", SURROGATES)
def test_its_class_is_public(name):
    own = type(SURROGATES[name]).__name__
    assert getattr(hs, own) is getattr(surrogates, own) is type(SURROGATES[name])
    assert own in hs.__all__
    assert own in surrogates.__all__


@each
def test_constructor_parameters_alone_are_its_state(surrogate):
    before = words(surrogate)
    surrogate.build(domain())
    assert words(surrogate) == before
    assert words(clone(surrogate)) == before
    assert words(pickle.loads(pickle.dumps(surrogate))) == before


@each
def test_the_shapes_of_its_basis(surrogate):
    basis = surrogate.build(domain())
    p = len(basis.coefficient_mean)
    assert basis.coefficient_sd.shape == (p,)
    fixed = built(surrogate)
    assert fixed.known(X, OMEGA).shape == (60,)
    features = fixed.features(X, OMEGA)
    assert features.shape == (60, len(fixed.coefficient_mean))
    assert np.isfinite(features).all()
    assert fixed.error(X, OMEGA).shape[0] == 60


@each
def test_rows_do_not_see_each_other(surrogate):
    """And building twice gives the same basis."""
    basis, again = built(surrogate), built(clone(surrogate))
    some = np.arange(60)[::7]
    for one in (basis.known, basis.features):
        np.testing.assert_allclose(one(X, OMEGA)[some], one(X[some], OMEGA[some]), atol=1e-9)
    np.testing.assert_allclose(basis.features(X, OMEGA), again.features(X, OMEGA), atol=1e-9)


@each
def test_all_pairs_of_rows_and_parameters(surrogate):
    basis = built(surrogate)
    known, features = basis.outer(X[:5], OMEGA[:3])
    for j in range(3):
        repeated = np.repeat(OMEGA[j : j + 1], 5, axis=0)
        np.testing.assert_allclose(known[j], basis.known(X[:5], repeated), atol=1e-9)
        np.testing.assert_allclose(features[j], basis.features(X[:5], repeated), atol=1e-9)


@each
def test_a_surrogate_of_measured_data_alone_can_be_built(surrogate):
    alone = surrogate.of_measured_data()
    eta = curve(X, OMEGA)
    where = Domain(INPUTS, np.empty((0, 2)), float(eta.mean()), float(eta.std()), X=X, eta=eta,
                   omega=np.empty((60, 0)), input_names=("t", "x"))  # fmt: skip
    basis = alone.build(where)
    assert basis.features(X, np.empty((60, 0))).shape == (60, len(basis.coefficient_mean))


def test_what_cannot_be_registered():
    before = dict(SURROGATES)
    with pytest.raises(TypeError, match=r"register\('line', \.\.\.\) needs a Surrogate object"):
        register("line", curve)
    with pytest.raises(ValueError, match=r"'exact' is that of ExactSurrogate"):
        register("exact", hs.PolynomialChaos())
    assert before == SURROGATES
