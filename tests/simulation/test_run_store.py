"""Runs that survive: stored when they end, gone on with after a kill, kept with their errors."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pandas as pd
import pytest
from joblib import parallel_config
from scipy.stats import uniform

import hybridsurrogate as hs

RATE = {"rate": uniform(0.1, 0.4)}
# a run of three hundredths of a second, and 40 of them
SCRIPT = """
import sys, time
import numpy as np
from scipy.stats import uniform
import hybridsurrogate as hs

def slow(t, rate):
    time.sleep(0.03)
    return np.exp(-rate * t)

simulator = hs.Simulator(slow, {"t": (0, 10)}, {"rate": uniform(0.1, 0.4)}, returns="curve")
data = simulator.run(40, random_state=0, along=20, store=sys.argv[1])
data.to_frame().to_csv(sys.argv[2], index=False)
"""


def counted(calls, returns="values"):
    def decay(t, rate):
        calls.append(float(np.ravel(rate)[0]))
        return np.exp(-rate * t)

    return hs.Simulator(decay, {"t": (0, 10)}, RATE, vectorized=False, returns=returns)


@pytest.mark.parametrize(("returns", "along"), [("values", None), ("values", 6), ("curve", 6)])
def test_what_is_stored_is_not_run_again(tmp_path, returns, along):
    calls = []
    simulator = counted(calls, returns)
    whole = simulator.run(16, random_state=0, along=along)
    n = len(calls)
    first, again = (
        simulator.run(16, random_state=0, along=along, store=tmp_path / "runs") for _ in range(2)
    )
    assert len(calls) == 2 * n
    np.testing.assert_array_equal(first.to_frame(), whole.to_frame())
    np.testing.assert_array_equal(again.to_frame(), whole.to_frame())
    kept = pd.read_csv(tmp_path / "runs" / "runs.csv")
    assert kept["run"].nunique() == n
    assert kept["seconds"].ge(0).all()


@pytest.mark.slow
def test_a_kill_loses_only_the_run_in_flight(tmp_path):
    """Killed at random moments, gone on with: the same runs as without a kill."""
    store, out = tmp_path / "runs", tmp_path / "out.csv"
    moments = np.random.default_rng(0).uniform(0.05, 0.5, 2)
    began = 0
    for moment in moments:
        process = subprocess.Popen([sys.executable, "-c", SCRIPT, str(store), str(out)])
        kept = store / "runs.csv"
        deadline = time.monotonic() + 60
        # from when it has begun, or has new runs
        while process.poll() is None and time.monotonic() < deadline:
            if kept.exists() and kept.stat().st_size > began:
                break
            time.sleep(0.01)
        time.sleep(moment)
        process.send_signal(signal.SIGKILL if os.name == "posix" else signal.SIGTERM)
        process.wait()
        began = kept.stat().st_size if kept.exists() else 0
    text = (store / "runs.csv").read_text().splitlines()
    finished = sum(line.endswith(",1") for line in text)
    assert 0 < finished < 40
    subprocess.run([sys.executable, "-c", SCRIPT, str(store), str(out)], check=True)
    again = pd.read_csv(store / "runs.csv")
    assert (again["last"] == 1).sum() == 40
    alone = hs.Simulator(np_decay, {"t": (0, 10)}, RATE, returns="curve")
    expected = alone.run(40, random_state=0, along=20).to_frame()
    pd.testing.assert_frame_equal(pd.read_csv(out), expected, check_dtype=False)


@pytest.mark.parametrize("cut", [3, 40, 200])
def test_a_line_that_was_being_written_is_cut_off(tmp_path, cut):
    calls = []
    simulator = counted(calls, "curve")
    whole = simulator.run(8, random_state=0, along=6, store=tmp_path)
    path = tmp_path / "runs.csv"
    path.write_bytes(path.read_bytes()[:-cut])
    calls.clear()
    again = simulator.run(8, random_state=0, along=6, store=tmp_path)
    assert len(calls) == 1
    np.testing.assert_array_equal(again.to_frame(), whole.to_frame())


def test_an_interrupt_keeps_what_was_run(tmp_path):
    calls = []

    def interrupted(t, rate):
        calls.append(rate)
        if len(calls) == 6:
            raise KeyboardInterrupt
        return np.exp(-rate * t)

    simulator = hs.Simulator(interrupted, {"t": (0, 10)}, RATE, vectorized=False)
    with pytest.raises(KeyboardInterrupt):
        simulator.run(16, random_state=0, ends=0, store=tmp_path)
    assert len(pd.read_csv(tmp_path / "runs.csv")) == 5
    simulator.run(16, random_state=0, ends=0, store=tmp_path)
    assert len(calls) == 17


def test_failed_runs_keep_their_error_and_are_not_tried_again(tmp_path):
    calls = []

    def failing(t, rate):
        calls.append(rate)
        if rate > 0.45:
            raise RuntimeError("no\nconvergence, at all")
        return np.exp(-rate * t)

    simulator = hs.Simulator(failing, {"t": (0, 10)}, RATE, returns="curve")
    for _ in range(2):
        with pytest.warns(hs.FailedRunsWarning, match=r"2 of 16 runs .* no convergence, at all"):
            simulator.run(16, random_state=0, along=6, store=tmp_path)
    assert len(calls) == 16
    kept = pd.read_csv(tmp_path / "runs.csv")
    assert kept["error"].dropna().tolist() == ["RuntimeError: no convergence, at all"] * 2


def test_a_larger_design_goes_on_with_the_runs_of_a_smaller_one(tmp_path):
    calls = []
    simulator = counted(calls, "curve")
    simulator.run(8, random_state=0, along=6, store=tmp_path)
    simulator.run(16, random_state=0, along=6, store=tmp_path)
    assert len(calls) == 16


def test_a_store_of_another_simulation_is_refused_and_left_as_it_is(tmp_path):
    simulator = counted([])
    simulator.run(8, random_state=0, store=tmp_path / "runs")
    before = (tmp_path / "runs" / "runs.csv").read_text()

    def other(t, rate):
        return rate

    with pytest.raises(ValueError, match=r"runs of another simulation: its simulation is 'decay'"):
        hs.Simulator(other, {"t": (0, 10)}, RATE).run(8, store=tmp_path / "runs")
    assert (tmp_path / "runs" / "runs.csv").read_text() == before
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "letter.txt").write_text("dear")
    with pytest.raises(ValueError, match=r"holds other files than runs"):
        simulator.run(8, store=tmp_path / "mine")


def test_a_run_that_takes_too_long_is_stopped_and_counted():
    def hanging(t, rate):
        if rate > 0.45:
            time.sleep(30)
        return np.exp(-rate * t)

    simulator = hs.Simulator(hanging, {"t": (0, 10)}, RATE, returns="curve")
    begun = time.monotonic()
    with pytest.warns(hs.FailedRunsWarning, match=r"2 of 16 runs .* longer than 0.2 s"):
        data = simulator.run(16, random_state=0, along=6, timeout=0.2)
    assert data.n_runs == 14
    assert time.monotonic() - begun < 20
    # a thread cannot be stopped: that is said, and no run goes on without its limit
    with (
        parallel_config(backend="threading"),
        pytest.raises(ValueError, match=r"All 4 runs .* timeout needs signals and the main thread"),
    ):
        simulator.run(4, random_state=0, along=6, timeout=0.2, n_jobs=2)
    with pytest.raises(ValueError, match=r"timeout is for one run: a vectorized function"):
        hs.Simulator(hanging, {"t": (0, 10)}, RATE).run(16, timeout=1)


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["loky", "threading", "multiprocessing"])
def test_every_backend_of_joblib_gives_the_same_runs(tmp_path, backend):
    simulator = hs.Simulator(np_decay, {"t": (0, 10)}, RATE, returns="curve")
    alone = simulator.run(8, random_state=0, along=6)
    with parallel_config(backend=backend):
        data = simulator.run(8, random_state=0, along=6, n_jobs=2, store=tmp_path)
    np.testing.assert_array_equal(data.to_frame(), alone.to_frame())


def np_decay(t, rate):
    return np.exp(-rate * t)


def test_an_ode_is_stored_like_any_other(tmp_path):
    simulator = hs.OdeSimulator(
        lambda t, state, rate: -rate * state,
        [1.0],
        lambda state: state[0],
        inputs={"t": (0, 5)},
        parameters=RATE,
        states=["level"],
    )
    first, again = (simulator.run(8, random_state=0, along=6, store=tmp_path) for _ in range(2))
    np.testing.assert_array_equal(first.to_frame(), again.to_frame())
    assert len(pd.read_csv(tmp_path / "runs.csv")) == 48


def test_names_of_runs_may_be_words():
    runs = counted([]).run(4, random_state=0, along=6).to_frame()
    runs["run"] = runs["run"].map({0: "a", 1: "b", 2: "c", 3: "d"})
    data = hs.SimulationData.from_frame(runs, ["t"], RATE)
    assert data.n_runs == 4
    more = counted([]).run(4, random_state=1, along=6).to_frame()
    assert data.with_rows(more).n_runs == 8


def test_runs_on_disk_are_not_copied_into_memory_and_fit_the_same(tmp_path, monkeypatch):
    # some rows at a time, and not a multiple of them
    monkeypatch.setattr("hybridsurrogate.numerics.linear_algebra.blocks.__defaults__", (500,))
    monkeypatch.setattr("hybridsurrogate.model.statistics.LARGE_BLOCK", 700)
    rng = np.random.default_rng(0)
    t, rate = rng.uniform(0, 10, 1001), rng.uniform(0.1, 0.5, 1001)
    arrays = {"t": t, "rate": rate, "y": np.exp(-rate * t)}
    for name, values in arrays.items():
        np.save(tmp_path / f"{name}.npy", values)
    mapped = [np.load(tmp_path / f"{name}.npy", mmap_mode="r") for name in arrays]
    there = hs.SimulationData(*mapped, ["t"], RATE)
    assert np.shares_memory(there.y, mapped[2])
    assert np.shares_memory(there.X, mapped[0])
    copied = hs.SimulationData(*arrays.values(), ["t"], RATE)
    assert not np.shares_memory(copied.y, arrays["y"])
    T = np.linspace(0.5, 9.5, 20)[:, None]
    y = np.exp(-0.3 * T[:, 0]) + 0.05 * rng.normal(size=20)
    scores = [
        hs.PowerScaledSurrogate(data, n_draws=200, random_state=0).fit(T, y).score(T, y)
        for data in (there, copied)
    ]
    assert scores[0] == pytest.approx(scores[1], abs=1e-6)
    monkeypatch.undo()
    whole = hs.PowerScaledSurrogate(copied, n_draws=200, random_state=0).fit(T, y)
    assert whole.score(T, y) == pytest.approx(scores[0], abs=1e-6)
