"""Folds at the same time."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pickle import PicklingError
from typing import Any

from joblib import Parallel

from hybridsurrogate.diagnosis.validation.progress import counted
from hybridsurrogate.exceptions import DiagnosisWarning


def in_parallel(tasks: Sequence[Any], n_jobs: int | None, progress: bool = False) -> list[Any]:
    """Return what `joblib.delayed` tasks return, from this process where no other can have them.

    Parameters
    ----------
    tasks : sequence of joblib.delayed calls
    n_jobs : int or None
        As in `joblib.Parallel`.
    progress : bool
        Print on a terminal how many were begun; in this process, how many are done.

    Examples
    --------
    >>> from joblib import delayed
    >>> from hybridsurrogate.diagnosis.validation.parallel import in_parallel
    >>> in_parallel([delayed(abs)(-1), delayed(abs)(2)], n_jobs=None)
    [1, 2]
    """
    try:
        # not return_as="generator", which joblib's "multiprocessing" refuses
        return list(Parallel(n_jobs=n_jobs)(counted(tasks, "Folds", progress)))
    except PicklingError:
        # a finished search is not lost because a simulation holds a lock or an open file
        warnings.warn(
            "The folds ran in this process: the simulation or a cause cannot be sent to another "
            "one. Write its function as `def name(...)` at the top of a module, without open files "
            "or locks around it, and pass that; or use n_jobs=None.",
            DiagnosisWarning,
            stacklevel=6,
        )
        return list(Parallel(n_jobs=1)(counted(tasks, "Folds", progress)))
