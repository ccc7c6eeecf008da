"""A cause inside the dynamics and one outside: found one after the other."""

import numpy as np
import pytest
from scipy import stats

import hybridsurrogate as hs

KINDS = ("offset", "trend", "periodic", "bump", "decay", "saturation", "gain", "ramp")
OTHERS = ("parameter-drift", "noise", "wrong-constant", "delay", "interaction", "missing-input")


def emptying(source):
    def rhs(t, state, rate):
        return source - rate * state

    return hs.OdeSimulator(
        rhs,
        initial_state={"level": 10.0},
        observe=lambda state: state[0],
        inputs={"t": (0, 20)},
        parameters={"rate": stats.uniform(0.1, 0.4)},
        states=("level",),
        max_step=0.25,
    )


@pytest.mark.parametrize("seed", range(2))
def test_a_missing_source_and_a_sensor_that_was_moved(seed):
    rng = np.random.default_rng(seed)
    t = np.linspace(0.25, 20, 60)[:, None]
    y = emptying(1.0)(t, np.full((60, 1), 0.25)) + 0.8 * (t[:, 0] > 9) + rng.normal(0, 0.1, 60)
    model = hs.PowerScaledSurrogate(
        emptying(0.0), surrogate=hs.ExactSurrogate(), n_draws=400, random_state=0
    )
    diagnosis = hs.DiscrepancyDiagnosis(
        model, exclude=KINDS + OTHERS, cv=None, max_causes=3, random_state=0
    ).fit(t, y)
    found = {cause.kind: cause for cause in diagnosis.found_causes_}
    assert set(found) == {"missing-term", "step"}
    # its standard deviation is 0.04: 0.1 sqrt(1 / 27 + 1 / 33), and a little for the others
    assert found["step"].estimates["amplitude"][0] == pytest.approx(0.8, abs=0.15)
    simulator = diagnosis.extended_simulator_
    values = diagnosis.extended_estimator_.posterior_.named()
    assert set(simulator.parameters) >= {"rate", "level_constant_rate"}
    assert values["rate"].mean() == pytest.approx(0.25, abs=0.02)
    assert np.std(y - diagnosis.predict(t)) < 0.13  # of noise of 0.1
