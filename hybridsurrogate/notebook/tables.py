"""Small tables as HTML: texts are escaped, and nothing is computed for them."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape


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
