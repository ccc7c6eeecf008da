"""Numbers, yes or no, and one of several words."""

from __future__ import annotations

import numbers
from collections.abc import Sequence
from typing import Any

import numpy as np
from sklearn.utils import check_scalar

from hybridsurrogate.arguments.description import described
from hybridsurrogate.exceptions import did_you_mean


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
