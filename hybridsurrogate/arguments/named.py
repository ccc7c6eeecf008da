"""Dicts by name, lists of names and single names."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hybridsurrogate.arguments.description import described


def check_mapping(
    value: Any, name: str, entry: str, example: str, optional: bool = True
) -> dict[str, Any]:
    """Return a dict by name; TypeError for anything else.

    Parameters
    ----------
    value : mapping or None
    name : str
        Of the argument.
    entry : str
        What a name stands for.
    example : str
        How it is written.
    optional : bool, default=True
        Whether None may stand for a dict without an entry.

    Examples
    --------
    >>> check_mapping({"t": (0, 4)}, "inputs", "range", '{"t": (0, 4)}')
    {'t': (0, 4)}
    >>> check_mapping(["t"], "inputs", "range", '{"t": (0, 4)}')
    Traceback (most recent call last):
    ...
    TypeError: inputs must be a dict of name to range, such as {"t": (0, 4)}, got ['t'] (list).
    """
    if value is None and optional:
        return {}
    if not isinstance(value, Mapping):
        raise TypeError(
            f"{name} must be a dict of name to {entry}, such as {example}, got {described(value)}."
        )
    for key in value:
        if not isinstance(key, str):
            raise TypeError(f"The names in {name} must be text, got {described(key)}.")
    return dict(value)


def check_units(units: Any) -> dict[str, str]:
    """Return units by name, none for None; TypeError for anything else.

    Examples
    --------
    >>> check_units({"co2": "ppm"}), check_units(None)
    ({'co2': 'ppm'}, {})
    """
    if units is None:
        return {}
    if not isinstance(units, Mapping) or not all(isinstance(u, str) for u in units.values()):
        raise TypeError(
            'units must be a dict of names and units as text, such as {"co2": "ppm"}, got '
            f"{described(units)}."
        )
    return dict(units)


def as_names(value: Any, name: str, example: str) -> tuple[str, ...]:
    """Return one name or several as a tuple; TypeError for anything else, and for a set.

    Parameters
    ----------
    value : str or iterable of str
    name, example : str
        As in `check_mapping`.

    Examples
    --------
    >>> as_names("height", "output", '"height"'), as_names(["a", "b"], "states", '("a", "b")')
    (('height',), ('a', 'b'))
    """
    if isinstance(value, str):
        return (value,)
    try:  # a set has no order, by which columns of an array go
        names = None if isinstance(value, set | frozenset | bytes) else tuple(value)
    except TypeError:
        names = None
    if names is None or not all(isinstance(one, str) for one in names):
        raise TypeError(
            f"{name} must be a name or a list of names, such as {example}, got {described(value)}."
        )
    return tuple(map(str, names))


def check_name(value: Any, name: str, example: str) -> str:
    """Return a single name; TypeError for anything else.

    Examples
    --------
    >>> check_name(["t"], "column", '"t"')
    Traceback (most recent call last):
    ...
    TypeError: column must be a name, such as "t", got ['t'] (list).
    """
    if not isinstance(value, str):
        raise TypeError(f"{name} must be a name, such as {example}, got {described(value)}.")
    return value
