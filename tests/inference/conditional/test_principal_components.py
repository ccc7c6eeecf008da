"""Directions of the coefficients that measured rows do not notice are left out."""

import numpy as np
import pytest
from problems import make_problem
from scipy import stats
from sklearn.kernel_approximation import Nystroem

import hybridsurrogate as hs
from hybridsurrogate.inference.conditional.pairwise_squares import MeasuredGiven, main_directions

SIGMA = 0.05


def given(surrogate, effects=(), n_draws=150):
    """Return rows of a simulation of two parameters, and coefficients as its runs tell them."""
    simulator = hs.Simulator(
        lambda t, rate, size: size * np.exp(-rate * t),
        {"t": (0, 4)},
        {"rate": stats.uniform(0.2, 1), "size": stats.uniform(1, 2)},
    )
    runs = simulator.run(120, random_state=0)
    t = np.linspace(0, 4, 25)[:, None]
    y = 2 * np.exp(-0.5 * t[:, 0])
    likelihood = hs.Normal()
    problem = make_problem(runs, surrogate, likelihood, None, effects, ("t",), t, y)
    basis = problem.model.basis
    features = basis.features(runs.X, runs.omega)
    precision = features.T @ features / 0.01**2 + np.diag(basis.coefficient_sd**-2.0)
    mean = np.linalg.solve(precision, features.T @ (runs.y - basis.known(runs.X, runs.omega)))
    mean /= 0.01**2
    c = np.random.default_rng(1).multivariate_normal(mean, np.linalg.inv(precision), n_draws)
    return MeasuredGiven(problem.model, t, y, np.ones(25), c, problem.noise_prior, problem.scale)


def outputs(problem, z):
    parts = problem.model.parts(problem.X, problem.model.values(z))
    return parts.known[..., None] + parts.features @ problem.c.T


@pytest.mark.parametrize("effects", [(), (hs.Gain(),), (hs.Delay("t"),)])
@pytest.mark.parametrize("n_draws", [20, 150])
def test_outputs_stay_what_they_are(effects, n_draws):
    problem = given(hs.Kriging(), effects, n_draws)
    rng = np.random.default_rng(2)
    # fewer nodes are asked than there are
    z = 0.2 * rng.standard_normal((400, problem.model.n_unknowns))
    few = main_directions(problem, z, SIGMA)
    p, r = problem.c.shape[1], few.c.shape[1]
    assert r < 0.6 * p
    change = outputs(few, z) - outputs(problem, z)
    assert np.sqrt(np.mean(change**2)) < 0.01 * SIGMA
    # with no noise to hide it everything stays
    exact = main_directions(problem, z, 1e-9)
    np.testing.assert_allclose(outputs(exact, z), outputs(problem, z), atol=1e-5)


def test_features_of_any_surrogate():
    problem = given(hs.FeatureSurrogate(Nystroem(gamma=0.5, n_components=60, random_state=0)))
    z = 0.1 * np.random.default_rng(2).standard_normal((50, 2))
    few = main_directions(problem, z, SIGMA)
    assert few.c.shape[1] < 40
    change = outputs(few, z) - outputs(problem, z)
    assert np.sqrt(np.mean(change**2)) < 0.01 * SIGMA


def test_what_gains_nothing_is_left_as_it_is():
    z = np.zeros((3, 2))
    # their features factorise
    problem = given(hs.PolynomialChaos(7))
    assert main_directions(problem, z, SIGMA) is problem
    # noise, or what is made of the output, follows that of one particular draw
    for effect in (hs.NoiseOfMean(), hs.SensorResponse()):
        problem = given(hs.Kriging(), (effect,))
        z = np.zeros((3, problem.model.n_unknowns))
        assert main_directions(problem, z, SIGMA) is problem
