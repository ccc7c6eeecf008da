"""What an import loads, and what it leaves until it is first used."""

import subprocess
import sys
from pathlib import Path

import pytest

import hybridsurrogate as hs

ROOMS = "datasets", "diagnosis", "plotting", "scoring"
# a fit and a diagnosis need none of these
LATER = ("emcee", "matplotlib", "arviz", "sklearn.linear_model", "sklearn.neural_network")
MISSPELT = "diagnoses"


def output_of(source: str) -> str:
    done = subprocess.run([sys.executable, "-c", source], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


# what is used, one after the other, and what none of it has loaded by then; numpy stands for all
# that needs it, which scipy, scikit-learn and pandas do
STAGES = {
    "import hybridsurrogate as hs": ("numpy", "hybridsurrogate.exceptions"),
    "from hybridsurrogate.command_line.main import make_parser; make_parser([])": ("numpy",),
    "hs.SolverWarning": ("numpy",),
    "hs.Simulator": ("hybridsurrogate.estimators",),
    "hs.PowerScaledSurrogate": (*LATER, "sklearn.metrics", "hybridsurrogate.diagnosis"),
    "hs.DiscrepancyDiagnosis": LATER,
}


def test_what_is_not_needed_is_loaded_later():
    lines = ["import sys"]
    for stage, later in STAGES.items():
        lines += [stage, f"print({stage!r}, 'loads', *({{*{later}}} & sys.modules.keys()))"]
    assert output_of("\n".join(lines)).splitlines() == [f"{stage} loads" for stage in STAGES]


@pytest.mark.slow
def test_any_room_may_be_imported_first():
    """Which one a user's first name imports first is open: no room needs another before it."""
    root = Path(hs.__file__).parent
    folders = [path.parent.relative_to(root).parts for path in root.rglob("__init__.py")]
    names = [".".join([root.name, *parts]) for parts in folders]
    source = (
        "import sys\nfrom importlib import import_module\n"
        f"for name in {names}:\n"
        "    for known in [one for one in sys.modules if one.startswith('hybridsurrogate')]:\n"
        "        del sys.modules[known]\n"
        "    import_module(name)\nprint(name)"
    )
    assert output_of(source) == names[-1]


def test_rooms_are_attributes():
    assert [getattr(hs, room).__name__ for room in ROOMS] == [f"{hs.__name__}.{o}" for o in ROOMS]


def test_a_star_imports_all_that_is_listed():
    taken = {}
    exec("from hybridsurrogate import *", taken)
    assert {*hs.__all__} == taken.keys() - {"__builtins__"}


def test_all_that_is_listed_is_there():
    assert {*hs.__all__, *ROOMS} <= {*dir(hs)}
    for name in hs.__all__:
        getattr(hs, name)
    with pytest.raises(AttributeError, match="no attribute 'diagnoses'") as raised:
        getattr(hs, MISSPELT)
    # of these Python takes what it suggests
    assert (raised.value.name, raised.value.obj) == (MISSPELT, hs)
    with pytest.raises(ImportError, match="cannot import name 'diagnoses'"):
        from hybridsurrogate import diagnoses  # noqa: F401
