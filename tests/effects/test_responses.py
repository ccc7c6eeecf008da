"""What is made of the simulated output: through runs, in one of several outputs, of counts."""

import numpy as np
import pytest
from scipy.stats import norm
from tide import FRAME, SIMULATOR, plain

import hybridsurrogate as hs

LIMIT = 14.5


@pytest.fixture(scope="module")
def limited():
    frame = FRAME[["t", "dose"]]
    y = np.minimum(plain(FRAME), LIMIT) + 0.1 * np.random.default_rng(5).normal(size=len(FRAME))
    return frame, y


def test_a_response_of_ones_own_is_its_function_and_slope():
    """The posterior with a gain written as a response is that with the gain itself."""

    class Factor(hs.Cause):
        kind = "factor"
        parameters = {"gain": norm(1, 0.3)}

        def response(self, simulated, X, theta):
            return theta["gain"] * simulated, np.broadcast_to(theta["gain"], simulated.shape)

    class Same(Factor):
        response = hs.Cause.response

        def gain(self, X, theta):
            return theta["gain"]

    frame, y = FRAME[["t", "dose"]], 1.1 * plain(FRAME)
    runs = SIMULATOR.run(100, random_state=0)
    for simulation, surrogate in ((SIMULATOR, hs.ExactSurrogate()), (runs, hs.Kriging())):
        means = []
        for cause in (Factor(), Same()):
            model = hs.PowerScaledSurrogate(
                simulation, surrogate=surrogate, effects=(cause,), n_draws=200, random_state=0
            ).fit(frame, y + 0.1 * np.random.default_rng(1).normal(size=len(y)))
            means.append(model.posterior_.estimates(0)["gain"].mean())
        assert means[0] == pytest.approx(means[1], abs=0.01)
        assert means[0] == pytest.approx(1.1, abs=0.05)


@pytest.mark.parametrize("surrogate", [hs.Kriging(), hs.PolynomialChaos(degree=6)])
def test_a_limit_is_found_through_runs_alone(limited, surrogate):
    runs = SIMULATOR.run(150, random_state=0)
    model = hs.PowerScaledSurrogate(
        runs, surrogate=surrogate, effects=(hs.Limit(),), n_draws=300, random_state=0
    ).fit(*limited)
    low, high = np.quantile(model.posterior_.estimates(0)["limit"], [0.005, 0.995])
    assert low < LIMIT < high
    # nothing that the emulator leaves open is seen beyond the limit
    assert model.predict(limited[0]).max() < high + 0.2


def test_a_limit_of_one_output_is_in_its_units_and_in_the_extended_simulation():
    random = np.random.default_rng(3)
    simulator = hs.Simulator(
        lambda t, a: (a * np.sin(t), 100 * a * np.cos(t)),
        {"t": (0, 10)},
        {"a": hs.truncated_normal(2, 0.3, 1, 3)},
        output=("u", "v"),
    )
    t = np.sort(random.uniform(0, 10, 60))
    Y = np.column_stack([2 * np.sin(t), np.minimum(200 * np.cos(t), 90)])
    Y += random.normal(size=Y.shape) * [0.1, 8.0]
    model = hs.PowerScaledSurrogate(simulator, surrogate=hs.ExactSurrogate(), random_state=0)
    diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, random_state=0).fit(t[:, None], Y)
    best = diagnosis.best_cause_
    assert (best.kind, best.target) == ("limit", "v")
    mean, low, high = best.estimates["limit"]
    assert low - 3 < 90 < high + 3
    # its own parameter is in the units in which the cause is weighed
    extended, rows = diagnosis.extended_simulator_, np.array([[0.0], [np.pi]])
    assert list(extended.parameters) == ["a", "limit"]
    scale = diagnosis.extended_estimator_.posterior_.model.effects[0].scale
    u, v = extended(rows, np.array([[2.0, mean / scale]] * 2)).T
    np.testing.assert_allclose(v, [mean, -200.0], rtol=1e-9)
    np.testing.assert_allclose(u, [0.0, 0.0], atol=1e-9)


def test_counts_that_are_cut_off():
    """A detector that counts no more than so much, under a likelihood of counts."""
    random = np.random.default_rng(8)
    simulator = hs.Simulator(
        lambda t, rate: 200 * np.exp(-rate * t) + 5,
        {"t": (0, 10)},
        {"rate": hs.truncated_normal(0.4, 0.1, 0.1, 0.9)},
    )
    t = np.sort(random.uniform(0, 10, 50))
    y = random.poisson(np.minimum(200 * np.exp(-0.4 * t) + 5, 90)).astype(float)
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), likelihood="poisson", random_state=0
    )
    diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, random_state=0).fit(t[:, None], y)
    assert diagnosis.best_cause_.kind == "limit"
    _, low, high = diagnosis.best_cause_.estimates["limit"]
    assert low < 90 < high
