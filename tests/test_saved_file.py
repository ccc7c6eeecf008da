"""What is saved is read again, by the version that wrote it alone."""

import json
import pickle
import subprocess
import sys

import numpy as np
import pytest

import hybridsurrogate as hs
from hybridsurrogate.saved_file import about_saved


def test_a_fit_is_read_as_it_was_saved(fitted, measured, tmp_path):
    hs.save(fitted, tmp_path / "fall.hs", code="/models/fall.py")
    about = about_saved(tmp_path / "fall.hs")
    assert (about["class"], about["code"]) == ("PowerScaledSurrogate", "/models/fall.py")
    assert about["hybridsurrogate"] == hs.__version__
    again = hs.load(tmp_path / "fall.hs")
    np.testing.assert_array_equal(again.predict(measured[0]), fitted.predict(measured[0]))


def test_another_version_is_refused_before_anything_is_unpickled(fitted, tmp_path, monkeypatch):
    path = tmp_path / "fall.hs"
    hs.save(fitted, path)
    first, head, rest = path.read_bytes().split(b"\n", 2)
    about = json.loads(head) | {"hybridsurrogate": "0.0.1"}
    path.write_bytes(b"\n".join([first, json.dumps(about).encode(), rest]))
    monkeypatch.setattr(pickle, "load", None)
    with pytest.raises(
        ValueError, match=r"saved by hybridsurrogate 0\.0\.1, and this is .*fit again"
    ):
        hs.load(path)


def test_a_damaged_file(fitted, tmp_path):
    path = tmp_path / "fall.hs"
    hs.save(fitted, path)
    path.write_bytes(path.read_bytes()[:-2000])
    with pytest.raises(ValueError, match=r"cannot be loaded: .* Fit again and save it anew"):
        hs.load(path)


@pytest.mark.parametrize("content", [b"", b"t,y\n0,1\n", b"hybridsurrogate saved file\nno json\n"])
def test_a_file_of_another_kind(content, tmp_path):
    path = tmp_path / "other.hs"
    path.write_bytes(content)
    with pytest.raises(ValueError, match="is no saved fit or diagnosis"):
        hs.load(path)


def test_nothing_is_overwritten_where_a_fit_cannot_be_saved(fitted, tmp_path):
    with pytest.raises(FileNotFoundError, match="does not exist"):
        hs.save(fitted, tmp_path / "missing" / "fall.hs")
    path = tmp_path / "fall.hs"
    path.write_text("older")
    with pytest.raises(pickle.PicklingError):
        hs.save(hs.Simulator(lambda t: t, {"t": (0, 1)}), path)
    assert path.read_text() == "older"


def test_a_function_of_a_script_is_pointed_out(tmp_path):
    """Of __main__: another script would not find it."""
    script = tmp_path / "script.py"
    script.write_text(
        """
import warnings
import numpy as np, hybridsurrogate as hs

def line(t, k):
    return k * t

simulator = hs.Simulator(line, {"t": (0, 1)}, {"k": hs.truncated_normal(1, 0.5, 0, 2)})
t = np.linspace(0, 1, 12)
model = hs.PowerScaledSurrogate(simulator, surrogate=hs.ExactSurrogate(), random_state=0)
model.fit(t[:, None], t + 0.1 * np.cos(9 * t))
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    hs.save(model, "line.hs")
print([str(one.message) for one in caught])
"""
    )
    run = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, check=True, cwd=tmp_path
    )
    assert "The function 'line' is defined in this script or notebook" in run.stdout
