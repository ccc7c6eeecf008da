"""A fitted diagnosis is stored and read again: pickle, joblib, skops."""

import io
import pickle

import joblib
import numpy as np
import pandas as pd
import pytest

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.stored import restored, stored
from hybridsurrogate.effects.registry import kinds


def line(t, slope):
    return slope * t


@pytest.fixture(scope="module")
def fitted():
    """Rows in a table, so that every kind of value is among what fit keeps."""
    random = np.random.default_rng(0)
    t = np.linspace(0, 4, 24)
    X = pd.DataFrame({"t": t, "humidity": random.uniform(0, 1, 24)})
    y = 2 * t + 1.5 + 0.3 * random.standard_normal(24)
    simulator = hs.Simulator(
        line, inputs={"t": (0, 4)}, parameters={"slope": hs.truncated_normal(2, 0.2, 1, 3)}
    )
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=100, random_state=0
    )
    # the fewer causes, the sooner skops has written them
    exclude = sorted({*kinds()} - {"offset", "trend"})
    diagnosis = hs.DiscrepancyDiagnosis(
        model, exclude=exclude, cv=2, n_replicates=50, random_state=0
    ).fit(X, y)
    diagnosis.update(X.iloc[:3], y[:3])
    return diagnosis, X


def by_pickle(diagnosis):
    return pickle.loads(pickle.dumps(diagnosis))


def by_joblib(diagnosis):
    file = io.BytesIO()
    joblib.dump(diagnosis, file)
    file.seek(0)
    return joblib.load(file)


def by_skops(diagnosis):
    skops = pytest.importorskip("skops.io", reason="skops is not installed")
    data = skops.dumps(diagnosis)
    names = skops.get_untrusted_types(data=data)
    # what a reader has to trust is this package, scipy's distributions and the user's simulation
    own = line.__module__
    assert all(name.split(".")[0] in ("hybridsurrogate", "scipy", own) for name in names)
    return skops.loads(data, trusted=names)


@pytest.mark.parametrize("way", [by_pickle, by_joblib, by_skops])
def test_what_is_read_is_what_was_stored(fitted, way):
    diagnosis, X = fitted
    again = way(diagnosis)
    pd.testing.assert_frame_equal(again.causes_, diagnosis.causes_)
    pd.testing.assert_frame_equal(again.confounded_, diagnosis.confounded_)
    pd.testing.assert_frame_equal(again.monitor_.table, diagnosis.monitor_.table)
    np.testing.assert_array_equal(again.predict(X), diagnosis.predict(X))
    assert again.verdict_ == diagnosis.verdict_
    assert str(again.gain_) == str(diagnosis.gain_)
    # methods go on from what was stored
    following = [one.next_measurements(2, places=X) for one in (again, diagnosis)]
    pd.testing.assert_frame_equal(*following)
    # what is shared stays shared
    assert again.result_.extension.beta_scans is again.beta_scans_
    assert again.result_.causes is again.causes_


def test_tables_keep_their_types():
    table = pd.DataFrame(
        {
            "name": ["a", None, "c"],
            "count": [1, 2, 3],
            "when": pd.to_datetime(["2020-01-01", "2020-01-02", "2020-01-03"]),
            "batch": pd.Categorical(["low", "high", "low"], ["low", "high"], ordered=True),
            "maybe": pd.array([1, None, 3], dtype="Int64"),
        },
        index=[3, 4, 5],
    )
    again = restored(stored({"a": (table, [table])}))
    pd.testing.assert_frame_equal(again["a"][0], table)
    assert again["a"][1][0] is again["a"][0]
    array = np.zeros(3)
    assert stored({"a": array})["a"] is array
