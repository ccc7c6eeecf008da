"""Where will a run fail? The runs that did show it."""

import warnings

import numpy as np
import pandas as pd
import pytest
from few_kinds import all_but
from scipy.stats import qmc, uniform
from sklearn.gaussian_process import GaussianProcessClassifier

import hybridsurrogate as hs
from hybridsurrogate.emulators.failures import Failures

PRIORS = {"rate": uniform(0.2, 0.8), "level": uniform(1, 2)}
T = np.linspace(0, 10, 25)


def fails(rate, level):
    return rate * level > 1.4


def decay(t, rate, level):
    return np.where(fails(rate, level), np.nan, level * np.exp(-rate * t))


SIMULATOR = hs.Simulator(decay, {"t": (0, 10)}, PRIORS)


def runs(n, **how):
    with pytest.warns(hs.FailedRunsWarning):
        return SIMULATOR.run(n, random_state=0, **how)


def points(n, seed=7):
    low, width = [0, 0.2, 1], [10, 0.8, 2]
    unit = qmc.LatinHypercube(3, seed=seed).random(n)
    return pd.DataFrame(low + unit * width, columns=["t", "rate", "level"])


@pytest.mark.parametrize("along", [None, 25])
def test_failures_are_predicted(along):
    made = runs(64, along=along)
    assert len(made.failed) + made.n_runs == 64
    assert fails(*made.failed[:, 1:].T).all()
    emulator = hs.Emulator().fit(made)
    new = points(1000)
    found, true = emulator.predict_failure(new), fails(new["rate"], new["level"])
    assert np.mean((found - true) ** 2) < 0.4 * np.var(true)
    assert np.mean((found > 0.5) == true) > 0.9
    # columns go by name
    np.testing.assert_allclose(emulator.predict_failure(new[["level", "t", "rate"]]), found)


def test_runs_that_do_not_fail_never_will():
    made = hs.Simulator(lambda t, rate, level: level - rate * t, {"t": (0, 10)}, PRIORS).run(20)
    assert made.failed.shape == (0, 3)
    assert not hs.Emulator().fit(made).predict_failure(points(5)).any()


def test_failures_are_kept_however_they_come():
    every = points(20)
    y = decay(*every.to_numpy().T)
    lost = np.isnan(y)
    assert 0 < lost.sum() < 20
    with pytest.warns(hs.FailedRunsWarning):
        rows = hs.SimulationData(every[["t"]], every[["rate", "level"]], y, ["t"], PRIORS)
    np.testing.assert_array_equal(rows.failed, every[lost])
    done = every[~lost]
    given = hs.SimulationData(
        done[["t"]], done[["rate", "level"]], y[~lost], ["t"], PRIORS, failed=every[lost]
    )
    np.testing.assert_array_equal(given.failed, every[lost])
    with pytest.warns(hs.FailedRunsWarning):
        more = rows.with_rows(points(10, 8).assign(y=lambda f: decay(f.t, f.rate, f.level)))
    assert len(more.failed) + more.n_runs == 30
    outputs = decay(T, *every[["rate", "level"]].to_numpy().T[:, :, None])
    with pytest.warns(hs.FailedRunsWarning):
        curves = hs.SimulationData.from_curves(
            every[["rate", "level"]], outputs, along={"t": T}, parameters=PRIORS
        )
    np.testing.assert_array_equal(curves.failed[:, 1:], every[lost][["rate", "level"]])
    # a run with some of its outputs did not fail
    outputs[~lost, 20:] = np.nan
    with pytest.warns(hs.FailedRunsWarning):
        curves = hs.SimulationData.from_curves(
            every[["rate", "level"]], outputs, along={"t": T}, parameters=PRIORS
        )
    assert len(curves.failed) == lost.sum()


@pytest.mark.parametrize("along", [None, 25])
@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_failures_are_saved_and_read(tmp_path, along, ending):
    if ending == "parquet":
        pytest.importorskip("pyarrow")
    made = runs(32, along=along)
    assert len(made.failed)
    made.save(tmp_path / f"runs.{ending}")
    with pytest.warns(hs.FailedRunsWarning, match=f"^{len(made.failed)} of"):
        again = hs.read_simulation(tmp_path / f"runs.{ending}", ["t"], PRIORS)
    assert again.n_runs == made.n_runs
    for name in ("X", "omega", "y", "failed"):
        np.testing.assert_allclose(getattr(again, name), getattr(made, name))


