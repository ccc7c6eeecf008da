"""Files that register what they hold: imported by themselves, each name taken once."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pkgutil import iter_modules
from typing import TypeVar

Thing = TypeVar("Thing")


def import_all(package: str) -> None:
    """Import a module, or every one of a package, so that it registers what it holds.

    Examples
    --------
    >>> import_all("hybridsurrogate.likelihoods")
    """
    for found in iter_modules(getattr(import_module(package), "__path__", ()), f"{package}."):
        import_module(found.name)


def add(
    registry: dict[str, Thing], name: str, thing: Thing, of: Callable[[Thing], type] = type
) -> None:
    """Add a thing under a name.

    A file that is loaded anew makes its class anew, and replaces what it registered.

    Parameters
    ----------
    registry : dict of str to object
    name : str
    thing : object
    of : callable, default=type
        Returns the class that a thing makes public.

    Raises
    ------
    ValueError
        If the name is taken.

    Examples
    --------
    >>> taken = {"one": 1}
    >>> add(taken, "one", 2.0)
    Traceback (most recent call last):
        ...
    ValueError: The name 'one' is that of int: choose another.
    """
    there = registry.get(name)
    if there is not None:
        old, new = of(there), of(thing)
        anew = (old.__module__, old.__qualname__) == (new.__module__, new.__qualname__)
        if old is new or not anew:
            raise ValueError(f"The name {name!r} is that of {old.__name__}: choose another.")
    registry[name] = thing
