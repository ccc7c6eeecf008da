"""Arguments of causes, checked against the types in their constructors' annotations."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import lru_cache, partial
from numbers import Integral
from typing import Any

from hybridsurrogate.arguments.description import described
from hybridsurrogate.arguments.named import check_mapping, check_name
from hybridsurrogate.arguments.scalars import as_real, check_flag, check_number
from hybridsurrogate.effects.axis import Axis, OutputScale
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.priors import check_prior, check_priors


def _check_cause(value: Any, name: str) -> None:
    if not isinstance(value, Cause):
        raise TypeError(f"{name} must be a cause such as Offset(), got {described(value)}.")
    check_arguments(value)


def _check_instance(value: Any, name: str, of: type) -> None:
    if not isinstance(value, of):
        raise TypeError(
            f"{name} must be an {of.__name__} of measured rows, got {described(value)}."
        )


# by annotation; other annotations are checked by the cause
_CHECKS: dict[str, Callable[[Any, str], Any]] = {
    "str": partial(check_name, example='"t"'),
    "Prior": check_prior,
    "float": as_real,
    "int": partial(check_number, kind=Integral),
    "bool": check_flag,
    "Cause": _check_cause,
    "Axis": partial(_check_instance, of=Axis),
    "OutputScale": partial(_check_instance, of=OutputScale),
    "Mapping[str, Prior]": check_priors,
    "Mapping[str, tuple[float, float]]": partial(
        check_mapping, entry="range", example='{"t": (0, 10)}'
    ),
}


def check_arguments(cause: Cause) -> None:
    """Raise TypeError or ValueError for an argument that its annotation does not allow.

    Examples
    --------
    >>> import hybridsurrogate as hs
    >>> check_arguments(hs.Trend(["t"]))
    Traceback (most recent call last):
    ...
    TypeError: column of Trend must be a name, such as "t", got ['t'] (list).
    """
    kind: Any = type(cause)
    for name, annotation in _annotations(kind).items():
        value = getattr(cause, name, None)
        if value is not None or not annotation.endswith("| None"):
            _CHECKS[annotation.removesuffix(" | None")](value, f"{name} of {kind.__name__}")


@lru_cache(maxsize=256)
def _annotations(kind: type[Cause]) -> dict[str, str]:
    """Return the annotations of a constructor that have a check."""
    arguments = inspect.signature(kind).parameters.values()
    own = {one.name: one.annotation for one in arguments if isinstance(one.annotation, str)}
    return {name: text for name, text in own.items() if text.removesuffix(" | None") in _CHECKS}
