"""Surrogates on two data sources from the command line."""

import json

import numpy as np
import pandas as pd
import pytest

import hybridsurrogate as hs
from hybridsurrogate.command_line.main import main


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A distance that is speed times time, measured at a speed of 2."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(0)
    runs = pd.DataFrame({"t": rng.uniform(0, 10, 60), "speed": rng.uniform(1, 3, 60)})
    runs.assign(distance=runs["t"] * runs["speed"]).to_csv("runs.csv", index=False)
    t = np.linspace(0, 9, 20)
    measured = pd.DataFrame({"t": t, "distance": 2 * t + 0.2 * rng.standard_normal(20)})
    measured.to_csv("measured.csv", index=False)
    return tmp_path


def words(command, *more):
    return [
        *(command, "measured.csv", "--simulation", "runs.csv", "--inputs", "t"),
        *("--parameters", "speed", "--output", "distance", "--prior", "speed=1..3"),
        *("--degree", "2", *more),
    ]


def test_a_fit_prints_its_estimates_and_predicts_new_rows(folder, capsys):
    assert main(words("fit", "--save", "fit.hs", "--json", "fit.json")) == 0
    told = capsys.readouterr().out
    assert "speed" in told
    assert "Saved: fit.hs" in told
    (speed,) = [
        one
        for one in json.loads((folder / "fit.json").read_text())["estimates"]
        if one["name"] == "speed"
    ]
    assert speed["q5"] < 2 < speed["q95"]
    assert speed["sd"] < 0.05
    pd.DataFrame({"note": ["a", "b"], "t": [1.0, 8.0]}).to_csv("new.csv", index=False)
    assert main(["predict", "fit.hs", "new.csv", "--table", "out.csv"]) == 0
    assert capsys.readouterr().out == "2 rows: out.csv\n"
    predicted = pd.read_csv("out.csv")
    np.testing.assert_allclose(predicted["distance_mean"], [2, 16], atol=0.3)
    assert (predicted["distance_low"] < predicted["distance_mean"]).all()
    assert (predicted["distance_mean"] < predicted["distance_high"]).all()


def test_both_methods_of_the_paper(folder):
    assert main(words("fit", "--method", "predictive-weighting", "--save", "fit.hs")) == 0
    assert isinstance(hs.load("fit.hs"), hs.PredictiveWeightedSurrogate)


def test_the_weight_of_a_right_simulation_is_compared(folder, capsys):
    more = ("--betas", "0", "0.5", "--folds", "3", "--json", "-", "--save", "best.hs")
    assert main(words("choose-beta", *more)) == 0
    told = capsys.readouterr()
    numbers = json.loads(told.out)
    assert [row["beta"] for row in numbers["table"]] == [0, 0.5]
    best = max(numbers["table"], key=lambda row: row["elpd"])
    assert numbers["beta"] == best["beta"] == hs.load("best.hs").beta
    assert "has the best held-out ELPD" in told.err


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (["predict", "none.hs", "measured.csv"], "there is no such file"),
        (["predict", "runs.csv", "measured.csv"], "is no saved fit or diagnosis"),
        (["predict", "old.hs", "measured.csv"], "was saved by hybridsurrogate 0.0.1"),
        (["report", "old.hs"], "fit again, or install hybridsurrogate==0.0.1"),
        (["report", "fit.hs"], "a fitted PowerScaledSurrogate, not a DiscrepancyDiagnosis"),
        (["next-runs", "fit.hs"], "diagnose with --save writes one"),
        (["predict", "fit.hs", "wrong.csv"], "has no columns ['t']; its columns are ['T']"),
        (["predict", "fit.hs", "wrong.csv"], "Did you mean 'T'?"),
        (["predict", "fit.hs", "text.csv"], "1 of 1 values of 't' are no numbers"),
        (["predict", "fit.hs", "runs.csv", "--table", "no/out.csv"], "does not exist"),
        (["fit", "measured.csv", "--simulation", "runs.csv"], "--inputs is missing"),
        (words("fit", "--runs", "9"), "--runs is for a function"),
        (words("fit", "--surrogate", "exact"), "--degree is for polynomial-chaos"),
        (words("fit", "--json", "no/fit.json"), "does not exist"),
        (words("fit", "--assumed", "mass=1"), "runs.csv has no columns ['mass']"),
        (words("choose-beta", "--folds", "1"), "cv must be"),
    ],
)
def test_a_mistake_is_one_line_and_writes_nothing(folder, fitted, capsys, command, message):
    pd.DataFrame({"T": [1.0]}).to_csv("wrong.csv", index=False)
    pd.DataFrame({"t": ["soon"]}).to_csv("text.csv", index=False)
    hs.save(fitted, "fit.hs")
    first, head, rest = (folder / "fit.hs").read_bytes().split(b"\n", 2)
    about = json.dumps(json.loads(head) | {"hybridsurrogate": "0.0.1"}).encode()
    (folder / "old.hs").write_bytes(b"\n".join([first, about, rest]))
    before = {path.name: path.stat().st_mtime_ns for path in folder.iterdir()}
    assert main(command) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert message in error
    assert {path.name: path.stat().st_mtime_ns for path in folder.iterdir()} == before
