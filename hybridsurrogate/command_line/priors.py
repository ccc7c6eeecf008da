"""Priors and assumed constants as words."""

from __future__ import annotations

import math

from scipy import stats

from hybridsurrogate.priors import truncated_normal
from hybridsurrogate.simulation.simulator import Assumed
from hybridsurrogate.simulation.variables import check_support
from hybridsurrogate.types import Prior

Ends = tuple[float, float]


def prior_of(name: str, text: str, runs: tuple[Ends, int] | None = None) -> Prior:
    """Return the prior that a text describes.

    Parameters
    ----------
    name : str
    text : str
        MEAN,SD for a normal one, MEAN,SD,LOW,HIGH for one cut off at both ends, LOW..HIGH for a
        uniform one.
    runs : ((low, high), n) or None
        Range and number of the runs, where a normal prior is cut off; None: it is not.

    Raises
    ------
    ValueError
        For any other text.

    Examples
    --------
    >>> prior_of("speed", "1..3").support()
    (np.float64(1.0), np.float64(3.0))
    """
    low, dots, high = text.partition("..")
    numbers = _numbers([low, high] if dots else text.split(","))
    if dots and len(numbers) == 2 and numbers[0] < numbers[1]:
        return stats.uniform(numbers[0], numbers[1] - numbers[0])
    if not dots and len(numbers) == 4 and numbers[1] > 0 and numbers[2] < numbers[3]:
        return truncated_normal(*numbers)
    if dots or len(numbers) != 2 or numbers[1] <= 0:
        raise ValueError(
            f"--prior {name}={text}: write NAME=MEAN,SD or MEAN,SD,LOW,HIGH or LOW..HIGH, such as "
            f"{name}=2,0.5 or {name}=1..3."
        )
    mean, sd = numbers
    normal = stats.norm(mean, sd)
    if runs is None:
        return normal
    # cut off at the runs it would lie among them, wherever it was
    check_support(name, normal, *runs)
    return truncated_normal(mean, sd, *runs[0])


def assumed_of(name: str, text: str, ends: Ends | None = None) -> Assumed:
    """Return an assumed constant from VALUE, or VALUE,LOW,HIGH.

    Parameters
    ----------
    name, text : str
    ends : (low, high) or None
        Range of the runs, over which the constant may lie where no other is given.

    Raises
    ------
    ValueError
        For any other text, and for a value alone without runs.

    Examples
    --------
    >>> assumed_of("rate", "0.55,0.3,0.9").value
    0.55
    """
    numbers = _numbers(text.split(","))
    if len(numbers) == 1 and ends is not None:
        numbers += ends
    if len(numbers) != 3 or not numbers[1] < numbers[2]:
        raise ValueError(
            f"--assumed {name}={text}: write NAME=VALUE,LOW,HIGH, the range in which it may be, "
            f"such as {name}=0.5,0.3,0.9."
        )
    return Assumed(numbers[0], stats.uniform(numbers[1], numbers[2] - numbers[1]))


def _numbers(cells: list[str]) -> list[float]:
    """Return texts as finite numbers, an empty list where one of them is none."""
    try:
        numbers = list(map(float, cells))
    except ValueError:
        return []
    return numbers if all(map(math.isfinite, numbers)) else []
