"""Fitted estimators and diagnoses in a file, with the version that wrote it."""

from __future__ import annotations

import gzip
import json
import os
import pickle
import platform
import warnings
from contextlib import suppress
from typing import Any

import numpy as np
import sklearn

import hybridsurrogate
from hybridsurrogate.arguments import check_readable
from hybridsurrogate.exceptions import HybridSurrogateWarning
from hybridsurrogate.numerics.atomic_file import check_writable, written_whole

_FIRST = b"hybridsurrogate saved file\n"
# of the first two lines: what a file of another kind may have instead of a line break
_MAX_LINE = 100_000


def save(fitted: Any, path: str | os.PathLike[str], code: str | None = None) -> None:
    """Write a fitted estimator or diagnosis to a file, which `load` reads.

    Parameters
    ----------
    fitted : estimator or DiscrepancyDiagnosis
    path : str or path
        The file is whole or, where writing fails, what it was before.
    code : str or None, default=None
        The Python file with the simulation's function, for whoever reads the file.

    Raises
    ------
    OSError
        Where no such file can be written.
    pickle.PicklingError
        For a simulation that is a lambda, or a function inside another one.

    Examples
    --------
    >>> import hybridsurrogate as hs
    >>> from hybridsurrogate.datasets import make_log_sin
    >>> case = make_log_sin(random_state=0)
    >>> model = hs.PowerScaledSurrogate(case.simulation, random_state=0).fit(case.X, case.y)
    >>> hs.save(model, "case.hs")
    >>> hs.load("case.hs").predict(case.X_in).shape
    (100,)
    """
    check_writable(path)
    _warn_of_main(fitted)
    about = {**_versions(), "class": type(fitted).__name__, "code": code}
    with written_whole(path) as part, part.open("wb") as file:
        file.write(_FIRST + json.dumps(about).encode() + b"\n")
        with gzip.open(file, "wb", compresslevel=1) as packed:
            pickle.dump(fitted, packed, protocol=5)


def _warn_of_main(fitted: Any) -> None:
    """Warn where the simulation's function can be found by this script or notebook alone."""
    model = getattr(fitted, "estimator_", fitted)
    simulator = getattr(getattr(model, "simulation", None), "simulator", None)
    function = getattr(simulator, "function", None)
    if getattr(function, "__module__", None) == "__main__":
        name = getattr(function, "__qualname__", repr(function))
        warnings.warn(
            f"The function {name!r} is defined in this script or notebook: the file can be loaded "
            "where __main__ has it, too. Move it to a module to load the file elsewhere.",
            HybridSurrogateWarning,
            stacklevel=3,
        )


def about_saved(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return the head of a saved file, without reading what is in it.

    Parameters
    ----------
    path : str or path

    Returns
    -------
    dict
        Keys hybridsurrogate, python, numpy and scikit-learn: versions; class; code.

    Raises
    ------
    ValueError
        For a file of another kind, and one of another version of hybridsurrogate.
    OSError
        Where there is no such file.
    """
    file = check_readable(path)
    about = None
    with file.open("rb") as head, suppress(ValueError):
        if head.readline(len(_FIRST)) == _FIRST:
            about = json.loads(head.readline(_MAX_LINE))
    if not isinstance(about, dict):
        raise ValueError(
            f"{str(file)!r} is no saved fit or diagnosis: hybridsurrogate.save writes one."
        )
    written, here = about.get("hybridsurrogate"), hybridsurrogate.__version__
    if written != here:
        raise ValueError(
            f"{str(file)!r} was saved by hybridsurrogate {written}, and this is {here}: fit again, "
            f"or install hybridsurrogate=={written}."
        )
    return about


def load(path: str | os.PathLike[str]) -> Any:
    """Read what `save` wrote.

    Loading runs code that the file names, as with every pickle: load only what you trust.

    Parameters
    ----------
    path : str or path

    Returns
    -------
    estimator or DiscrepancyDiagnosis
        Fitted.

    Raises
    ------
    ValueError
        For a file of another kind, of another version, or damaged; where the simulation's function
        cannot be imported.
    OSError
        Where there is no such file.

    Examples
    --------
    See `save`.

    >>> from pathlib import Path
    >>> _ = Path("notes.hs").write_text("none")
    >>> load("notes.hs")
    Traceback (most recent call last):
    ...
    ValueError: 'notes.hs' is no saved fit or diagnosis: hybridsurrogate.save writes one.
    """
    about = about_saved(path)
    try:
        with check_readable(path).open("rb") as file:
            file.readline(_MAX_LINE)
            file.readline(_MAX_LINE)
            with gzip.open(file, "rb") as packed:
                return pickle.load(packed)
    except Exception as error:
        # whatever a pickle of other libraries, or a damaged one, comes upon
        differ = [
            f"{name} {about.get(name)} (here {here})"
            for name, here in _versions().items()
            if about.get(name) != here
        ]
        cause = f" It was saved with {', '.join(differ)}." if differ else ""
        raise ValueError(
            f"{os.fspath(path)!r} cannot be loaded: {type(error).__name__}: {error}.{cause} Fit "
            "again and save it anew."
        ) from error


def _versions() -> dict[str, str]:
    return {
        "hybridsurrogate": hybridsurrogate.__version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scikit-learn": sklearn.__version__,
    }
