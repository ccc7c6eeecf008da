"""The package as a house: small rooms, imports that point one way, no room's private names."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import hybridsurrogate

ROOT = Path(hybridsurrogate.__file__).parent
FILES = sorted(ROOT.rglob("*.py"))
MOST_FILES, MOST_LINES = 13, 60
# read from top to bottom, by file: wiring, the fields of a summary, a
# section's sentences, a constructor's arguments
LONG = {
    ("problem.problem", "make_problem"),
    ("diagnosis.report.summary", "summary"),
    ("diagnosis.report.findings", "where"),
    ("ode.simulator", "__init__"),
}


def module_of(path: Path) -> str:
    return ".".join([ROOT.name, *path.relative_to(ROOT).with_suffix("").parts])


ROOMS = {module_of(path).rpartition(".")[0] for path in FILES}


def room_of(module: str) -> str:
    """Return the folder of a module; a module at the top is a room of its own."""
    if module in ROOMS:
        return module
    parent = module.rpartition(".")[0]
    return module if parent == ROOT.name else parent


def imports_of(path: Path) -> list[ast.ImportFrom]:
    """Return the imports from the package that are made at run time."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    typing_only = {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and getattr(node.test, "id", "") == "TYPE_CHECKING"
        for inner in ast.walk(node)
    }
    return [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom)
        and (node.module or "").startswith(f"{ROOT.name}.")
        and id(node) not in typing_only
    ]


@pytest.mark.parametrize("room", sorted(ROOMS))
def test_rooms_are_small(room):
    files = [path for path in FILES if module_of(path).rpartition(".")[0] == room]
    assert len([path for path in files if path.stem != "__init__"]) <= MOST_FILES


def test_imports_point_one_way():
    edges: dict[str, set[str]] = {}
    for path in FILES:
        if path.stem == "__init__":  # a room's face shows what lies in it
            continue
        here = room_of(module_of(path))
        there = {room_of(str(node.module)) for node in imports_of(path)}
        edges.setdefault(here, set()).update(there - {here})
    left = dict(edges)
    while True:
        ends = {room for room in left if not left[room] & left.keys()}
        if not ends:
            break
        left = {room: to for room, to in left.items() if room not in ends}
    assert not left, f"a circle among {sorted(left)}"


@pytest.mark.parametrize("path", FILES, ids=module_of)
def test_no_private_names_of_another_file(path):
    for node in imports_of(path):
        assert not [name.name for name in node.names if name.name.startswith("_")]


@pytest.mark.parametrize("path", FILES, ids=module_of)
def test_functions_are_short(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.FunctionDef):
            continue
        if (module_of(path).removeprefix(f"{ROOT.name}."), node.name) in LONG:
            continue
        described = ast.get_docstring(node, clean=False) is not None
        first = node.body[1 if described and len(node.body) > 1 else 0].lineno
        assert (node.end_lineno or first) - first + 1 <= MOST_LINES, node.name


@pytest.mark.parametrize("room", sorted(ROOMS))
def test_each_room_says_what_is_in_it(room):
    folder = ROOT.joinpath(*room.split(".")[1:])
    assert ast.get_docstring(ast.parse((folder / "__init__.py").read_text(encoding="utf-8")))
