"""Refinement: runs where they tell most, until they leave little open or a budget ends."""

import numpy as np
import pytest
from scipy.stats import uniform

import hybridsurrogate as hs

# few runs, on purpose
pytestmark = pytest.mark.filterwarnings(
    "ignore:At the measured rows the runs leave:hybridsurrogate.DiagnosisWarning"
)

T = np.linspace(0.3, 18, 60)
PRIORS = {"a": uniform(1, 2), "k": uniform(0.05, 0.25), "w": uniform(0.5, 1.0)}


def oscillation(t, a, k, w):
    return a * np.exp(-k * t) * np.cos(w * t) + 0.3 * a


SIMULATOR = hs.Simulator(oscillation, {"t": (0, 20)}, PRIORS)


def measured(step, seed=0):
    noise = 0.05 * np.random.default_rng(seed).normal(size=len(T))
    return oscillation(T, 2.0, 0.12, 1.0) + step * (T > 6) + noise


def diagnosis(simulation, cv=None):
    model = hs.PowerScaledSurrogate(simulation, surrogate=hs.Kriging(), n_draws=300, random_state=0)
    return hs.DiscrepancyDiagnosis(model, cv=cv, n_replicates=19, random_state=0)


@pytest.mark.slow
def test_a_step_is_named_with_a_few_runs_more():
    simulation = SIMULATOR.run(30, along=100, random_state=0)
    asked = diagnosis(simulation)
    found = hs.refine(asked, T[:, None], measured(0.2), budget=40, batch=10)
    rounds = found.refinement_
    assert rounds["n_runs"].tolist() == list(range(30, 31 + 10 * (len(rounds) - 1), 10))
    assert rounds["left_open"].iloc[0] > 0.5 > rounds["left_open"].iloc[-1]
    assert found.estimator_.simulation.n_runs == rounds["n_runs"].iloc[-1]
    assert (found.verdict_, found.best_cause_.kind) == ("named", "step")
    assert "further runs followed the first" in " ".join(str(found.report(full=True)).split())
    # what was asked for is as it was
    assert asked.estimator.simulation is simulation
    assert not hasattr(asked, "refinement_")


@pytest.mark.slow
def test_a_budget_ends_it_with_a_warning_and_the_last_round_has_folds():
    simulation = SIMULATOR.run(24, along=50, random_state=0)
    with pytest.warns(hs.DiagnosisWarning, match=r"budget of 2 further runs ended .* open_below"):
        found = hs.refine(
            diagnosis(simulation, cv=2), T[:, None], measured(0.0), budget=2, open_below=1e-6
        )
    assert found.refinement_["n_runs"].tolist() == [24, 26]
    assert found.gain_ is not None


@pytest.mark.slow
def test_runs_that_fail_are_counted_and_the_others_used():
    def failing(t, a, k, w):
        return np.where(w > 0.99, np.nan, oscillation(t, a, k, w))

    simulation = SIMULATOR.run(12, along=50, random_state=0)
    with pytest.warns(hs.HybridSurrogateWarning) as caught:
        found = hs.refine(
            diagnosis(simulation),
            T[:, None],
            measured(0.0),
            hs.Simulator(failing, {"t": (0, 20)}, PRIORS),
            budget=10,
            open_below=1e-6,
        )
    (said,) = [str(w.message) for w in caught if w.category is hs.FailedRunsWarning]
    lost = int(said.split(" of 10 further runs failed")[0])
    assert 0 < lost < 10
    assert found.refinement_["n_runs"].tolist() == [12, 22 - lost]


def test_what_cannot_be_refined_is_refused():
    simulation = SIMULATOR.run(12, along=50, random_state=0)
    with pytest.raises(TypeError, match=r"must be SimulationData, .* got Simulator"):
        hs.refine(diagnosis(SIMULATOR), T[:, None], measured(0.0))
    rows = hs.SimulationData.from_frame(simulation.to_frame(), ["t"], PRIORS)
    with pytest.raises(TypeError, match=r"refine needs the simulation itself to run"):
        hs.refine(diagnosis(rows), T[:, None], measured(0.0))
