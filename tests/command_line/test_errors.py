"""Error bars on the command line."""

import json
import sys
from pathlib import Path

import numpy as np
import pandas as pd

from hybridsurrogate.command_line.main import main


def test_a_column_of_errors_is_taken(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    random = np.random.default_rng(0)
    t = np.linspace(0, 10, 20)
    runs = pd.DataFrame({"t": random.uniform(0, 10, 60), "rate": random.uniform(0.1, 0.5, 60)})
    runs["y"] = np.exp(-runs["rate"] * runs["t"])
    runs.to_csv("runs.csv", index=False)
    error = np.where(t < 5, 0.001, 0.1)
    y = np.exp(-0.25 * t) + error * random.standard_normal(20)
    pd.DataFrame({"t": t, "error": error, "y": y}).to_csv("measured.csv", index=False)
    words = "--simulation runs.csv --inputs t --parameters rate --output y --errors error"
    words = f"{words} --noise scaled --surrogate polynomial-chaos --degree 5 --beta 0.9"
    assert main(["fit", "measured.csv", *words.split(), "--json", "-"]) == 0
    names = [one["name"] for one in json.loads(capsys.readouterr().out)["estimates"]]
    assert names == ["rate", "sigma", "error_factor"]
    assert (
        main(["fit", "measured.csv", *words.replace("--errors error", "--errors eror").split()])
        != 0
    )


def test_limits_and_rounding_are_taken(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    random = np.random.default_rng(0)
    Path("falling_line.py").write_text("def line(t, rate):\n    return 10 - rate * t\n")
    t = np.linspace(0, 10, 40)
    y = np.maximum(np.round(10 - 0.8 * t + 0.3 * random.standard_normal(40), 1), 5.0)
    pd.DataFrame({"t": t, "y": y}).to_csv("measured.csv", index=False)
    words = "--simulation falling_line.py:line --inputs t --prior rate=0.5,0.5 --output y"
    words = f"{words} --below 5 --rounded 0.1"
    assert main(["fit", "measured.csv", *words.split(), "--json", "-"]) == 0
    out = capsys.readouterr().out
    rate, _ = json.loads(out[out.index("{") :])["estimates"]
    assert abs(rate["mean"] - 0.8) < 3 * rate["sd"]
    assert main(["fit", "measured.csv", *words.replace("below 5", "below 30").split()]) != 0
    assert "None of the 40 measured values" in capsys.readouterr().err


def test_a_column_holds_the_limit_of_each_row(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    random = np.random.default_rng(0)
    Path("falling_slope.py").write_text("def line(t, rate):\n    return 10 - rate * t\n")
    t = np.linspace(0, 10, 40)
    y = 10 - 0.8 * t + 0.3 * random.standard_normal(40)
    limit = np.where(t > 5, random.choice([3.0, 5.0], 40), np.nan)
    frame = pd.DataFrame({"t": t, "y": np.fmax(y, limit), "limit": limit})
    frame.to_csv("measured.csv", index=False)
    words = "--simulation falling_slope.py:line --inputs t --prior rate=0.5,0.5 --output y"
    fit = ["fit", "measured.csv", *words.split(), "--below", "limit", "--save", "fit.hs"]
    assert main([*fit, "--json", "-"]) == 0
    out = capsys.readouterr().out
    rate, _ = json.loads(out[out.index("{") :])["estimates"]
    assert abs(rate["mean"] - 0.8) < 3 * rate["sd"]
    # new rows have limits that no measured row had
    pd.DataFrame({"t": [1.0, 9.0, 9.0], "limit": [4.0, 4.0, np.nan]}).to_csv("new.csv")
    for limits in ([], ["--below", "limit"]):
        assert main(["predict", "fit.hs", "new.csv", "--table", "predicted.csv", *limits]) == 0
        low, high = (pd.read_csv("predicted.csv")[f"y_{end}"] for end in ("low", "high"))
        assert low[0] > 7
        assert high[2] < 4
        assert (low[1] == high[1] == 4.0) == bool(limits)
    # of two outputs one limit each
    Path("two_slopes.py").write_text("def lines(t, rate):\n    return 10 - rate * t, rate * t\n")
    frame.drop(columns="limit").assign(z=0.8 * t + 0.1 * y).to_csv("two.csv", index=False)
    two = words.replace("falling_slope.py:line", "two_slopes.py:lines") + " z"
    assert main(["fit", "two.csv", *two.split(), "--save", "two.hs"]) == 0
    predict = ["predict", "two.hs", "new.csv", "--table", "predicted.csv", "--below"]
    assert main([*predict, "limit,1.5"]) == 0
    low, high = (pd.read_csv("predicted.csv")[[f"y_{end}", f"z_{end}"]] for end in ("low", "high"))
    assert low["y_low"][1] == 4.0
    assert low["y_low"][2] < 4  # the third row has no limit
    assert low["z_low"][0] == 1.5
    assert main([*predict, "limit"]) == 2
    assert "each of the outputs y, z" in capsys.readouterr().err
    assert main(["fit", "two.csv", *two.split(), "--below", "1,2"]) == 2
    assert "limits are of one output" in capsys.readouterr().err
    assert main(["predict", "fit.hs", "new.csv", "--below", "limitt"]) == 2
    assert "nor a column of new.csv" in capsys.readouterr().err
    assert main(["fit", "measured.csv", *words.split(), "--below", "limitt"]) == 2
    assert "neither a number nor a column" in capsys.readouterr().err
    frame.assign(limit=30.0).to_csv("measured.csv", index=False)
    assert main(["fit", "measured.csv", *words.split(), "--below", "limit"]) == 2
    assert "None of the 40 values lies between its limits" in capsys.readouterr().err
