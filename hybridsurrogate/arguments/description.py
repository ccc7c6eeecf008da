"""A value in a few words, for a message about it."""

from __future__ import annotations

import reprlib
from typing import Any

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
