"""The next runs: where they settle most, and what they are called."""

import numpy as np
import pandas as pd
import pytest
from few_kinds import all_but
from scipy.stats import uniform

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.answers.experimental_design import _settling

# few runs, on purpose
pytestmark = pytest.mark.filterwarnings(
    "ignore:At the measured rows the runs leave:hybridsurrogate.DiagnosisWarning"
)

T = np.linspace(0, 10, 25)
RATE = uniform(0.1, 1.9)
WAVE = uniform(0.5, 2.5)


def ringing(t, rate, wave):
    return np.exp(-rate * t) * np.cos(wave * t)


SIMULATOR = hs.Simulator(ringing, {"t": (0, 10)}, {"rate": RATE, "wave": WAVE})


def diagnosed(simulation, surrogate=None):
    noise = 0.02 * np.random.default_rng(1).normal(size=len(T))
    model = hs.PowerScaledSurrogate(
        simulation, surrogate=surrogate or hs.Kriging(), n_draws=200, random_state=0
    )
    # whatever the kinds are
    settings = {"exclude": all_but("step", "trend"), "cv": None, "n_replicates": 19}
    diagnosis = hs.DiscrepancyDiagnosis(model, **settings, random_state=0)
    return diagnosis.fit(T[:, None], ringing(T, 0.3, 1.5) + noise)


@pytest.fixture(scope="module")
def curves():
    return diagnosed(SIMULATOR.run(20, along=25, random_state=0))


def test_the_first_run_takes_most_and_the_next_what_is_left():
    # by hand: two places that say the same, and one on its own that varies less
    covariance = np.array([[4.0, 4.0, 0.0], [4.0, 4.0, 0.0], [0.0, 0.0, 1.0]])
    first, second = _settling(covariance, 2)
    assert first in (0, 1)
    assert second == 2
    assert len(_settling(covariance, 9)) == 3


@pytest.mark.slow
def test_runs_that_are_curves_are_asked_for_by_their_parameters(curves):
    asked = curves.next_runs(4)
    assert list(asked.columns) == ["rate", "wave"]
    assert len(asked.drop_duplicates()) == 4
    # around what the data say of the parameters, not all over their ranges
    assert (asked - [0.3, 1.5]).abs().median().max() < 0.3


@pytest.mark.slow
def test_those_runs_settle_more_than_as_many_of_a_design(curves):
    simulation = curves.estimator_.simulation
    design = pd.DataFrame(
        SIMULATOR.run(6, along=25, random_state=5).omega[::25], columns=["rate", "wave"]
    )
    left = [
        diagnosed(simulation.with_rows(SIMULATOR.run_at(runs, along=25))).emulator_check_.left_open
        for runs in (curves.next_runs(6), design)
    ]
    assert left[0] < 0.5 * left[1]


@pytest.mark.slow
def test_single_outputs_are_asked_for_with_their_inputs():
    simulation = SIMULATOR.run(60, random_state=0)
    found = diagnosed(simulation)
    assert found.emulator_check_.left_open > 1
    asked = found.next_runs(5)
    assert list(asked.columns) == ["t", "rate", "wave"]
    assert asked["t"].isin(T).all()
    more = simulation.with_rows(SIMULATOR.run_at(asked))
    assert more.n_rows == simulation.n_rows + 5
    np.testing.assert_array_equal(more.X[-5:, 0], asked["t"])


def test_a_simulation_that_is_run_itself_needs_none():
    with pytest.raises(ValueError, match=r"run itself, or its emulator has no uncertainty"):
        diagnosed(SIMULATOR, hs.ExactSurrogate()).next_runs(3)


@pytest.mark.slow
@pytest.mark.parametrize("n", [0, 2.5])
def test_a_number_that_is_none_is_refused(curves, n):
    with pytest.raises((ValueError, TypeError), match=r"n "):
        curves.next_runs(n)


def test_rows_of_another_simulation_are_refused(curves):
    simulation = curves.estimator_.simulation
    again = simulation.to_frame().assign(y=lambda frame: frame["y"] + 1)
    with pytest.raises(ValueError, match=r"different results of 'y' for the same run"):
        simulation.with_rows(again)
    with pytest.raises(ValueError, match=r"no column wave"):
        simulation.with_rows(again.drop(columns="wave"))
    with pytest.raises(ValueError, match=r"a column 'run' must hold"):
        simulation.with_rows(again.drop(columns="run"))
    with pytest.raises(TypeError, match=r"takes a DataFrame"):
        simulation.with_rows(again.to_numpy())