def test_failures_of_several_outputs_are_saved_and_read(tmp_path):
    def both(t, rate, level):
        return {"mass": decay(t, rate, level), "heat": 2 * decay(t, rate, level)}

    simulator = hs.Simulator(both, {"t": (0, 10)}, PRIORS, output=["mass", "heat"])
    with pytest.warns(hs.FailedRunsWarning):
        made = simulator.run(32, random_state=0)
    made.save(tmp_path / "runs.csv")
    with pytest.warns(hs.FailedRunsWarning):
        again = hs.read_simulation(tmp_path / "runs.csv", ["t"], PRIORS, ["mass", "heat"])
    np.testing.assert_allclose(again.failed, made.failed)
    np.testing.assert_allclose(again.y, made.y)


def test_further_runs_do_not_warn_of_failures_that_are_known():
    made = runs(32, along=25)
    more = made.with_rows(SIMULATOR.run_at(pd.DataFrame({"rate": [0.3], "level": [1.5]}), T))
    assert more.n_runs == made.n_runs + 1
    np.testing.assert_array_equal(more.failed, made.failed)


def test_failures_of_several_sources_count():
    first, second = runs(32), runs(16)
    sources = [hs.Source(first, 0.5), hs.Source(second, 0.5)]
    merged = hs.MultiSourceSurrogate(sources).simulation
    np.testing.assert_array_equal(merged.failed, np.vstack([first.failed, second.failed]))


def test_failures_of_another_shape_are_refused():
    with pytest.raises(ValueError, match="failed"):
        hs.SimulationData(T, T, T, ["t"], {"rate": uniform(0, 10)}, failed=[[1.0]])


# few runs, on purpose
@pytest.mark.filterwarnings("ignore:At the measured rows:hybridsurrogate.DiagnosisWarning")
@pytest.mark.filterwarnings("ignore::hybridsurrogate.PriorWarning")
@pytest.mark.parametrize(("rate", "cautioned"), [(0.4, False), (0.85, True)])
def test_a_diagnosis_says_that_runs_fail_where_the_data_are(rate, cautioned, monkeypatch):
    y = 2.2 * np.exp(-rate * T) + 0.02 * np.random.default_rng(0).standard_normal(25)
    model = hs.PowerScaledSurrogate(
        runs(24, along=25), surrogate=hs.Kriging(), n_draws=200, random_state=0
    )
    settings = {"exclude": all_but("step", "trend"), "cv": None, "n_replicates": 19}
    diagnosis = hs.DiscrepancyDiagnosis(model, **settings, random_state=0)
    learned = []
    fit = GaussianProcessClassifier.fit
    monkeypatch.setattr(
        GaussianProcessClassifier, "fit", lambda *given: [learned.append(1), fit(*given)][1]
    )
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        diagnosis.fit(T[:, None], y)
    said = [str(one.message) for one in caught if "a run fails with" in str(one.message)]
    assert len(said) == cautioned
    asked = diagnosis.next_runs(3)
    if not cautioned:
        assert not fails(asked["rate"], asked["level"]).any()
    # a classifier serves the caution, the runs that are asked for and an emulator
    hs.Emulator().fit(model.simulation)
    assert len(learned) == 1


def test_rare_failures_among_many_runs_count():
    """Of 4,000 runs 14 fail, all in one corner; a sample of 300 would have one of them."""
    random = np.random.default_rng(0)
    x = random.uniform(size=(4000, 2))
    corner = (x[:, 0] > 0.97) & (x[:, 1] > 0.9)
    done = x[~corner]
    data = hs.SimulationData(
        done[:, :1],
        done[:, 1:],
        done.sum(axis=1),
        inputs=["t"],
        parameters={"rate": uniform(0, 1)},
        failed=x[corner],
    )
    there, elsewhere = Failures.of(data).probability(np.array([[0.99, 0.95], [0.5, 0.5]]))
    assert there > 0.3
    assert elsewhere < 0.02
