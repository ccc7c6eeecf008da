"""Columns of text, such as a batch or an operator, are labels."""

import numpy as np
import pandas as pd
import pytest
from few_kinds import all_but
from scipy.stats import norm, uniform

import hybridsurrogate as hs

NAMES = ["Ester", "Acid", "Base", "Ether"]
KINDS = all_but("missing-input", "trend", "gain", "noise")


def fall(t, start, rate):
    return start * np.exp(-rate * t)


SIMULATOR = hs.Simulator(
    fall, inputs={"t": (0, 10)}, parameters={"start": norm(3, 0.5), "rate": uniform(0.05, 0.5)}
)


def rows(seed, amount=0.0, names=NAMES):
    """Measure 12 rows of each batch, one of which has an amount added."""
    random = np.random.default_rng(seed)
    batch = np.repeat(names, 12)
    t = random.uniform(0, 10, len(batch))
    y = fall(t, 3.2, 0.2) + amount * (batch == names[-1])
    return pd.DataFrame({"t": t, "batch": batch}), y + 0.1 * random.standard_normal(len(t))


def diagnose(X, y, **settings):
    model = hs.PowerScaledSurrogate(SIMULATOR, hs.ExactSurrogate(), n_draws=200, random_state=0)
    settings = {"cv": None, "exclude": KINDS, "n_replicates": 50, **settings}
    return hs.DiscrepancyDiagnosis(model, random_state=0, **settings).fit(X, y)


def test_the_batch_that_is_off_is_named_by_its_name(tmp_path):
    X, y = rows(0, 0.5)
    found = diagnose(X, y)
    assert found.verdict_ == "named"
    assert found.best_cause_.formula.endswith("where batch = Ether")
    _, low, high = found.best_cause_.estimates["amplitude"]
    assert low < 0.5 < high
    report = found.report()
    assert report.headline.endswith("above the simulation where batch is Ether.")
    lower = found.plot()[-1]
    assert [tick.get_text() for tick in lower.get_xticklabels()] == sorted(NAMES)
    assert found.next_measurement_["batch"] in NAMES
    assert set(found.next_measurements(3)["batch"]) <= {*NAMES}
    # predictions go by name, and a batch that was not measured is as simulated
    new = pd.DataFrame({"t": [2.0, 2.0, 2.0], "batch": ["Ether", "Base", "Ketone"]})
    there = found.predict(new)
    assert there[0] - there[1] == pytest.approx(0.5, abs=0.15)
    assert there[2] == pytest.approx(there[1])
    found.to_python(tmp_path / "extended.py")
    scope = {}
    exec((tmp_path / "extended.py").read_text(encoding="utf-8"), scope)
    np.testing.assert_allclose(scope["extended"](fall, new.t, new.batch), there, atol=0.02)


def test_names_are_as_good_as_numbers():
    X, y = rows(1, 0.3)
    numbered = X.assign(batch=X.batch.map({name: k for k, name in enumerate(sorted(NAMES))}))
    by_name, by_number = diagnose(X, y).causes_, diagnose(numbered, y).causes_
    assert by_name.target.equals(by_number.target)
    np.testing.assert_allclose(by_name.probability, by_number.probability, atol=1e-6)


def test_folds_keep_the_names():
    # in some fold a batch of four rows has too few
    X, y = rows(2, 0.5)
    rare = np.flatnonzero(X.batch == "Acid")[:8]
    gain = diagnose(X.drop(index=rare), np.delete(y, rare), cv=6).gain_
    assert gain.kinds.count("missing-input") == 6
    assert gain.elpd_difference > 3 * gain.standard_error


@pytest.mark.usefixtures("verdict_alone")
def test_with_two_names_and_where_nothing_is_wrong():
    X, y = rows(3, 0.5, ["control", "treated"])
    assert diagnose(X, y).best_cause_.formula.endswith("where batch = treated")
    quiet = [diagnose(*rows(seed)).verdict_ == "adequate" for seed in range(10, 15)]
    assert sum(quiet) >= 4


def test_names_of_single_rows_are_left_out():
    X, y = rows(4, 0.5)
    with_notes = X.assign(note=[f"row {k}" for k in range(len(X))])
    with pytest.warns(hs.DiagnosisWarning, match="'note' is left out: its names, such as 'row 0'"):
        found = diagnose(with_notes, y)
    plain = diagnose(X, y)
    np.testing.assert_array_equal(found.causes_.probability, plain.causes_.probability)
    np.testing.assert_array_equal(found.predict(with_notes), found.predict(X))


def test_a_name_that_is_missing_is_a_name():
    X, y = rows(5, 0.5)
    X["batch"] = X.batch.where(X.batch != "Ether")
    assert diagnose(X, y).best_cause_.formula.endswith("where batch = missing")


def test_causes_of_a_user_go_by_name():
    X, y = rows(6, 0.5)
    settings = {"surrogate": hs.ExactSurrogate(), "n_draws": 200, "random_state": 0}
    for effect in (
        hs.MissingInput("batch", shape="categorical", level="Ether"),
        hs.NoiseAtLevel("batch", "Ether"),
    ):
        model = hs.PowerScaledSurrogate(SIMULATOR, effects=[effect], **settings).fit(X, y)
        assert "batch = Ether" in model.posterior_.model.effects[0].name
    wrong = hs.MissingInput("batch", shape="categorical", level="Ethr")
    with pytest.raises(ValueError, match=r"'batch' is never 'Ethr'; it is \['Acid', 'Base'"):
        hs.PowerScaledSurrogate(SIMULATOR, effects=[wrong], **settings).fit(X, y)
