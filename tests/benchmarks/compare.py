"""Seconds of whole jobs next to those of an earlier commit, in turn on the same machine.

``python tests/benchmarks/compare.py COMMIT [--jobs NAME ...] [--rounds 3]`` checks the commit out
into a folder of its own and prints CPU seconds before and after with their ratio: machines are
noisy, and a ratio of two runs one after the other is less so. Linux and macOS.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from jobs import JOBS

ROOT = Path(__file__).resolve().parents[2]


def used(root: Path, job: str) -> tuple[float, float] | None:
    """Return CPU seconds and GB that a job takes with the package in a folder; None if it fails."""
    environment = {**os.environ, "PYTHONPATH": str(root), "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, str(Path(__file__).with_name("jobs.py")), job],
        env=environment,
        cwd=root,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        return None
    seconds, memory = done.stdout.split()[-2:]
    return float(seconds), float(memory)


def compare(before: Path, jobs: list[str], rounds: int) -> None:
    """Print a line for each job: medians over rounds."""
    print(f"{'CPU seconds':36s} {'before':>8s} {'now':>8s} {'ratio':>6s} {'GB now':>7s}")
    for job in jobs:
        pairs = [(used(before, job), used(ROOT, job)) for _ in range(rounds)]
        whole = [(a, b) for a, b in pairs if a is not None and b is not None]
        if not whole:
            print(f"{job:36s} failed in one of the two")
            continue
        old, new = (statistics.median(pair[k][0] for pair in whole) for k in (0, 1))
        memory = max(b[1] for _, b in whole)
        print(f"{job:36s} {old:8.2f} {new:8.2f} {new / old:6.2f} {memory:7.2f}", flush=True)


if __name__ == "__main__":
    given = argparse.ArgumentParser(description=__doc__)
    given.add_argument("commit")
    given.add_argument("--jobs", nargs="+", default=list(JOBS), choices=list(JOBS))
    given.add_argument("--rounds", type=int, default=3)
    asked = given.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "before"
        add = ["git", "-C", str(ROOT), "worktree", "add", "--detach", str(tree), asked.commit]
        subprocess.run(add, check=True, capture_output=True)
        try:
            compare(tree, asked.jobs, asked.rounds)
        finally:
            remove = ["git", "-C", str(ROOT), "worktree", "remove", "--force", str(tree)]
            subprocess.run(remove, check=True)
