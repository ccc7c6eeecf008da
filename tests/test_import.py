"""What an import loads, and what it leaves until it is first used."""

import subprocess
import sys

import pytest

import hybridsurrogate as hs

LATER = ("emcee", "matplotlib", "arviz", "sklearn.linear_model", "hybridsurrogate.diagnosis")


def output_of(source: str) -> str:
    done = subprocess.run([sys.executable, "-c", source], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_what_a_fit_does_not_need_is_loaded_later_and_rooms_are_attributes():
    rooms = "datasets", "diagnosis", "plotting", "scoring"
    source = (
        "import hybridsurrogate as hs, sys\n"
        f"print(*({{*{LATER}}} & sys.modules.keys()), 'loaded')\n"
        f"print(*(getattr(hs, room).__name__ for room in {rooms}))"
    )
    loaded, found = output_of(source).splitlines()
    assert loaded == "loaded"
    assert found.split() == [f"hybridsurrogate.{room}" for room in rooms]


def test_all_that_is_listed_is_there():
    assert {*hs.__all__} <= {*dir(hs)}
    for name in hs.__all__:
        getattr(hs, name)
    unknown = "diagnoses"
    with pytest.raises(AttributeError, match="no attribute 'diagnoses'"):
        getattr(hs, unknown)
