"""What the functions behind an ODE take and return, checked."""

from __future__ import annotations

import inspect
from typing import Any

import numpy as np

from hybridsurrogate.exceptions import did_you_mean
from hybridsurrogate.types import FloatArray


class WrongShapeError(ValueError):
    """A function of the user's that returns an array of the wrong shape, whatever the row."""


def accepted_names(
    function: Any, title: str, n_positional: int, names: tuple[str, ...]
) -> tuple[str, ...]:
    """Return those of the names that a function takes; what is no function takes none."""
    if not callable(function):
        return ()
    try:
        arguments = list(inspect.signature(function).parameters.values())
    except ValueError:  # some compiled functions have no signature
        return names
    named = [
        a for a in arguments[n_positional:] if a.kind in (a.POSITIONAL_OR_KEYWORD, a.KEYWORD_ONLY)
    ]
    unknown = [a.name for a in named if a.default is a.empty and a.name not in names]
    if unknown:
        raise TypeError(
            f"{title} needs {', '.join(unknown)}, which is no input, parameter or assumed "
            f"constant; these are {', '.join(names) or 'none'}.{did_you_mean(unknown, names)}"
        )
    if any(a.kind == a.VAR_KEYWORD for a in arguments):
        return names
    return tuple(name for name in names if name in {a.name for a in named})


def checked_array(values: Any, title: str, shape: tuple[int, ...], meaning: str) -> FloatArray:
    """Return what a function returned as an array; raise WrongShapeError where it does not fit."""
    try:
        array = np.asarray(values, dtype=float)
    except ValueError as error:
        raise WrongShapeError(
            f"{title} must return an array of shape {shape} ({meaning}); what it returned is no "
            f"array: {error}."
        ) from error
    if array.shape != shape:
        raise WrongShapeError(
            f"{title} must return an array of shape {shape} ({meaning}), got {array.shape}."
        )
    return array
