"""Runs, folds and a grid search on a cluster: the same numbers as in one process."""

import subprocess
import sys

import pytest

SCRIPT = """
import os, signal, sys, threading
import numpy as np
from joblib import parallel_config
from scipy.stats import uniform
from sklearn.model_selection import GridSearchCV
import hybridsurrogate as hs

def decay(t, rate):
    return np.exp(-rate * t)

def everything(n_jobs):
    inputs, parameters = {"t": (0, 10)}, {"rate": uniform(0.1, 0.4)}
    simulator = hs.Simulator(decay, inputs, parameters)
    curves = hs.Simulator(decay, inputs, parameters, returns="curve")
    runs = curves.run(16, random_state=0, along=6, n_jobs=n_jobs)
    t = np.linspace(0, 10, 30)[:, None]
    y = decay(t[:, 0], 0.3) + 0.02 * np.random.default_rng(0).normal(size=30) + 0.1 * (t[:, 0] > 5)
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), random_state=0, n_draws=200)
    found = hs.DiscrepancyDiagnosis(
        model, cv=3, n_replicates=19, n_jobs=n_jobs, random_state=0).fit(t, y)
    trained = hs.PowerScaledSurrogate(
        simulator.run(30, random_state=0), n_draws=100, sampler="importance", random_state=0)
    search = GridSearchCV(trained, {"beta": [0.3, 0.8]}, cv=2, n_jobs=n_jobs).fit(t, y)
    gains = found.gain_.elpd_after, found.gain_out_of_range_.elpd_after
    return [*runs.y, *gains, *search.cv_results_["mean_test_score"]]

def on_dask():
    from distributed import Client, LocalCluster
    workers = dict(n_workers=2, threads_per_worker=1, dashboard_address=None)
    with LocalCluster(**workers) as cluster, Client(cluster) as client:
        lost = list(client.run(os.getpid).values())[0]
        threading.Timer(0.3, os.kill, (lost, signal.SIGKILL)).start()
        with parallel_config(backend="dask"):
            told = everything(2)
        assert lost not in client.run(os.getpid).values()
    return told

def on_ray():
    import ray
    from ray.util.joblib import register_ray
    ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False)
    register_ray()
    with parallel_config(backend="ray"):
        return everything(2)

if __name__ == "__main__":
    told = {"dask": on_dask, "ray": on_ray}[sys.argv[1]]()
    # other processes may round sums otherwise
    np.testing.assert_allclose(told, everything(None), rtol=1e-6)
    print("the same")
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="there is no SIGKILL to lose a worker by")
@pytest.mark.parametrize(("backend", "module"), [("dask", "distributed"), ("ray", "ray")])
def test_a_cluster_takes_runs_folds_and_grid_searches(tmp_path, backend, module):
    pytest.importorskip(module, reason=f"{backend} is an extra: hybridsurrogate[{backend}]")
    script = tmp_path / "script.py"
    script.write_text(SCRIPT, encoding="utf-8")
    command = [sys.executable, str(script), backend]
    done = subprocess.run(command, capture_output=True, text=True, timeout=240, check=False)
    assert "the same" in done.stdout.split("\n"), done.stderr
