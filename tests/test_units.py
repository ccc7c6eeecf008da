"""Units do not matter: what is measured in other ones is told alike."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

import hybridsurrogate as hs
from hybridsurrogate.estimators.fitting import make_target
from hybridsurrogate.estimators.problem import make_problem
from hybridsurrogate.inference.starts import starting_points

PRIORS = {"vmax": stats.uniform(2, 6), "km": stats.uniform(0.1, 0.6)}


def uptake(s, vmax, km):
    return vmax * s / (km + s)


@pytest.fixture(scope="module")
def batches():
    """Runs, and measurements of which one batch is off."""
    runs = hs.Simulator(uptake, {"s": (0, 2)}, PRIORS).run(100, random_state=1)
    rng = np.random.default_rng(21)
    X = pd.DataFrame({"s": rng.uniform(0.02, 2, 40), "batch": rng.integers(0, 3, 40)})
    y = uptake(X.s, 5, 0.3) + 0.6 * (X.batch == 2) + 0.15 * rng.standard_normal(40)
    return runs, X, y


def in_units(runs, unit):
    return hs.SimulationData(
        runs.X, runs.omega, runs.y * unit, inputs={"s": (0, 2)}, parameters=PRIORS
    )


CAUSE = hs.MissingInput("batch", shape="categorical", level=2)


@pytest.mark.parametrize("surrogate", [hs.Kriging(), hs.PolynomialChaos()], ids=repr)
def test_a_fit_with_a_cause_in_other_units_of_the_output(batches, surrogate):
    runs, X, y = batches
    told = []
    for unit in (1.0, 1e-9, 1e9):
        model = hs.PowerScaledSurrogate(
            in_units(runs, unit), surrogate, effects=(CAUSE,), n_draws=300, random_state=0
        ).fit(X, y * unit)
        told.append(np.column_stack([model.posterior_.values, model.posterior_.sigma / unit]))
    # the lengths of kriging end differently by rounding: medians of 300 draws know 0.07 sd
    middle, sd = np.median(told, axis=1), np.std(told[0], axis=0)
    assert np.abs((middle[1:] - middle[0]) / sd).max() < 0.35


def test_climbs_start_from_the_same_place_in_other_units(batches):
    """From a noise far off they may end at a false peak."""
    runs, X, y = batches
    starts = []
    for unit in (1.0, 1e-9, 1e9):
        problem = make_problem(
            in_units(runs, unit),
            hs.PolynomialChaos(),
            hs.Normal(),
            None,
            (CAUSE,),
            ("s", "batch"),
            X.to_numpy(dtype=float),
            y.to_numpy() * unit,
        )
        found = starting_points(make_target(problem, 1.0, 1.0), np.random.RandomState(0))
        starts.append(found - np.log(unit) * np.eye(found.shape[1])[-1])
    np.testing.assert_allclose(starts[1:], [starts[0], starts[0]], atol=1e-3)


@pytest.mark.parametrize("method", ["RK45", "LSODA"])
@pytest.mark.parametrize("unit", [1e-12, 1.0, 1e12])
def test_an_ode_in_other_units_of_its_state(method, unit):
    simulator = hs.OdeSimulator(
        lambda t, state, rate: np.stack([-rate * state[0]]),
        initial_state=[3 * unit],
        observe=lambda state: state[0],
        inputs={"t": (0, 10)},
        parameters={"rate": stats.uniform(0.1, 0.9)},
        states="amount",
        method=method,
    )
    t = np.linspace(0, 10, 7)
    told = simulator(t[:, None], np.full((7, 1), 0.5))
    np.testing.assert_allclose(told, 3 * unit * np.exp(-0.5 * t), rtol=1e-5)
