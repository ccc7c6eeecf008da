"""The package as a house: small rooms, imports that point one way, no room's private names."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

import pytest

import hybridsurrogate

ROOT = Path(hybridsurrogate.__file__).parent
FILES = sorted(ROOT.rglob("*.py"))
MOST_FILES, MOST_LINES = 13, 60
# read from top to bottom, by file: wiring, the fields of a summary, a
# section's sentences, a constructor's arguments
LONG = {
    ("model.problem", "plain_problem"),
    ("diagnosis.report.summary", "summary"),
    ("ode.simulator", "__init__"),
}


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def module_of(path: Path) -> str:
    return ".".join([ROOT.name, *path.relative_to(ROOT).with_suffix("").parts])


ROOMS = {module_of(path).rpartition(".")[0] for path in FILES}


def room_of(module: str) -> str:
    """Return the folder of a module; a module at the top is a room of its own."""
    if module in ROOMS:
        return module
    parent = module.rpartition(".")[0]
    return module if parent == ROOT.name else parent


@cache
def imports_of(path: Path) -> list[tuple[str, ast.ImportFrom]]:
    """Return the imports from the package, each with the module it names.

    Relative ones, those of functions and those for type checkers alone are imports, too.
    """
    room = module_of(path).split(".")[:-1]
    out = []
    for node in ast.walk(parsed(path)):
        if not isinstance(node, ast.ImportFrom):
            continue
        above = room[: len(room) + 1 - node.level] if node.level else []
        module = ".".join([*above, *([node.module] if node.module else [])])
        if module.startswith(f"{ROOT.name}."):
            out.append((module, node))
    return out


def files_imported(path: Path) -> set[str]:
    """Return the modules that are files, not a room's face."""
    known = {module_of(path) for path in FILES}
    return {
        name
        for module, node in imports_of(path)
        for name in (module, *(f"{module}.{one.name}" for one in node.names))
        if name in known and name != module_of(path)
    }


def circle_among(edges: dict[str, set[str]]) -> dict[str, set[str]]:
    """Return what is left when all that points only outwards is taken away again and again."""
    left = dict(edges)
    while ends := {one for one in left if not left[one] & left.keys()}:
        left = {one: to for one, to in left.items() if one not in ends}
    return left


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
        there = {room_of(module) for module, _ in imports_of(path)}
        edges.setdefault(here, set()).update(there - {here})
    left = circle_among(edges)
    assert not left, f"a circle among {sorted(left)}"


def test_no_circle_among_files():
    edges = {module_of(path): files_imported(path) for path in FILES if path.stem != "__init__"}
    left = circle_among(edges)
    assert not left, f"a circle among {sorted(left)}"


@pytest.mark.parametrize("path", FILES, ids=module_of)
def test_no_private_names_of_another_file(path):
    for _, node in imports_of(path):
        assert not [name.name for name in node.names if name.name.startswith("_")]


@pytest.mark.parametrize("path", FILES, ids=module_of)
def test_functions_are_short(path):
    for node in ast.walk(parsed(path)):
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
