"""Arguments that a user gives: one check a kind, which says what was expected and what came."""

from __future__ import annotations

import functools
import inspect
import numbers
import os
import pickle
import reprlib
import sys
import types
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from sklearn.utils import check_scalar

from hybridsurrogate.exceptions import did_you_mean

_PLAIN = (int, float, complex, str, bytes, list, tuple, dict, set, frozenset)


def described(value: Any) -> str:
    """Return what a value is, on one line however large it is.

    Examples
    --------
    >>> import numpy as np
    >>> described("five"), described(5), described(np.zeros((2, 3)))
    ("'five' (str)", '5 (int)', 'ndarray of shape (2, 3)')
    >>> described(None), described(int), described(len)
    ('None', 'the class int', 'builtin_function_or_method len')
    """
    kind = type(value).__name__
    shape = getattr(value, "shape", None)
    if value is None:
        return "None"
    if isinstance(value, type):
        return f"the class {value.__name__}"
    if isinstance(shape, tuple) and shape:
        return f"{kind} of shape {shape}"
    if isinstance(value, _PLAIN):
        return f"{reprlib.repr(value)} ({kind})"
    if isinstance(shape, tuple):  # a number of numpy's
        return f"{value} ({kind})"
    name = getattr(value, "__name__", None)
    return f"{kind} {name}" if isinstance(name, str) else f"an object of the class {kind}"


def check_number(value: Any, name: str, kind: Any = numbers.Real, **limits: Any) -> None:
    """As `sklearn.utils.check_scalar`, which lets NaN pass: raise ValueError for it, too.

    Examples
    --------
    >>> check_number(float("nan"), "level", float, min_val=0, max_val=1)
    Traceback (most recent call last):
    ...
    ValueError: level must be a number, got NaN.
    """
    check_scalar(value, name, kind, **limits)
    if value != value:
        raise ValueError(f"{name} must be a number, got NaN.")


def as_real(value: Any, name: str, finite: bool = True) -> float:
    """Return a real number as a float; raise for anything else, NaN, and perhaps infinity.

    Examples
    --------
    >>> as_real("1.5", "mean")
    Traceback (most recent call last):
    ...
    TypeError: mean must be a number, got '1.5' (str).
    """
    number = value
    if not isinstance(value, numbers.Real):
        try:  # an array of one number
            number = value.item()
        except (AttributeError, TypeError, ValueError):
            number = None
        if not isinstance(number, numbers.Real):
            raise TypeError(f"{name} must be a number, got {described(value)}.")
    try:
        number = float(number)
    except OverflowError:
        number = np.inf
    if np.isnan(number) or (finite and np.isinf(number)):
        raise ValueError(f"{name} must be a {'finite ' * finite}number, got {number:g}.")
    return number


def check_flag(value: Any, name: str) -> bool:
    """Return True or False; TypeError for anything else.

    Examples
    --------
    >>> check_flag("no", "vectorized")
    Traceback (most recent call last):
    ...
    TypeError: vectorized must be True or False, got 'no' (str).
    """
    if not isinstance(value, bool | np.bool_):
        raise TypeError(f"{name} must be True or False, got {described(value)}.")
    return bool(value)


def check_choice(value: Any, name: str, choices: Sequence[str]) -> str:
    """Return one of several words; ValueError for anything else.

    Examples
    --------
    >>> check_choice("curves", "returns", ("values", "curve"))
    Traceback (most recent call last):
    ...
    ValueError: returns must be one of values, curve, got 'curves' (str). Did you mean 'curve'?
    """
    if not isinstance(value, str) or value not in choices:
        meant = did_you_mean(value, choices) if isinstance(value, str) else ""
        raise ValueError(
            f"{name} must be one of {', '.join(choices)}, got {described(value)}.{meant}"
        )
    return value


def check_n_jobs(value: Any) -> int | None:
    """Return a number of processes, -1 for all cores, or None; raise for anything else.

    Examples
    --------
    >>> check_n_jobs(0)
    Traceback (most recent call last):
    ...
    ValueError: n_jobs must be a number of processes, -1 for all cores, or None, got 0 (int).
    """
    if value is None or (isinstance(value, numbers.Integral) and value):
        return None if value is None else int(value)
    kind = ValueError if isinstance(value, numbers.Integral) else TypeError
    raise kind(
        f"n_jobs must be a number of processes, -1 for all cores, or None, got {described(value)}."
    )


def random_generator(random_state: Any) -> np.random.Generator:
    """Return a numpy Generator from None, an int, a Generator or a RandomState.

    Examples
    --------
    >>> random_generator(0).integers(10, size=3)
    array([8, 6, 5])
    """
    # numpy makes no Generator from a RandomState, which scikit-learn's users pass: it draws a seed
    if isinstance(random_state, np.random.RandomState):
        random_state = random_state.randint(2**31 - 1)
    whole = isinstance(random_state, numbers.Integral)
    if not (random_state is None or isinstance(random_state, np.random.Generator)):
        if not whole or random_state < 0:
            raise (ValueError if whole else TypeError)(
                "random_state must be None, an int from 0, a numpy Generator or a RandomState, "
                f"got {described(random_state)}."
            )
        random_state = int(random_state)
    return np.random.default_rng(random_state)


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


def check_units(units: Any, known: Iterable[str] | None = None) -> dict[str, str]:
    """Return units by name, none for None; raise for anything else.

    Parameters
    ----------
    units : mapping of str to str, or None
    known : iterable of str or None
        Names that may have a unit; None: any.

    Raises
    ------
    TypeError
        For units that are no dict of text.
    ValueError
        For the unit of an unknown name.

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
    names = units if known is None else list(known)
    for name in units:
        if name not in names:
            raise ValueError(
                f"units: there is no {name!r}; there are {', '.join(names)}."
                f"{did_you_mean(name, names)}"
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


def check_readable(path: Any) -> Path:
    """Return the path of a file that is there; raise where there is none, before it is opened.

    Raises
    ------
    FileNotFoundError, IsADirectoryError, PermissionError
        All of them OSError.
    TypeError, ValueError
        As `local_path`.
    """
    cure = "Fetch it first, or, where you trust it, read_simulation(..., allow_urls=True)."
    file = local_path(path, cure=cure)
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


def accepted_names(
    function: Any, title: str, names: Sequence[str], n_positional: int = 0
) -> tuple[str, ...]:
    """Return those of the names that a function takes as arguments, after the positional ones.

    What is no function takes none; TypeError for one that needs something else.
    """
    if not callable(function):
        return ()
    try:
        arguments = list(inspect.signature(function).parameters.values())
    except ValueError:  # some compiled functions have no signature
        return tuple(names)
    named = [
        a for a in arguments[n_positional:] if a.kind in (a.POSITIONAL_OR_KEYWORD, a.KEYWORD_ONLY)
    ]
    absent = [a.name for a in named if a.default is a.empty and a.name not in names]
    taken = {a.name for a in named}
    if absent:
        misnamed = [name for name in names if name not in taken]
        raise TypeError(
            f"{title} needs {', '.join(absent)}, which is no input, parameter or assumed constant "
            f"({', '.join(names) or 'none'}): name it as one, or give it a default."
            f"{did_you_mean(misnamed, absent)}"
        )
    if any(a.kind == a.VAR_KEYWORD for a in arguments):
        return tuple(names)
    return tuple(name for name in names if name in taken)
