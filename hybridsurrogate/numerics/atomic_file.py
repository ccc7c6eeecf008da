"""Files that are written whole or not at all."""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from hybridsurrogate.arguments import local_path


def check_writable(path: str | os.PathLike[str]) -> None:
    """Raise OSError where no file of this name can be written, before it is computed.

    Parameters
    ----------
    path : str or path

    Raises
    ------
    TypeError, ValueError
        For an argument that is not a path, and for an address.
    """
    target = local_path(path)
    folder = Path(os.path.realpath(target)).parent
    if target.is_dir():
        raise IsADirectoryError(f"{str(target)!r} is a folder: name a file in it.")
    if not folder.is_dir():
        raise FileNotFoundError(
            f"{str(target)!r} cannot be written: the folder {str(folder)!r} does not exist. "
            "Make it first, or name another file."
        )
    # a device or a pipe is written to as it is, without a second file
    needed = [target] if _is_special(target) else [folder, *([target] if target.exists() else [])]
    if not all(os.access(place, os.W_OK) for place in needed):
        raise PermissionError(
            f"{str(target)!r} cannot be written: you may not write there. Name another file."
        )


@contextmanager
def written_whole(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a path to write to, which takes the place of ``path`` once all is written.

    Whatever stops the writing, ``path`` holds what it held before.

    Parameters
    ----------
    path : str or path

    Examples
    --------
    >>> from hybridsurrogate.numerics.atomic_file import written_whole
    >>> with written_whole("report.txt") as part:  # doctest: +SKIP
    ...     part.write_text("all of it")
    """
    check_writable(path)
    target = local_path(path)
    if _is_special(target):
        yield target
        return
    # a link goes on to point at the file; the ending stays last, as writers of pictures read it
    target = Path(os.path.realpath(target))
    part = target.with_name(f".{target.stem[:100]}-{secrets.token_hex(4)}{target.suffix}")
    try:
        yield part
        if target.exists():
            shutil.copymode(target, part)
        os.replace(part, target)
    except BaseException:
        with suppress(OSError):
            part.unlink()
        raise


def _is_special(path: Path) -> bool:
    return path.exists() and not path.is_file()
