"""Surrogates and likelihoods that are not built in, or not linear."""

import numpy as np
import pytest
from problems import make_problem
from scipy.stats import halfnorm, norm
from sklearn.base import BaseEstimator, TransformerMixin, clone
from sklearn.frozen import FrozenEstimator
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Matern
from sklearn.kernel_approximation import RBFSampler
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import (
    FunctionTransformer,
    PolynomialFeatures,
    SplineTransformer,
    StandardScaler,
)

import hybridsurrogate as hs
from hybridsurrogate.datasets import make_log_sin
from hybridsurrogate.inference.procedure import make_target
from hybridsurrogate.likelihoods import as_likelihood
from hybridsurrogate.surrogates import Basis, Domain, Surrogate

LAPLACE = hs.CustomLikelihood(
    lambda y, eta, sigma: -np.abs(y - eta) / sigma - np.log(2 * sigma),
    lambda eta, sigma: eta,
    lambda eta, sigma, random_state: random_state.laplace(eta, sigma),
)


class LineBasis(Basis):
    """The example of the documentation: a surrogate of the user's own."""

    def known(self, X, omega, hyper=None):
        return np.zeros(len(X))

    def features(self, X, omega):
        return np.column_stack([np.ones(len(X)), omega, omega * X**2])


class Line(Surrogate):
    def build(self, domain):
        return LineBasis(np.zeros(3), np.full(3, 10 * domain.scale))

    def of_measured_data(self):
        return hs.PolynomialChaos(2)


@pytest.mark.slow
def test_surrogate_of_the_users_own_with_a_likelihood_of_the_users_own(simulation, measured):
    X, y = measured
    model = hs.PowerScaledSurrogate(
        simulation, surrogate=Line(), likelihood=LAPLACE, n_draws=300, random_state=0
    ).fit(X, y)
    t = X[:, 0]
    np.testing.assert_allclose(model.predict(X), 100 - 9.3 / 2 * t**2, atol=0.8)
    assert model.posterior_.values[:, 0].mean() == pytest.approx(9.3, abs=0.25)


def fall(X, omega, constants):
    return constants["height"] - constants["power"] * omega[:, 0] * X[:, 0] ** 2


def test_parametric_surrogate_finds_its_constants(simulation, measured):
    surrogate = hs.ParametricSurrogate(fall, {"height": norm(80, 20), "power": norm(1, 0.5)})
    model = hs.PowerScaledSurrogate(simulation, surrogate=surrogate, random_state=0).fit(*measured)
    draws = model.posterior_.named()
    # the runs are the function itself, with height 100 and power 1/2; noise sd about one
    assert draws["height"].mean() == pytest.approx(100, abs=1.0)
    assert draws["power"].mean() == pytest.approx(0.5, abs=0.03)
    assert draws["gravity"].mean() == pytest.approx(9.3, abs=0.4)


@pytest.mark.slow
def test_a_formula_that_meets_runs_and_data_exactly_is_fitted():
    def cooling(X, omega, c):
        return c["height"] * omega[:, 0] * np.exp(-c["speed"] * omega[:, 1] * X[:, 0])

    simulator = hs.Simulator(
        lambda t, start, rate: start * np.exp(-rate * t),
        inputs={"t": (0, 5)},
        parameters={
            "start": hs.truncated_normal(2, 0.5, 0, 5),
            "rate": hs.truncated_normal(0.5, 0.2, 0, 2),
        },
    )
    surrogate = hs.ParametricSurrogate(cooling, {"height": norm(1, 1), "speed": norm(1, 1)})
    t = np.linspace(0, 5, 20)
    model = hs.PowerScaledSurrogate(
        simulator.run(32, random_state=0), surrogate, n_draws=200, random_state=0
    ).fit(t[:, None], 2.2 * np.exp(-0.4 * t))
    np.testing.assert_allclose(model.predict(t[:, None]), 2.2 * np.exp(-0.4 * t), rtol=1e-3)


class Fall(hs.ParametricSurrogate):
    def of_measured_data(self):
        return hs.PolynomialChaos(2)


def bent_fall(X, omega, constants):
    # not the simulation itself: runs that are met exactly leave no noise
    return fall(X, omega, constants) + 2 * np.sin(2 * X[:, 0])


FALL = {"height": norm(80, 20), "power": norm(1, 0.5)}


@pytest.mark.parametrize("surrogate", [Line(), Fall(bent_fall, FALL)], ids=["line", "fall"])
def test_predictive_weighting_of_a_surrogate_of_the_users_own(simulation, measured, surrogate):
    X, y = measured
    model = hs.PredictiveWeightedSurrogate(
        simulation, surrogate=surrogate, n_draws=200, random_state=0
    ).fit(X, y)
    np.testing.assert_allclose(model.predict(X), 100 - 9.3 / 2 * X[:, 0] ** 2, atol=2)


