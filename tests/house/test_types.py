"""What type checkers and editors know of the package: they read lists, and run no registry."""

import ast
import os
import runpy
import subprocess
import sys
from importlib import import_module
from importlib.util import find_spec
from inspect import ismodule
from pathlib import Path

import pytest

import hybridsurrogate as hs
from hybridsurrogate import (
    datasets,
    estimators,
    likelihoods,
    plotting,
    scoring,
    surrogates,
)

ROOT = Path(hs.__file__).parent
SCRIPT = Path(__file__).parents[1] / "typing" / "user_script.py"
REGISTERED = {
    likelihoods: {type(one).__name__ for one in likelihoods.LIKELIHOODS.values()},
    surrogates: {type(one).__name__ for one in surrogates.SURROGATES.values()},
}
ROOMS = (hs, datasets, estimators, likelihoods, plotting, scoring, surrogates)


def names_in(room):
    """Return the names that a room imports or defines, and those it lists, as its text says."""
    tree = ast.parse(Path(room.__file__).read_text(encoding="utf-8"))
    known, listed = set(), set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            known |= {name.asname or name.name for name in node.names}
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            known.add(node.name)
    for node in tree.body:
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "__all__":
            listed = set(ast.literal_eval(node.value))
    return known, listed


def test_the_package_says_that_it_is_typed():
    assert (ROOT / "py.typed").is_file()


@pytest.mark.parametrize("room", ROOMS[1:], ids=lambda room: room.__name__)
def test_what_registries_add_is_written_down(room):
    known, listed = names_in(room)
    assert REGISTERED.get(room, set()) - listed == set()
    assert set(room.__all__) - listed == set()
    assert listed - known == set()


def test_the_package_has_what_a_type_checker_sees():
    """To it what is imported as itself is public; when it runs, a table and registries decide."""
    seen = {
        one.asname: getattr(import_module(node.module), one.name)
        for node in ast.walk(ast.parse(Path(hs.__file__).read_text(encoding="utf-8")))
        for one in getattr(node, "names", ())
        if isinstance(node, ast.ImportFrom) and one.asname
    }
    assert [name for name, one in seen.items() if getattr(hs, name) is not one] == []
    assert sorted(name for name, one in seen.items() if not ismodule(one)) == sorted(hs.__all__)


def test_the_users_script_takes_every_public_name():
    taken = {room: set() for room in ROOMS}
    alias = {room.__name__.rpartition(".")[2]: room for room in ROOMS} | {"hs": hs}
    for node in ast.walk(ast.parse(SCRIPT.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            taken.get(alias.get(node.value.id), set()).add(node.attr)
    for room in ROOMS:
        own = set(room.__all__) - (set() if room is hs else set(hs.__all__))
        assert own - taken[room] == set(), room.__name__


def test_the_users_script_runs():
    assert "trend" in runpy.run_path(str(SCRIPT))["kinds"]


def checked(script, tmp_path):
    """Return what ``mypy --strict`` says of a script, as it would of one that uses the package."""
    return subprocess.run(
        [
            *(
                sys.executable,
                "-m",
                "mypy",
                "--strict",
                "--config-file=",
                "--follow-imports=silent",
            ),
            *("--cache-dir", str(tmp_path / "cache"), str(script)),
        ],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "MYPYPATH": str(ROOT.parent)},
    )


@pytest.mark.slow
def test_mypy_accepts_the_users_script_and_sees_its_mistakes(tmp_path):
    if find_spec("mypy") is None:
        pytest.skip("mypy is not installed (extra `test`)")
    result = checked(SCRIPT, tmp_path)
    assert result.returncode == 0, result.stdout
    wrong = tmp_path / "wrong.py"
    wrong.write_text(
        "import hybridsurrogate as hs\n"
        "hs.Step(3)\n"
        "hs.NoiseAtLevel('batch', levl=1.0)\n"
        "x: int = hs.LogNormal()\n"
        "hs.PowerScaledSurrogate(degree=2)\n"
        "hs.Stepp\n"
    )
    lines = [line for line in checked(wrong, tmp_path).stdout.splitlines() if "error:" in line]
    assert [int(line.split(":")[1]) for line in lines] == [2, 3, 4, 5, 6]
