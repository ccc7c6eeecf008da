"""Numbers that studies computed: they can be traced, and are written as they are read."""

import json
import subprocess
from datetime import date
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import sure_names

from hybridsurrogate.studied import STUDIED

ROOT = Path(__file__).parents[1]
# where a change may move what studies count
SEARCHED = ("hybridsurrogate/diagnosis/search", "hybridsurrogate/inference/evidence")


def test_each_number_says_which_commit_computed_it_and_when():
    for found in STUDIED.values():
        assert {"study", "commit", "date"} <= {*found}
        date.fromisoformat(found["date"])


def test_the_study_writes_what_the_package_reads(tmp_path):
    rng = np.random.default_rng(0)
    X = pd.DataFrame({"odds": rng.normal(size=400), "structure": rng.integers(0, 2, 400)})
    X["several"] = rng.integers(0, 2, 400)
    right = rng.uniform(size=400) < 1 / (1 + np.exp(0.5 - 2 * X["odds"] + X["structure"]))
    model = sure_names.regression(X, right.to_numpy(), np.ones(400))
    path = tmp_path / "studied.json"
    path.write_text(json.dumps(STUDIED), encoding="utf-8")
    if subprocess.run(["git", "rev-parse"], cwd=ROOT, capture_output=True).returncode:
        pytest.skip("the commit is not known outside of a git checkout")
    sure_names.written(path, model, 400)
    found = json.loads(path.read_text(encoding="utf-8"))
    assert found["remainder"] == STUDIED["remainder"]
    own = found["probability_right"]
    assert own["n_cases"] == 400
    names = ("one", "odds", "structure", "several")
    np.testing.assert_allclose([own[k] for k in names], [-0.5, 2, -1, 0], atol=1.0)
    assert {*own} == {*STUDIED["probability_right"]}


@pytest.mark.parametrize("name", STUDIED)
def test_numbers_are_as_new_as_the_search(name):
    command = ["git", "log", "-1", "--format=%cs", "--", *SEARCHED]
    said = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    changed = said.stdout.strip()
    if not changed:
        pytest.skip("when the search changed is not known outside of a git checkout")
    # on fresh cases of a later search a refit may gain nothing
    known = STUDIED[name]
    if max(known["date"], known.get("checked", "")) < changed:
        pytest.skip(f"{STUDIED[name]['study']} is older than the search: {changed}")
