"""What is being done, on a terminal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from tqdm import tqdm


def doing(what: str, shown: bool = True) -> Any:
    """Return a context that says what is being done while it lasts, where stderr is a terminal.

    Parameters
    ----------
    what : str
    shown : bool
    """
    # tqdm takes None for "not on a terminal"
    return tqdm(
        desc=what, bar_format="{desc} ({elapsed})", leave=False, disable=None if shown else True
    )


def counted(tasks: Sequence[Any], what: str, shown: bool = True) -> Any:
    """Return the tasks, which say how many of them are done where stderr is a terminal.

    Parameters
    ----------
    tasks : sequence
    what : str
    shown : bool
    """
    return tqdm(
        tasks,
        desc=what,
        bar_format="{desc} {n_fmt} of {total_fmt} ({elapsed})",
        leave=False,
        disable=None if shown else True,
    )
