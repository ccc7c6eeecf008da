"""A study file: options in TOML, in place of many words on the command line."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from hybridsurrogate.arguments.description import described
from hybridsurrogate.arguments.paths import check_readable, is_address
from hybridsurrogate.command_line.options import Option
from hybridsurrogate.exceptions import did_you_mean


def read_study(path: str, options: Iterable[Option]) -> dict[str, Any]:
    """Return the options in a TOML file, files in it relative to its folder.

    Parameters
    ----------
    path : str
    options : iterable of Option
        All that may be in it; whoever reads it takes those that it knows.

    Raises
    ------
    ValueError
        For what is no TOML, an unknown key, or a value of another kind than the option takes.
    OSError
        Where there is no such file.

    Examples
    --------
    >>> from pathlib import Path
    >>> from hybridsurrogate.command_line.options import SEED
    >>> _ = Path("study.toml").write_text("sead = 3")
    >>> read_study("study.toml", [SEED])
    Traceback (most recent call last):
    ...
    ValueError: study.toml has an unknown key 'sead'. Did you mean 'seed'?
    """
    file = check_readable(path)
    try:
        table = tomllib.loads(file.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} is no TOML: {error}.") from error
    known = {one.name: one for one in options if one.in_file}
    for key in table:
        if key not in known:
            meant = did_you_mean(key, known) or f" The keys are {', '.join(sorted(known))}."
            raise ValueError(f"{path} has an unknown key {key!r}.{meant}")
    return {key: _value(known[key], value, path, file.parent) for key, value in table.items()}


def _value(option: Option, value: Any, path: str, folder: Path) -> Any:
    wanted, converted = _CONVERTED[option.kind](value)
    if converted is None:
        raise ValueError(f"{path}: {option.name} must be {wanted}, got {described(value)}.")
    if option.choices and converted not in option.choices:
        raise ValueError(
            f"{path}: {option.name} must be one of {', '.join(option.choices)}, got {value!r}."
            f"{did_you_mean(value, option.choices)}"
        )
    if option.kind == "path":
        return _in_folder(value, folder)
    return [_in_folder(one, folder) for one in converted] if option.kind == "paths" else converted


def _in_folder(file: str, folder: Path) -> str:
    return file if file == "-" or is_address(file) else str(folder / Path(file).expanduser())


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _text(value: Any) -> tuple[str, Any]:
    return "text", value if isinstance(value, str) else None


def _names(value: Any) -> tuple[str, Any]:
    names = [value] if isinstance(value, str) else value
    right = isinstance(names, list) and all(isinstance(name, str) for name in names)
    return 'a list of names, such as ["t"]', names if right else None


def _limit(value: Any) -> tuple[str, Any]:
    right = isinstance(value, str) or _is_number(value)
    return "a number or a column", str(value) if right else None


def _number(value: Any) -> tuple[str, Any]:
    return "a number", float(value) if _is_number(value) else None


def _numbers(value: Any) -> tuple[str, Any]:
    right = isinstance(value, list) and all(map(_is_number, value))
    return "a list of numbers", list(map(float, value)) if right else None


def _whole(value: Any) -> tuple[str, Any]:
    right = isinstance(value, int) and not isinstance(value, bool)
    return "a whole number", value if right else None


def _yes(value: Any) -> tuple[str, Any]:
    return "true or false", value if isinstance(value, bool) else None


def _pairs(value: Any) -> tuple[str, Any]:
    wanted = "a table of names, such as {speed = [2, 0.5]}"
    if not isinstance(value, dict):
        return wanted, None
    out = []
    for name, one in value.items():
        cells = one if isinstance(one, list) else [one]
        if not all(isinstance(cell, str) or _is_number(cell) for cell in cells):
            return wanted, None
        out.append(f"{name}={','.join(map(str, cells))}")
    return wanted, out


_CONVERTED = {
    "text": _text,
    "path": _text,
    "paths": _names,
    "names": _names,
    "limit": _limit,
    "number": _number,
    "numbers": _numbers,
    "whole": _whole,
    "yes": _yes,
    "pairs": _pairs,
}
