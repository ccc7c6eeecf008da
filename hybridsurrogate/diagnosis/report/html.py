r"""One HTML page that needs no network: style, formulas, pictures and their data are inside it.

Reads the LaTeX that causes write (`effects.notation`): ``\text``, ``\frac``, brackets, powers,
indices, Greek letters and names of functions.
"""

from __future__ import annotations

import base64
import html
import re
from collections import deque
from importlib import resources

import pandas as pd

from hybridsurrogate.diagnosis.report.elements.section import (
    Advice,
    Card,
    FirstScreen,
    Picture,
    Section,
    Table,
)

# the inside of text is read whole, with its spaces
_TOKEN = re.compile(
    r"\\(?:text|operatorname|mathbf)\s*\{(?:\\.|[^\\}])*\}"
    r"|\\[a-zA-Z]+|\\.|[{}^_]|\d+(?:\.\d+)?|[a-zA-Z]|\S"
)
_SYMBOLS = {
    "cdot": "·", "times": "×", "pi": "π", "sigma": "σ", "delta": "δ", "varepsilon": "ε",
    "varphi": "φ", "mu": "μ", "geq": "≥", "leq": "≤", "sim": "∼", "propto": "∝", "to": "→",
    "infty": "∞", "wedge": "^", "Phi": "Φ", "eta": "η", "theta": "θ",
}  # fmt: skip
_SPACES = {",": "0.17em", ":": "0.22em", ";": "0.28em", " ": "0.25em", "!": "0em", "quad": "1em"}
_OPERATORS = {"cdot", "times", "geq", "leq", "sim", "propto", "to"}
_FUNCTIONS = {"exp", "cos", "sin", "log", "max", "min", "tanh", "sqrt"}


def mathml(latex: str) -> str:
    r"""Return a formula in MathML.

    Parameters
    ----------
    latex : str
        In the part of LaTeX that `effects.notation` writes.

    Examples
    --------
    >>> from hybridsurrogate.diagnosis.report.html import mathml
    >>> print(mathml(r"\frac{1}{2} x"))
    <math display="block"><mrow><mfrac><mn>1</mn><mn>2</mn></mfrac><mi>x</mi></mrow></math>
    """
    return f'<math display="block">{_row(_items(deque(_TOKEN.findall(latex))))}</math>'


def _items(tokens: deque[str], stop: str = "") -> list[str]:
    """Return elements up to the token at which a group ends."""
    items: list[str] = []
    while tokens and tokens[0] != stop:
        if tokens[0] not in "^_":
            items.append(_one(tokens))
            continue
        tag = "msup" if tokens.popleft() == "^" else "msub"
        base = items.pop() if items else "<mrow></mrow>"
        items.append(f"<{tag}>{base}{_one(tokens)}</{tag}>")
    if tokens:
        tokens.popleft()
    return items


def _one(tokens: deque[str]) -> str:
    """Return the next element: a symbol, or a group in braces."""
    token = tokens.popleft()
    if token == "{":
        return _row(_items(tokens, "}"))
    if not token.startswith("\\"):
        tag = "mn" if token[0].isdigit() else "mi" if token.isalpha() else "mo"
        return f"<{tag}>{html.escape(token)}</{tag}>"
    name = token[1:]
    if "{" in name and name.endswith("}"):
        tag = "mtext" if name.startswith("text") else "mi"
        inside = re.sub(r"\\(.)", r"\1", name[name.index("{") + 1 : -1])
        return f"<{tag}>{html.escape(inside)}</{tag}>"
    if name in _SPACES:
        return f'<mspace width="{_SPACES[name]}"/>'
    if name == "frac":
        return f"<mfrac>{_one(tokens)}{_one(tokens)}</mfrac>"
    if name == "sqrt":
        return f"<msqrt>{_one(tokens)}</msqrt>"
    if name in ("left", "right"):
        bracket = tokens.popleft()
        return "" if bracket == "." else f"<mo>{html.escape(bracket.lstrip(chr(92)))}</mo>"
    if name in _FUNCTIONS:
        return f"<mi>{name}</mi>"
    symbol = _SYMBOLS.get(name, name)
    return f"<mo>{symbol}</mo>" if name in _OPERATORS else f"<mi>{html.escape(symbol)}</mi>"


def _row(items: list[str]) -> str:
    return items[0] if len(items) == 1 else f"<mrow>{''.join(items)}</mrow>"


