"""Several simulations on the command line, as a newcomer types them."""

import json
import sys

import numpy as np
import pandas as pd
import pytest

from hybridsurrogate.command_line.main import main

CODE = "import numpy as np\ndef root(t, gain, level):\n    return level + gain * np.sqrt(t)\n"
WORDS = ("--inputs", "t", "--parameters", "rate", "gain", "level", "--output", "growth")
WORDS += ("--jobs", "1", "--folds", "2")
PRIORS = ("--prior", "gain=2,1", "--prior", "level=0,1", "--prior", "rate=0..3")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The root is right."""
    monkeypatch.chdir(tmp_path)
    # user code extends it
    monkeypatch.setattr(sys, "path", [*sys.path])
    random = np.random.default_rng(0)
    line = pd.DataFrame({"t": random.uniform(0, 9, 60), "rate": random.uniform(0, 3, 60)})
    line.assign(growth=line["rate"] * line["t"]).to_csv("line.csv", index=False)
    line.assign(mass=line["rate"] * line["t"]).to_csv("mass.csv", index=False)
    (tmp_path / "growth_model.py").write_text(CODE, encoding="utf-8")
    t = np.linspace(0.2, 8.8, 30)
    y = 2 * np.sqrt(t) + 0.2 * random.standard_normal(30)
    pd.DataFrame({"t": t, "sd": 0.2, "growth": y}).to_csv("measured.csv", index=False)
    return tmp_path


def quick(*words):
    return main(["compare", *words, *WORDS, "--no-diagnosis", "--report", "both.html"])


def test_runs_and_a_function_are_compared(folder, capsys):
    both = ("--simulations", "line.csv", "growth_model.py:root")
    assert quick("measured.csv", *both, *PRIORS, "--errors", "sd", "--json", "both.json") == 0
    out = capsys.readouterr().out
    assert "line depends on t, rate." in out
    assert "root depends on t, gain, level." in out
    assert "The measurements favour root." in out
    assert json.loads((folder / "both.json").read_text(encoding="utf-8"))["chosen"] == "root"
    page = (folder / "both.html").read_text(encoding="utf-8")
    assert "<img" in page
    assert "Agreement" in page


@pytest.mark.slow
def test_each_has_a_report_of_its_diagnosis(folder, capsys):
    both = ("--simulations", "line.csv", "growth_model.py:root")
    assert main(["compare", "measured.csv", *both, *PRIORS, *WORDS, "--report", "both.html"]) == 0
    out = capsys.readouterr().out
    assert "line lacks something" in out
    for name in ("line", "root"):
        assert f"Diagnosis of {name}: both_{name}.html" in out
        assert (folder / f"both_{name}.html").exists()


def test_a_study_file_names_files_next_to_it(folder, capsys):
    (folder / "study.toml").write_text(
        'measured = "measured.csv"\nsimulations = ["line.csv", "growth_model.py:root"]\n'
        "[prior]\ngain = [2, 1]\nlevel = [0, 1]\n",
        encoding="utf-8",
    )
    assert quick("--config", str(folder / "study.toml")) == 0
    assert "favour root" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("measured.csv --simulations line.csv", "at least two to compare"),
        ("measured.csv --simulations line.csv line.csv", "line.csv twice"),
        ("line.csv --simulations measured.csv mass.csv", "The file of measurements comes first"),
        ("measured.csv --simulations line.csv measured.csv", "both the file of measurements"),
        ("measured.csv --simulations line.csv mass.csv", "mass.csv has no columns .'growth'"),
        ("measured.csv --simulations line.csv mass.csv --output growt", "no columns .'growt'"),
        (
            "measured.csv --simulations line.csv growth_model.py:root --prior gian=2,1",
            "none of the simulations has 'gian'.*Did you mean 'gain'",
        ),
        ("measured.csv --simulations line.csv growth_model.py:root", "'level'. have no prior"),
        ("measured.csv --simulations line.csv mass.csv --runs 30", "--runs is for a function"),
        ("measured.csv", "--simulations is missing"),
    ],
)
def test_what_cannot_be_compared_is_said(folder, capsys, words, message):
    typed = words.split()
    # what is typed last counts
    assert main(["compare", *WORDS, "--no-diagnosis", *typed]) == 2
    assert pd.Series(capsys.readouterr().err).str.contains(message).all()


def test_dates_count_from_one_day(folder, capsys):
    days = pd.date_range("2026-01-01", periods=60).astype(str)
    for name, first in (("early", 0), ("late", 5)):
        runs = pd.read_csv("line.csv").iloc[: 60 - first]
        runs.assign(t=days[first:], gain=runs["rate"], level=0.1 * runs["t"]).to_csv(
            f"{name}.csv", index=False
        )
    pd.read_csv("measured.csv").assign(t=days[10:40]).to_csv("dated.csv", index=False)
    assert quick("dated.csv", "--simulations", "early.csv", "late.csv") == 2
    assert "begin on other dates" in capsys.readouterr().err
