"""How sure a name is: the cases behind the numbers, and their weights."""

import numpy as np
import pandas as pd
import pytest
import sure_names
from hidden_effects.several import make_several


def test_each_sort_of_case_has_the_share_of_measured_data():
    table = pd.DataFrame(
        {
            "kind": ["step"] * 6 + ["trend+step"] * 2,
            "outside": [True, False, False, False, False, False, True, False],
            "right": False,
        }
    )
    weight = sure_names.weights(table) / len(table)
    # 7 of 16 documented causes were not in the catalogue, 5 of 16 left structure
    assert weight[0] == pytest.approx(7 / 16 * 11 / 16)
    assert weight[1:6].sum() == pytest.approx(9 / 16 * 11 / 16)
    assert weight[6] == pytest.approx(7 / 16 * 5 / 16)
    assert weight.sum() == pytest.approx(1)


def test_a_stopped_run_goes_on(tmp_path, monkeypatch):
    asked = []

    def diagnosed(task):
        asked.append(task)
        return {"verdict": "named", "share": 0.9, "several": False, "right": True, "told": 0.5}

    monkeypatch.setattr(sure_names, "diagnosed", diagnosed)
    path = tmp_path / "rows.jsonl"
    table = sure_names.rows_of(path, 0, 1)
    n = len(asked)
    assert len(table) == n > 100
    text = path.read_text()
    path.write_text("\n".join(text.splitlines()[:10]) + "\n" + text.splitlines()[10][:20] + "\n")
    assert len(sure_names.rows_of(path, 0, 1)) == n
    assert len(asked) == 2 * n - 10


def test_features_that_say_something_gain():
    rng = np.random.default_rng(0)
    table = pd.DataFrame(
        {
            "share": rng.uniform(0.1, 0.99, 400),
            "verdict": rng.choice(["named", "nearest"], 400),
            "several": False,
        }
    )
    X = sure_names.described(table)
    right = rng.uniform(size=400) < 1 / (1 + np.exp(-X["odds"] + X["structure"]))
    weight = np.ones(400)
    whole = sure_names.losses(X, right.to_numpy(), weight).mean()
    without = sure_names.losses(X.drop(columns="odds"), right.to_numpy(), weight).mean()
    assert without > whole + 0.1


def test_a_further_fault_is_smaller():
    case = make_several("trend+periodic", 4.0, 0, 80, smaller=0.4)
    whole = make_several("trend+periodic", 4.0, 0, 80)
    one = case.truth["noise_sd"] == whole.truth["noise_sd"]
    assert one  # the same first effect
    left, more = (np.sqrt(np.mean(each.truth["left"] ** 2)) for each in (case, whole))
    assert case.truth["noise_sd"] * 4 * 0.9 < left < more