_STYLE = resources.files(__package__).joinpath("page.css").read_text("utf-8").replace("\n", "")
_NOTE = (
    "Written by hybridsurrogate. Surrogates on two data sources: Reiser, Bürkner and Guthke, "
    "arXiv 2412.11875."
)


def page(first: FirstScreen, sections: tuple[Section, ...]) -> str:
    """Return a whole page: the first screen, a table of contents, folded sections."""
    title = html.escape(first.headline)
    entries = "".join(
        f'<li><a href="#{_name(s.title)}">{html.escape(s.title)}</a></li>' for s in sections
    )
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{title}</title><style>{_STYLE}</style></head>\n<body><main>\n"
        f"{screen(first)}\n<h2>In detail</h2><nav><ul>{entries}</ul></nav>\n"
        + "\n".join(map(_section, sections))
        + f"\n</main><footer><p>{_NOTE}</p></footer></body></html>\n"
    )


def screen(first: FirstScreen, with_picture: bool = True) -> str:
    """Return the first screen alone, for a page with its style sheet elsewhere."""
    parts = [f"<header><p>{html.escape(first.subject)}</p></header>"]
    parts.append(f"<h1>{html.escape(first.headline)}</h1>")
    parts += [f'<p class="lead">{html.escape(sentence)}</p>' for sentence in first.lead]
    parts.append(f'<dl class="cards">{"".join(map(_card, first.cards))}</dl>')
    if first.caution:
        parts.append(f'<p class="caution"><b>Caution.</b> {html.escape(first.caution)}</p>')
    if with_picture:
        parts.append(_figure(first.picture))
    parts.append(f"<h2>Next</h2><ol>{''.join(map(_advice, first.advice))}</ol>")
    return "\n".join(parts)


def _card(card: Card) -> str:
    question, answer, detail = map(html.escape, card)
    return f"<div><dt>{question}</dt><dd><b>{answer}</b> {detail}</dd></div>"


def _advice(advice: Advice) -> str:
    call = f" <code>{html.escape(advice.call)}</code>" if advice.call else ""
    return f"<li>{html.escape(advice.sentence)}{call}</li>"


def _name(title: str) -> str:
    return re.sub(r"\W+", "-", title.lower()).strip("-")


def _section(section: Section) -> str:
    hint = f" <span>{html.escape(section.hint)}</span>" if section.hint else ""
    # a link to what is inside opens the section
    parts = [
        f"<details><summary>{html.escape(section.title)}{hint}</summary>"
        f'<div id="{_name(section.title)}">'
    ]
    parts += [f"<p>{html.escape(sentence)}</p>" for sentence in section.sentences]
    for name, _, latex in section.formulas:
        parts.append(f"<p>{html.escape(name)}:</p>{mathml(latex)}")
        parts.append(f"<pre><code>{html.escape(latex)}</code></pre>")
    parts += map(_table, section.tables)
    parts += map(_figure, section.pictures)
    if section.code:
        parts.append(f"<pre><code>{html.escape(section.code)}</code></pre>")
    return "\n".join([*parts, "</div></details>"])


def _figure(picture: Picture) -> str:
    description, svg, data = picture.drawn
    text = html.escape(description, quote=True)
    image = base64.b64encode(svg).decode()
    numbers = base64.b64encode(data.to_csv(index=False).encode()).decode()
    return (
        f'<figure><img alt="{text}" src="data:image/svg+xml;base64,{image}">'
        f'<figcaption>{text} <a download="figure.csv" href="data:text/csv;base64,{numbers}">'
        "Data of this figure (CSV)</a></figcaption></figure>"
    )


def _table(table: Table) -> str:
    head = "".join(f'<th scope="col">{html.escape(str(name))}</th>' for name in table.rows)
    rows = "".join(
        f"<tr>{''.join(f'<td>{_cell(cell)}</td>' for cell in row)}</tr>"
        for row in table.rows.itertuples(index=False)
    )
    caption = f"<caption>{html.escape(table.caption)}</caption>" if table.caption else ""
    return (
        f'<div class="wide"><table>{caption}<thead><tr>{head}</tr></thead>'
        f"<tbody>{rows}</tbody></table></div>"
    )


def _cell(cell: object) -> str:
    return "" if pd.isna(cell) else html.escape(str(cell))
