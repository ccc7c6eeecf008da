"""The discrepancy process against its kernel, and its size in other units."""

import numpy as np
import pytest
from scipy import stats

import hybridsurrogate as hs
from hybridsurrogate.datasets import make_log_sin

KENNEDY_OHAGAN = stats.invgamma(5, scale=5)
HALF_NORMAL = stats.halfnorm()


def process_of(n_inputs, prior=KENNEDY_OHAGAN, amplitude=HALF_NORMAL):
    return hs.GaussianProcessDiscrepancy(
        {f"x{k}": (-1.0, 1.0) for k in range(n_inputs)}, prior, amplitude
    )


def covariance(process, X, length):
    """Return the prior covariance between rows X (n, n_inputs), at amplitude 2."""
    theta = {"length_scale": np.array([length]), "amplitude": np.array([2.0])}
    of_rows, of_draws = process.factors({f"x{k}": x for k, x in enumerate(X.T)}, theta)
    assert of_rows.shape[1] == len(process.coefficients)
    columns = of_rows * of_draws
    return columns @ columns.T


def squared_exponential(x, length):
    return np.exp(-0.5 * ((x[:, None] - x) / length) ** 2)


def test_short_lengths_have_the_kernel():
    x = np.linspace(-1, 1, 41)
    found = covariance(process_of(1), x[:, None], 0.2)
    np.testing.assert_allclose(np.sqrt(np.diag(found)), 2.0, rtol=0.05)
    np.testing.assert_allclose(found, 4 * squared_exponential(x, 0.2), atol=0.1)


@pytest.mark.parametrize("n_inputs", [3, 5])
def test_a_sum_over_inputs_has_the_amplitude_of_one(n_inputs):
    X = np.linspace(-1, 1, 9)[:, None] * (-1.0) ** np.arange(n_inputs)
    found = covariance(process_of(n_inputs), X, 0.4)
    np.testing.assert_allclose(np.sqrt(np.diag(found)), 2.0, rtol=0.05)


@pytest.mark.parametrize(("n_inputs", "n_columns"), [(1, 24), (2, 49), (3, 30)])
def test_the_catch_all_of_a_diagnosis_has_the_basis_of_its_scorecard(n_inputs, n_columns):
    process = process_of(n_inputs, stats.loguniform(0.3, 2.0), None)
    assert len(process.coefficients) == n_columns
    theta = {"length_scale": np.array([0.5])}
    columns = process.columns({f"x{k}": np.zeros(1) for k in range(n_inputs)}, theta)
    np.testing.assert_allclose(np.sum(columns**2), n_inputs if n_inputs > 2 else 1, rtol=0.05)


@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_kennedy_ohagan_in_another_unit_of_the_output(unit):
    case = make_log_sin(random_state=0)
    runs = case.simulation
    scores = []
    for factor in (1.0, unit):
        simulation = hs.SimulationData(
            runs.X, runs.omega, runs.y * factor, runs.input_ranges, runs.parameters
        )
        model = hs.KennedyOHaganSurrogate(simulation, hs.PolynomialChaos(3), random_state=0)
        model.fit(case.X, case.y * factor)
        scores.append(model.score(case.X_in, case.y_in * factor) + np.log(factor))
    assert scores[1] == pytest.approx(scores[0], abs=0.01)
