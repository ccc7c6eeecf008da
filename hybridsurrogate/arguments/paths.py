"""Files to read and to write: no addresses, no folders."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from hybridsurrogate.arguments.description import described


def is_address(path: Any) -> bool:
    """Return whether a path is an address such as https://... or s3://..., and no file.

    Examples
    --------
    >>> is_address("s3://bucket/runs.csv"), is_address("runs.csv"), is_address("C:/runs.csv")
    (True, False, False)
    """
    return isinstance(path, str) and "://" in path


def local_path(path: Any, name: str = "path", cure: str = "") -> Path:
    """Return a path of this machine, with ``~`` as the home; raise for anything else.

    Parameters
    ----------
    path : str or path
    name : str
        What to call it in an error.
    cure : str
        What to do instead of giving an address.

    Raises
    ------
    TypeError, ValueError
        For an argument that is neither text nor a path; for an address, an empty text or one with a
        null character.
    """
    try:
        text = os.fspath(path)
    except TypeError:
        text = None
    if not isinstance(text, str):
        raise TypeError(f"{name} must be text or a pathlib.Path, got {described(path)}.")
    if not text or "\0" in text:
        raise ValueError(f"{name} must name a file or a folder, got {text!r}.")
    if is_address(text):
        raise ValueError(
            f"{name} must be on this machine, got the address {text!r}.{cure and ' '}{cure}"
        )
    try:
        return Path(text).expanduser()
    except RuntimeError:  # the home of nobody
        return Path(text)


def check_readable(path: Any, name: str = "path") -> Path:
    """Return the path of a file that is there; raise where there is none, before it is opened.

    Raises
    ------
    FileNotFoundError, IsADirectoryError, PermissionError
        All of them OSError.
    TypeError, ValueError
        As `local_path`.
    """
    cure = "Fetch it first, or, where you trust it, read_simulation(..., allow_urls=True)."
    file = local_path(path, name, cure)
    if file.is_dir():
        raise IsADirectoryError(f"{str(file)!r} is a folder: name a file in it.")
    if not file.exists():
        folder = file.parent
        there = f"there is no such file in {str(folder)!r}"
        if not folder.is_dir():
            there = f"the folder {str(folder)!r} does not exist"
        raise FileNotFoundError(f"{str(file)!r} cannot be read: {there}.")
    if not os.access(file, os.R_OK):
        raise PermissionError(f"{str(file)!r} cannot be read: you may not read it.")
    return file
