"""What is being done, on a terminal or in a notebook."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from hybridsurrogate.notebook.bars import for_a_person


def doing(what: str, shown: bool = True) -> Any:
    """Return a context that prints what is being done.

    Parameters
    ----------
    what : str
    shown : bool
    """
    return for_a_person(what, shown, text="{desc} ({elapsed})")


def counted(tasks: Sequence[Any], what: str, shown: bool = True) -> Any:
    """Return the tasks, with a count of those that are done.

    Parameters
    ----------
    tasks : sequence
    what : str
    shown : bool
    """
    return for_a_person(what, shown, tasks, "{desc} {n_fmt} of {total_fmt} ({elapsed})")
