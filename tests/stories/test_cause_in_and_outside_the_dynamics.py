"""A cause inside the dynamics and one outside: found one after the other."""

import numpy as np
import pytest
from scipy import stats

import hybridsurrogate as hs
from hybridsurrogate.effects.registry import kinds

# for time: the search for a second cause is what is tested
OTHERS = tuple(kind for kind in kinds() if kind not in ("missing-term", "step"))


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


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_a_missing_source_and_a_sensor_that_was_moved(seed):
    rng = np.random.default_rng(seed)
    t = np.linspace(0.25, 20, 60)[:, None]
    y = emptying(1.0)(t, np.full((60, 1), 0.25)) + 0.8 * (t[:, 0] > 9) + rng.normal(0, 0.1, 60)
    model = hs.PowerScaledSurrogate(
        emptying(0.0), surrogate=hs.ExactSurrogate(), n_draws=400, random_state=0
    )
    diagnosis = hs.DiscrepancyDiagnosis(
        model, exclude=OTHERS, cv=None, max_causes=3, random_state=0
    ).fit(t, y)
    found = {cause.kind: cause for cause in diagnosis.found_causes_}
    assert set(found) == {"missing-term", "step"}
    source, moved = found["missing-term"].estimates, found["step"].estimates
    rate = diagnosis.extended_estimator_.posterior_.named()["rate"].mean()
    # least squares leaves 0.044, 0.059 and 0.0066, where the gap in which the step lies is known
    assert source["rate"][0] == pytest.approx(1.0, abs=0.15)
    assert moved["amplitude"][0] == pytest.approx(0.8, abs=0.2)
    assert rate == pytest.approx(0.25, abs=0.022)
    simulator = diagnosis.extended_simulator_
    assert list(simulator.parameters) == ["rate", "level_constant_rate", "location", "amplitude"]
    numbers = [rate, source["rate"][0], moved["location"][0], moved["amplitude"][0]]
    np.testing.assert_allclose(
        simulator(t, np.tile(numbers, (60, 1))), diagnosis.predict(t), atol=0.05
    )
    assert np.std(y - diagnosis.predict(t)) < 0.13  # of noise of 0.1
