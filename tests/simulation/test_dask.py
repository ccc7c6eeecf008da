"""Runs on a cluster: one machine lost in the middle, the same runs."""

import subprocess
import sys

import pytest

SCRIPT = """
import os, signal, sys, threading, time
import numpy as np
from distributed import Client, LocalCluster
from joblib import parallel_config
from scipy.stats import uniform
import hybridsurrogate as hs

def slow(t, rate):
    time.sleep(0.1)
    return np.exp(-rate * t)

if __name__ == "__main__":
    rate = {"rate": uniform(0.1, 0.4)}
    simulator = hs.Simulator(slow, {"t": (0, 10)}, rate, returns="curve")
    alone = simulator.run(16, random_state=0, along=6)
    workers = dict(n_workers=2, threads_per_worker=1, dashboard_address=None)
    with LocalCluster(**workers) as cluster, Client(cluster) as client:
        lost = list(client.run(os.getpid).values())[0]
        threading.Timer(0.3, os.kill, (lost, signal.SIGKILL)).start()
        with parallel_config(backend="dask"):
            data = simulator.run(16, random_state=0, along=6, n_jobs=2, store=sys.argv[1])
        assert lost not in client.run(os.getpid).values()
    np.testing.assert_array_equal(data.to_frame(), alone.to_frame())
    print("the same")
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="there is no SIGKILL to lose a worker by")
def test_a_worker_that_is_killed_changes_nothing(tmp_path):
    pytest.importorskip("distributed", reason="dask is an extra: pip install hybridsurrogate[dask]")
    script = tmp_path / "script.py"
    script.write_text(SCRIPT, encoding="utf-8")
    command = [sys.executable, str(script), str(tmp_path / "runs")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.stdout.split("\n")[0] == "the same", done.stderr
