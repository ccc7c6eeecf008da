"""Examples run from end to end."""

import os
import subprocess
import sys
from pathlib import Path

from shared_files import shared_path

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


def run_example(name, *arguments):
    """Run an example with fewer draws and return what it printed."""
    run = subprocess.run(
        [sys.executable, str(EXAMPLES / name), *arguments, "--fast"],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": str(EXAMPLES.parent)},
    )
    assert run.returncode == 0, run.stderr
    return run.stdout


def test_italy():
    folder = shared_path("data", "italy_covid19_wave1.csv").parent
    printed = run_example("italy_covid.py", str(folder))
    assert "Best beta of each scheme" in printed
    # constant rates cannot follow a lockdown, a contact rate that falls can
    assert "named simulation with contact_rate falling by" in printed
    scores = {}
    for line in printed.splitlines():
        name, found, rest = line.partition(": ELPD per day ")
        if found:
            elpd, _, error = rest.partition(", RMSE per 100,000 ")
            scores[name] = (float(elpd), float(error))
    assert scores["with the cause"][0] > scores["without the cause"][0] + 1.5
    assert scores["with the cause"][1] < 25


def test_right_choices_win():
    scores = [
        (line.split("ELPD")[0].strip(), float(line.split("ELPD")[1].split("(")[0]))
        for line in run_example("right_choice.py").splitlines()
        if "ELPD" in line
    ]
    found = dict(scores)
    assert found["network"] > found["polynomial chaos, degree 7"] + 0.5
    outliers = [score for name, score in scores if name in ("Student-t", "normal")][:2]
    assert outliers[0] > outliers[1] + 0.5
    assert found["Poisson"] > found["normal"] + 0.1


def test_table_of_combinations():
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in run_example("combinations.py").splitlines()
        if line.startswith("| case") or line.startswith("| counts")
    ]
    found = {
        (data, surrogate, likelihood): float(score)
        for data, surrogate, likelihood, score, *_ in rows
    }
    assert len(found) == 12
    for surrogate in ("PolynomialChaos", "ParametricSurrogate"):
        # the counts scatter more than a Poisson distribution's
        counts = ("counts", surrogate)
        assert found[(*counts, "negative binomial")] > found[(*counts, "Poisson")] + 1


def test_measured_data():
    shared_path("data", "nile_flow.csv")
    shared_path("data", "flu_boarding_school_1978.csv")
    rows = {
        cells[0]: cells
        for cells in (
            [cell.strip() for cell in line.strip("|").split("|")]
            for line in run_example("measured_data.py").splitlines()
        )
    }
    assert "step(year)" in rows["nile"][4]
    # the dam at Aswan was begun in 1899, and the rains had failed a year before
    assert 1895 < float(rows["nile"][7].split()[1]) < 1902
    assert rows["school-influenza"][3] == "adequate"
