"""What a notebook shows of results, and of work that goes on."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

from tqdm.auto import tqdm
from tqdm.notebook import tqdm_notebook

# tqdm.auto is one of the two
IN_NOTEBOOK = issubclass(tqdm, tqdm_notebook)


def counted(tasks: Iterable[Any], what: str, shown: bool, total: int | None = None) -> Any:
    """Return tasks that draw a bar, with the remaining time, as they are taken.

    Parameters
    ----------
    tasks : iterable
    what : str
        Title of the bar.
    shown : bool
    total : int, optional
        Number of tasks where they have no length.

    Examples
    --------
    >>> from hybridsurrogate.notebook import counted
    >>> list(counted([1, 2], "Rows", shown=False))
    [1, 2]
    """
    return tqdm(tasks, desc=what, total=total, disable=not shown)


def filled(total: int, what: str, shown: bool) -> Any:
    """Return a context with ``update(n)``, which fills a bar.

    Parameters
    ----------
    total : int
    what : str
        Title of the bar.
    shown : bool

    Examples
    --------
    >>> from hybridsurrogate.notebook import filled
    >>> with filled(10, "Steps", shown=False) as steps:
    ...     steps.update(5)
    """
    return tqdm(desc=what, total=total, disable=not shown)


def for_a_person(what: str, shown: bool, tasks: Any = None, text: str = "{desc}") -> Any:
    """Return a bar that is seen on a terminal or in a notebook alone, and is gone at its end.

    Parameters
    ----------
    what : str
    shown : bool
    tasks : sequence, optional
    text : str, default="{desc}"
        Format of the bar.

    Examples
    --------
    >>> from hybridsurrogate.notebook import for_a_person
    >>> with for_a_person("Search", shown=False):
    ...     pass
    """
    # tqdm takes None for "not on a terminal", which output in a notebook is not either
    disable = (False if IN_NOTEBOOK else None) if shown else True
    return tqdm(tasks, desc=what, bar_format=text, leave=False, disable=disable)


def doing(what: str, shown: bool = True) -> Any:
    """Return a context that prints what is being done, and for how long.

    Parameters
    ----------
    what : str
    shown : bool

    Examples
    --------
    >>> from hybridsurrogate.notebook import doing
    >>> with doing("Search", shown=False):
    ...     pass
    """
    return for_a_person(what, shown, text="{desc} ({elapsed})")


def table(rows: Sequence[Sequence[str]], header: Sequence[str] = (), caption: str = "") -> str:
    """Return a table as HTML, the first cell of each row as its heading; all texts are escaped.

    Parameters
    ----------
    rows : sequence of sequences of str
    header : sequence of str, optional
        Headings of the columns.
    caption : str, optional

    Returns
    -------
    str

    Examples
    --------
    >>> from hybridsurrogate.notebook import table
    >>> table([("x", "1 < 2")], caption="Inputs")
    '<table><caption>Inputs</caption><tr><th>x</th><td>1 &lt; 2</td></tr></table>'
    """
    lines = [f"<caption>{escape(caption)}</caption>"] if caption else []
    if header:
        lines.append("<tr>" + "".join(f"<th>{escape(word)}</th>" for word in header) + "</tr>")
    for first, *others in rows:
        cells = "".join(f"<td>{escape(cell)}</td>" for cell in others)
        lines.append(f"<tr><th>{escape(first)}</th>{cells}</tr>")
    return f"<table>{''.join(lines)}</table>"
