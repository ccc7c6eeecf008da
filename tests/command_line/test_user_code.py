"""A simulation that is a function of the user's own Python file."""

import json
import sys

import numpy as np
import pandas as pd
import pytest

import hybridsurrogate as hs
from hybridsurrogate.command_line.main import main
from hybridsurrogate.command_line.user_code import function_in
from hybridsurrogate.effects.registry import kinds

FALL = """
import helper_of_fall

def fall(t, gravity, start=100.0):
    return start - helper_of_fall.HALF * gravity * t**2

constant = 3
"""
FEW = sorted({*kinds()} - {"offset", "trend"})


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A body that falls and is measured 5 m too high."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.delitem(sys.modules, "model_of_fall", raising=False)
    monkeypatch.delitem(sys.modules, "helper_of_fall", raising=False)
    (tmp_path / "model_of_fall.py").write_text(FALL)
    (tmp_path / "helper_of_fall.py").write_text("HALF = 0.5")
    t = np.linspace(0.2, 4, 24)
    noise = 0.5 * np.random.default_rng(0).standard_normal(24)
    height = 105 - 9.8 / 2 * t**2 + noise
    pd.DataFrame({"t": t, "height": height}).to_csv(tmp_path / "measured.csv", index=False)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def words(command, *more):
    return [
        *(command, "measured.csv", "--simulation", "model_of_fall.py:fall", "--inputs", "t"),
        *("--output", "height", "--prior", "gravity=9.8,0.1", *more),
    ]


def test_a_function_is_diagnosed_saved_reported_and_predicts(folder, capsys):
    more = ("--exclude", *FEW, "--no-folds", "--save", "fall.hs", "--json", "one.json", "--quiet")
    assert main(words("diagnose", *more)) == 0
    numbers = json.loads((folder / "one.json").read_text())
    assert numbers["best_cause"]["kind"] == "offset"
    _, low, high = numbers["best_cause"]["estimates"]["amplitude"]
    assert low < 5 < high
    capsys.readouterr()

    # as another process would, which has not imported the function
    del sys.modules["model_of_fall"], sys.modules["helper_of_fall"]
    assert main(["report", "fall.hs", "--report", "two.html", "--json", "-", "--check"]) == 1
    told = capsys.readouterr()
    assert json.loads(told.out) == numbers
    assert f"The simulation in {folder / 'model_of_fall.py'} is executed." in told.err
    assert (folder / "two.html").exists()

    assert main(["predict", "fall.hs", "measured.csv"]) == 0
    told = capsys.readouterr()
    rows = pd.read_csv(pd.io.common.StringIO(told.out))
    measured = pd.read_csv("measured.csv")["height"]
    assert list(rows) == ["t", "height_mean", "height_sd", "height_low", "height_high"]
    assert np.sqrt(np.mean((rows["height_mean"] - measured) ** 2)) < 0.7
    within = (rows["height_low"] < measured) & (measured < rows["height_high"])
    assert within.mean() > 0.75

    assert main(["next-runs", "fall.hs"]) == 2
    assert "hybridsurrogate: " in capsys.readouterr().err
    (folder / "model_of_fall.py").unlink()
    assert main(["report", "fall.hs", "--report", "three.html"]) == 2
    assert "which is not there: put it back" in capsys.readouterr().err
    assert not (folder / "three.html").exists()


@pytest.mark.slow
def test_folds_in_other_processes_find_the_function(folder, capsys):
    more = ("--exclude", *FEW, "--jobs", "2", "--json", "one.json")
    assert main(words("diagnose", *more)) == 0
    told = capsys.readouterr()
    assert "The folds ran in this process" not in told.err
    assert "The function model_of_fall.py:fall is executed as it stands." in told.out
    assert json.loads((folder / "one.json").read_text())["gain"]["elpd_difference"] > 0


def test_a_function_that_is_emulated(folder, capsys):
    more = ("--runs", "40", "--surrogate", "polynomial-chaos", "--degree", "2", "--save", "fit.hs")
    assert main(words("fit", *more)) == 0
    told = capsys.readouterr()
    assert "gravity" in told.out
    model = hs.load("fit.hs")
    assert isinstance(model.surrogate_, hs.PolynomialChaos)
    assert model.simulation.n_runs == 40
    assert model.simulation.input_ranges["t"] == pytest.approx((0.2, 4))


@pytest.mark.parametrize(
    ("simulation", "message"),
    [
        ("model_of_fall.py:fal", "has no function 'fal', it has fall, constant: write "),
        ("model_of_fall.py:fal", "Did you mean 'fall'?"),
        ("model_of_fall.py", "name its function, it has fall, constant"),
        ("model_of_fall.py:constant", "'constant' of model_of_fall.py is no function"),
        ("nowhere.py:fall", "there is no such file"),
        ("broken.py:fall", "broken.py is not Python: "),
        ("fails.py:fall", "fails.py fails: ZeroDivisionError: division by zero"),
        ("ends.py:fall", "ends.py fails: SystemExit: 3"),
        ("json.py:fall", "json.py has the name of another Python module: rename it"),
        ("numpy.py:fall", "numpy.py has the name of another Python module: rename it"),
    ],
)
def test_a_function_that_cannot_be_had_is_one_line(folder, capsys, simulation, message):
    (folder / "broken.py").write_text("def fall(:")
    (folder / "fails.py").write_text("def fall(t): return t\n1 / 0")
    (folder / "ends.py").write_text("def fall(t): return t\nraise SystemExit(3)")
    for name in ("json.py", "numpy.py"):
        (folder / name).write_text("def fall(t): return t")
    (folder / "report.html").write_text("older")
    line = words("diagnose")
    line[line.index("model_of_fall.py:fall")] = simulation
    assert main(line) == 2
    (error,) = capsys.readouterr().err.splitlines()
    assert message in error
    assert (folder / "report.html").read_text() == "older"


def test_a_function_that_is_not_there_runs_nothing(folder):
    (folder / "fails.py").write_text("open('ran', 'w').close()")
    with pytest.raises(ValueError, match="has no function 'fall', it has none"):
        function_in("fails.py:fall")
    assert not (folder / "ran").exists()


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (("--parameters", "gravity", "start"), "The parameters ['start'] have no prior"),
        (("--prior", "start=high"), "write NAME=MEAN,SD or MEAN,SD,LOW,HIGH or LOW..HIGH"),
        (("--prior", "start=3..1"), "write NAME=MEAN,SD"),
        (("--prior", "mass=1,1"), "has no argument mass"),
        (("--assumed", "start=100"), "--assumed start=100: write NAME=VALUE,LOW,HIGH"),
        (("--surrogate", "kriging"), "add --runs 128"),
        (("--degree", "2"), "add --runs 128, or leave out --degree"),
        (("--degree", "2", "--surrogate", "kriging"), "--degree is for polynomial-chaos"),
    ],
)
def test_what_a_function_lacks(folder, capsys, more, message):
    assert main(words("diagnose", *more)) == 2
    assert message in capsys.readouterr().err.splitlines()[-1]


def test_dates_are_no_arguments_of_a_function(folder, capsys):
    table = pd.read_csv("measured.csv")
    table["t"] = [f"2026-11-{k + 1:02}" for k in range(24)]
    table.to_csv("measured.csv", index=False)
    assert main(words("diagnose")) == 2
    assert "'t' holds dates, and a function takes numbers" in capsys.readouterr().err


def test_choosing_a_weight_needs_an_emulator(folder, capsys):
    assert main(words("choose-beta")) == 2
    assert "no weight to choose: add --runs 128" in capsys.readouterr().err