@pytest.mark.parametrize("with_runs", [True, False])
def test_a_surrogate_that_needs_parameters_says_so_of_measured_data(
    simulation, measured, with_runs
):
    surrogate = hs.ParametricSurrogate(fall, FALL)
    model = hs.PredictiveWeightedSurrogate(simulation if with_runs else None, surrogate)
    with pytest.raises(ValueError, match=r"ParametricSurrogate .* override of_measured_data"):
        model.fit(*measured)


def domain_of(X, y, scale=1.0):
    n = len(X)
    return Domain(
        np.array([[-1.0, 1.0]] * X.shape[1]),
        np.empty((0, 2)),
        0.0,
        scale,
        X=X,
        omega=np.empty((n, 0)),
        eta=y,
        input_names=tuple(f"x{k}" for k in range(X.shape[1])),
    )


@pytest.mark.parametrize(
    ("kernel", "exact"),
    [
        ("squared-exponential", RBF(0.7)),
        ("matern-5/2", Matern(0.7, nu=2.5)),
        ("matern-3/2", Matern(0.7, nu=1.5)),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_gaussian_process_is_the_exact_one_at_fixed_hyperparameters(kernel, exact):
    rng = np.random.default_rng(0)
    X = rng.uniform(-1, 1, (25, 1))
    noise, length, amplitude = 0.2, 0.7, 1.3
    y = np.sin(3 * X[:, 0]) + noise * rng.standard_normal(25)
    regressor = GaussianProcessRegressor(
        ConstantKernel(amplitude**2) * exact, alpha=noise**2, optimizer=None
    ).fit(X, y)
    new = np.linspace(-1, 1, 50)[:, None]
    mean, sd = regressor.predict(new, return_std=True)

    basis = hs.GaussianProcess(kernel).build(domain_of(X, y))
    factor = basis.factor(np.array([[length, amplitude]]))[0]
    nothing = np.empty((25, 0))
    features = basis.features(X, nothing) @ factor
    precision = features.T @ features / noise**2 + np.eye(features.shape[1])
    there = basis.features(new, np.empty((50, 0))) @ factor
    ours = there @ np.linalg.solve(precision, features.T @ y) / noise**2
    ours_sd = np.sqrt(np.sum(there * np.linalg.solve(precision, there.T).T, axis=1))
    assert np.max(np.abs(ours - mean) / sd) < 1e-2
    assert np.max(np.abs(ours_sd - sd) / sd) < 1e-2


def test_gaussian_process_in_two_dimensions_is_the_exact_one():
    rng = np.random.default_rng(1)
    X = rng.uniform(-1, 1, (60, 2))
    y = np.sin(2 * X[:, 0]) * X[:, 1] + 0.1 * rng.standard_normal(60)
    lengths, amplitude, noise = np.array([0.8, 1.4]), 1.0, 0.1
    regressor = GaussianProcessRegressor(RBF(lengths), alpha=noise**2, optimizer=None).fit(X, y)
    new = rng.uniform(-1, 1, (80, 2))
    mean, sd = regressor.predict(new, return_std=True)
    basis = hs.GaussianProcess().build(domain_of(X, y))
    # whole and truncated factors describe the same process
    hyper = np.array([[*lengths, amplitude]])
    for factor in (basis.factor(hyper)[0], basis.factor(hyper, truncated=True)[0]):
        features = basis.features(X, np.empty((60, 0))) @ factor
        precision = features.T @ features / noise**2 + np.eye(features.shape[1])
        there = basis.features(new, np.empty((80, 0))) @ factor
        ours = there @ np.linalg.solve(precision, features.T @ y) / noise**2
        assert np.max(np.abs(ours - mean) / sd) < 1e-2


def test_gaussian_process_outer_is_features_of_all_pairs(simulation):
    domain = Domain(
        np.array([[0.0, 4.0]]), np.array([[5.0, 15.0]]), 3.0, 2.0,
        input_names=("t",), parameter_names=("g",),
    )  # fmt: skip
    basis = hs.GaussianProcess(degree=4).build(domain)
    X, omega = np.linspace(0, 4, 5)[:, None], np.array([[6.0], [9.0], [20.0]])
    known, features = basis.outer(X, omega)
    for j in range(3):
        repeated = np.repeat(omega[j : j + 1], 5, axis=0)
        np.testing.assert_allclose(known[j], basis.known(X, repeated))
        np.testing.assert_allclose(features[j], basis.features(X, repeated))


SURROGATES = {
    "gaussian-process": hs.GaussianProcess(degree=5),
    "spline": hs.FeatureSurrogate(SplineTransformer(n_knots=4)),
    "polynomial": hs.FeatureSurrogate(PolynomialFeatures(3)),
    "network": hs.NetworkSurrogate(hidden_layer_sizes=(16,)),
}


@pytest.mark.parametrize(
    "transformer",
    [RBFSampler(n_components=30), make_pipeline(StandardScaler(), RBFSampler(n_components=30))],
    ids=["alone", "in a pipeline"],
)
def test_random_features_are_the_same_in_every_fit(simulation, measured, transformer):
    surrogate = hs.FeatureSurrogate(transformer)
    model = hs.PowerScaledSurrogate(simulation, surrogate, n_draws=100, random_state=0)
    first, second = (clone(model).fit(*measured).predict(measured[0]) for _ in range(2))
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("name", SURROGATES)
def test_every_surrogate_learns_the_fall(name, simulation, measured):
    X, y = measured
    model = hs.PowerScaledSurrogate(
        simulation, surrogate=SURROGATES[name], noise_prior=halfnorm(scale=5), random_state=0
    ).fit(X, y)
    truth = 100 - 9.3 / 2 * X[:, 0] ** 2
    # noise of one standard deviation in 32 rows; splines cannot cross inputs and parameters
    assert np.sqrt(np.mean((model.predict(X) - truth) ** 2)) < (2.5 if name == "spline" else 0.9)


class Widening(TransformerMixin, BaseEstimator):
    """A transformer that changes its width with the number of rows."""

    def fit(self, X, y=None):
        return self

    def transform(self, X):
        return np.ones((len(X), len(X)))


def fails(X, omega, constants):
    return np.full(len(X), np.nan)


def scalar(X, omega, constants):
    return 1.0


class WrongShape(Line):
    def build(self, domain):
        return WrongBasis(np.zeros(3), np.ones(3))


class WrongBasis(LineBasis):
    def features(self, X, omega):
        return np.ones((len(X), 2))


@pytest.mark.parametrize(
    ("surrogate", "match"),
    [
        (hs.FeatureSurrogate(Widening()), r"Widening\(\) changed its width: 32 features when"),
        (
            hs.FeatureSurrogate(FrozenEstimator(SplineTransformer())),
            r"SplineTransformer.* is not fitted .*fitted beforehand",
        ),
        (hs.FeatureSurrogate(FunctionTransformer(np.log)), "NaN or infinity"),
        (hs.ParametricSurrogate(fails, {"a": norm()}), "'fails' is NaN or infinite at every"),
        (hs.ParametricSurrogate(scalar, {"a": norm()}), r"'scalar' must return shape \(32,\)"),
        (hs.ParametricSurrogate(fails, {}), "needs a prior for at least one constant"),
        (hs.GaussianProcess("periodic"), "kernel must be one of"),
        (hs.NetworkSurrogate(activation="sine"), "activation must be one of"),
        (WrongShape(), r"WrongBasis.features must return shape \(32, 3\).* got \(32, 2\)"),
    ],
    # objects without names of their own would put addresses into the tests' names
    ids=lambda value: value if isinstance(value, str) else type(value).__name__,
)
@pytest.mark.filterwarnings("ignore:(invalid|divide)")
def test_bad_surrogates(surrogate, match, simulation, measured):
    with pytest.raises(ValueError, match=match):
        hs.PowerScaledSurrogate(simulation, surrogate=surrogate, random_state=0).fit(*measured)


def test_no_transformer(simulation, measured):
    for wrong in (None, "spline"):
        with pytest.raises(TypeError, match="needs a scikit-learn transformer"):
            hs.PowerScaledSurrogate(simulation, surrogate=hs.FeatureSurrogate(wrong)).fit(*measured)
    with pytest.raises(TypeError, match=r"needs a function\(X, omega, constants\)"):
        hs.PowerScaledSurrogate(simulation, surrogate=hs.ParametricSurrogate()).fit(*measured)


@pytest.mark.parametrize("likelihood", ["normal", "student-t"])
def test_density_of_a_process_does_not_depend_on_the_batch(likelihood):
    # noise-free runs of a smooth function: sigma is small, so what is left out must be smaller
    case = make_log_sin(random_state=8)
    problem = make_problem(
        case.simulation,
        hs.GaussianProcess(degree=8),
        as_likelihood(likelihood),
        halfnorm(scale=0.5),
        (),
        ("x",),
        case.X,
        case.y,
    )
    target = make_target(problem, 1.0, 0.0)
    mode = np.array([0.0, -5.5, 0.8, 3.5, -4.4])
    points = mode + 0.3 * np.random.default_rng(0).standard_normal((40, 5))
    together = target.search_density(points)
    alone = np.concatenate([target.search_density(point[None]) for point in points])
    np.testing.assert_allclose(together, alone, atol=0.02)
