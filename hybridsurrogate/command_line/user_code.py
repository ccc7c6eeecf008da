"""The user's Python file: a function in it, and what was saved with it."""

from __future__ import annotations

import ast
import importlib.util
import re
import sys
from collections.abc import Callable
from importlib.machinery import PathFinder
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple, TypeVar

from hybridsurrogate.arguments import check_readable
from hybridsurrogate.exceptions import did_you_mean
from hybridsurrogate.saved_file import about_saved, load

T = TypeVar("T")

_NAMED = re.compile(r"(.+\.py):(\w+)")


class UserFunction(NamedTuple):
    """A function and the absolute path of its file."""

    function: Callable[..., Any]
    file: str


def is_code(simulation: str) -> bool:
    """Return whether a simulation is named as a function of a Python file, or as such a file.

    Examples
    --------
    >>> is_code("model.py:decay"), is_code("model.py"), is_code("runs.csv")
    (True, True, False)
    """
    return simulation.endswith(".py") or _NAMED.fullmatch(simulation) is not None


def function_in(simulation: str) -> UserFunction:
    """Return the function that ``model.py:function`` names, its file executed.

    Parameters
    ----------
    simulation : str

    Raises
    ------
    ValueError
        Where the file has no such function, is not Python, or fails.
    OSError
        Where there is no such file.

    Examples
    --------
    >>> _ = Path("halving.py").write_text("def decay(t): return 2.0 ** -t")
    >>> function_in("halving.py:decay").function(1)
    0.5
    """
    match = _NAMED.fullmatch(simulation)
    path, name = match.groups() if match else (simulation, "")
    file = check_readable(path)
    known = _names_in(file)
    if name not in known:
        has = f"it has {', '.join(known)}" if known else "it has none"
        what = f"{path} has no function {name!r}" if name else f"{path}: name its function"
        raise ValueError(
            f"{what}, {has}: write {path}:FUNCTION.{did_you_mean(name, known) if name else ''}"
        )
    function = getattr(module_of(file), name, None)
    if not callable(function):
        raise ValueError(f"{name!r} of {path} is no function.")
    return UserFunction(function, str(file.resolve()))


def module_of(file: Path) -> ModuleType:
    """Execute a Python file and return its module.

    It goes by the name of the file, as with ``python model.py`` its folder is on the path: other
    processes, and whoever loads what was saved, find the function by these.

    Parameters
    ----------
    file : Path

    Raises
    ------
    ValueError
        Where it fails, or another module has its name.
    """
    name, folder = file.stem, str(file.resolve().parent)
    found = PathFinder.find_spec(name)
    other = found is not None and Path(str(found.origin)).resolve() != file.resolve()
    if name in sys.stdlib_module_names or other:
        raise ValueError(f"{file} has the name of another Python module: rename it.")
    spec = importlib.util.spec_from_file_location(name, file.resolve())
    assert spec is not None  # it ends in .py
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    if folder not in sys.path:
        sys.path.insert(0, folder)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        raise ValueError(f"{file} fails: {type(error).__name__}: {error}.") from error
    return module


def read_saved(path: str, kind: type[T] | None = None) -> T:
    """Return what is in a saved file, the Python file of its simulation executed.

    Parameters
    ----------
    path : str
    kind : type or None
        What it must be; None: anything.

    Raises
    ------
    ValueError
        For another kind of file, another version, or a Python file that is gone.
    OSError
        Where there is no such file.
    """
    about = about_saved(path)
    if kind is not None and about["class"] != kind.__name__:
        raise ValueError(
            f"{path} holds a fitted {about['class']}, not a {kind.__name__}: diagnose with --save "
            "writes one."
        )
    code = about["code"]
    if code is not None:
        if not Path(code).is_file():
            raise ValueError(
                f"{path} needs the simulation in {code}, which is not there: put it back, or "
                "diagnose again."
            )
        print(f"The simulation in {code} is executed.", flush=True)
        module_of(Path(code))
    found: T = load(path)
    return found


def _names_in(file: Path) -> list[str]:
    """Return the functions and other names at the top of a Python file, which is not executed."""
    try:
        tree = ast.parse(file.read_text(encoding="utf-8"))
    except (SyntaxError, ValueError) as error:
        raise ValueError(f"{file} is not Python: {error}.") from error
    functions = [node.name for node in tree.body if isinstance(node, ast.FunctionDef)]
    assigned = [
        target.id
        for node in tree.body
        if isinstance(node, ast.Assign)
        for target in node.targets
        if isinstance(target, ast.Name)
    ]
    imported = [
        alias.asname or alias.name
        for node in tree.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    ]
    return [*functions, *assigned, *imported]
