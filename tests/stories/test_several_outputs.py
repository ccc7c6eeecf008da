"""A scientist with two instruments: the command line."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import hybridsurrogate as hs
from hybridsurrogate.command_line.main import main


@pytest.mark.slow
def test_the_command_line_takes_several_outputs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    random = np.random.default_rng(1)
    times = np.linspace(0, 10, 25)
    points = random.uniform([1, 0.1], [3, 0.5], (30, 2))
    level = points[:, :1] * np.exp(-points[:, 1:] * times)
    flow = 50 * points[:, 1:] * level
    runs = pd.DataFrame(
        {
            "run": np.repeat(np.arange(30), 25),
            "t": np.tile(times, 30),
            "a": np.repeat(points[:, 0], 25),
            "k": np.repeat(points[:, 1], 25),
            "level": level.ravel(),
            "flow": flow.ravel(),
        }
    )
    runs.to_csv("runs.csv", index=False)
    t = np.sort(random.uniform(0, 10, 40))
    measured = pd.DataFrame({"t": t, "level": 2 * np.exp(-0.25 * t)})
    measured["flow"] = 12.5 * measured["level"] + 1.5 * (t > 5) + 0.3 * random.normal(size=40)
    measured["level"] += 0.03 * random.normal(size=40)
    measured.loc[::5, "flow"] = np.nan
    measured.to_csv("measured.csv", index=False)
    given = ["diagnose", "measured.csv", "--simulation", "runs.csv", "--inputs", "t"]
    given += ["--parameters", "a", "k", "--output", "level", "flow", "--json", "report.json"]
    given += ["--jobs", "1"]
    assert main(given) == 0
    told = json.loads(Path("report.json").read_text(encoding="utf-8"))
    assert told["best_cause"]["kind"] == "step"
    assert told["best_cause"]["target"] == "flow: t"
    assert told["output"] == "flow"
    assert Path("report.html").exists()
    assert hs.read_simulation("runs.csv", ["t"], output=("level", "flow")).outputs == (
        "level",
        "flow",
    )
