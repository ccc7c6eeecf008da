"""The ablation of the search's numbers, on rows made by hand and on two cases."""

import ablation
import numpy as np
import pandas as pd
import pytest
from scorecard.run import Task, run_into

from hybridsurrogate.inference.evidence.settings import SETTINGS


def rows(found, seconds=1.0, elpd=0.0, kind="step"):
    n = len(found)
    return pd.DataFrame(
        {
            "kind": [kind] * n,
            "size": [2.0] * n,
            "rows": [40] * n,
            "seed": np.arange(n),
            "leader": found,
            "found": found,
            "credible": found,
            "elpd_averaged": np.full(n, elpd),
            "seconds": np.full(n, seconds),
        }
    )


def compared(usual, other):
    return ablation.compared(ablation.scores(usual), ablation.scores(other))


def test_a_number_that_changes_nothing_goes():
    found = compared(rows(["step", "ramp"] * 20), rows(["step", "ramp"] * 20, seconds=0.9))
    assert found["cases"] == 40
    assert found["right"] == found["elpd"] == 0
    assert found["time"] == pytest.approx(0.9)
    assert not found["earns its place"]


def test_names_that_are_lost_and_time_that_is_saved_count():
    usual = rows(["step"] * 40)
    lost = compared(usual, rows(["ramp"] * 10 + ["step"] * 30))
    assert lost["right"] == -0.25
    # of 40 differences, 10 of them -1: sqrt(0.25 * 0.75 / 39)
    assert lost["right error"] == pytest.approx(np.sqrt(0.25 * 0.75 / 39))
    assert lost["earns its place"]
    assert compared(usual, rows(["step"] * 40, seconds=1.2))["earns its place"]


def test_alarms_are_those_where_nothing_is_hidden():
    usual, other = rows(["none"] * 40, kind="none"), rows(["none", "step"] * 20, kind="none")
    found = compared(usual, other)
    assert found["alarm"] == 0.5
    assert np.isnan(found["right"])
    assert found["earns its place"]


def test_a_number_is_set_for_a_while_and_counts_stay_counts():
    assert ablation.value_of("n_sizes", 0.5) == 5
    assert ablation.value_of("n_sizes", 0.0) == 1
    usual = SETTINGS.max_behind
    with ablation.setting("max_behind", ablation.value_of("max_behind", 2.0)):
        assert SETTINGS.max_behind == 2 * usual
    assert SETTINGS.max_behind == usual


def test_rows_are_kept_and_a_stopped_run_goes_on(tmp_path, monkeypatch):
    made = []

    def of_some(path, todo, jobs=1):
        made.append(path.name)
        todo = todo[:1] if path.name == "usual.csv" else []
        return run_into(path, todo, jobs)

    monkeypatch.setattr(ablation, "run_into", of_some)
    ablation.measured(tmp_path, ["alternation_rounds"], [Task("none", 0.0, 12, 3)])
    assert made == [
        "usual.csv",
        "alternation_rounds=off.csv",
        "alternation_rounds=halved.csv",
        "alternation_rounds=doubled.csv",
    ]
    assert len(pd.read_csv(tmp_path / "usual.csv")) == 1
