"""What can be called, and what can be pickled."""

from __future__ import annotations

import functools
import pickle
import sys
import types
from collections.abc import Callable, Mapping
from typing import Any

from hybridsurrogate.arguments.description import described

_CURE = "write it as `def name(...)` at the top of a module, and pass that"


def check_callable(value: Any, name: str, example: str) -> Callable[..., Any]:
    """Return what can be called; TypeError for anything else.

    Examples
    --------
    >>> check_callable("fall", "function", "def fall(t, gravity)")
    Traceback (most recent call last):
    ...
    TypeError: function must be callable, such as def fall(t, gravity), got 'fall' (str).
    """
    if not callable(value):
        raise TypeError(f"{name} must be callable, such as {example}, got {described(value)}.")
    called: Callable[..., Any] = value
    return called


def state_to_pickle(state: Mapping[str, Any], owner: str) -> dict[str, Any]:
    """Return the state of an object for `pickle`, which keeps functions by their names alone.

    Call it in ``__getstate__``. Copies and picklers that take any function, as cloudpickle does
    for processes, get the state as it is.

    Parameters
    ----------
    state : dict
    owner : str
        What to call the object in an error.

    Raises
    ------
    pickle.PicklingError
        For a lambda, or a function inside another one.

    Examples
    --------
    >>> class Holder:
    ...     def __init__(self, function):
    ...         self.function = function
    ...     def __getstate__(self):
    ...         return state_to_pickle(self.__dict__, "the holder")
    >>> try:
    ...     pickle.dumps(Holder(lambda t: t))
    ... except pickle.PicklingError as error:
    ...     print(str(error)[:35])
    function of the holder is a lambda,
    """
    # the caller's caller is the pickler, or whoever asked for it where it is written in C
    caller = sys._getframe(2)
    if not _takes_any_function(caller):
        for name, value in state.items():
            function = _nameless(value)
            if function is not None:
                which = (
                    "a lambda" if function.__name__ == "<lambda>" else repr(function.__qualname__)
                )
                raise pickle.PicklingError(
                    f"{name} of {owner} is {which}, and pickle keeps a function by the name under "
                    f"which its module has it: {_CURE}."
                )
    return dict(state)


def _takes_any_function(caller: types.FrameType) -> bool:
    """Return whether a frame copies, or is of a pickler that can store functions."""
    if caller.f_globals.get("__name__") == "copy":
        return True
    pickler = caller.f_locals.get("self")
    if not isinstance(pickler, pickle.Pickler | pickle._Pickler):
        return False
    ways = (getattr(pickler, "dispatch", {}), getattr(pickler, "dispatch_table", {}))
    usual = pickle._Pickler.dispatch[types.FunctionType]
    return hasattr(pickler, "reducer_override") or any(
        way.get(types.FunctionType, usual) is not usual for way in ways
    )


def _nameless(value: Any) -> types.FunctionType | None:
    """Return the function that pickle cannot find by its name, None where it can."""
    while isinstance(value, functools.partial):
        value = value.func
    if not isinstance(value, types.FunctionType):
        return None
    found: Any = sys.modules.get(value.__module__)
    for part in value.__qualname__.split("."):
        found = getattr(found, part, None)
    return None if found is value else value
