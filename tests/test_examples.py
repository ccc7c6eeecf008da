"""Examples run from end to end."""

import os
import subprocess
import sys
from pathlib import Path

from shared_files import shared_path

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


def test_italy():
    folder = shared_path("data", "italy_covid19_wave1.csv").parent
    run = subprocess.run(
        [sys.executable, str(EXAMPLES / "italy_covid.py"), str(folder), "--fast"],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": str(EXAMPLES.parent)},
    )
    assert run.returncode == 0, run.stderr
    assert "Best beta of each scheme" in run.stdout
    # constant rates cannot follow a lockdown
    assert "adequate" not in run.stdout
