r"""Formulas as MathML, which browsers show without a script.

Reads the LaTeX that causes write (`effects.notation`): ``\text``, ``\frac``, brackets, powers,
indices, Greek letters and names of functions.
"""

from __future__ import annotations

import html
import re
from collections.abc import Iterator

_TOKEN = re.compile(r"\\[a-zA-Z]+|\\.|[{}^_]|\d+(?:\.\d+)?|[a-zA-Z]|\S")
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
    >>> from hybridsurrogate.diagnosis.report.mathml import mathml
    >>> print(mathml(r"\frac{1}{2} x"))
    <math display="block"><mrow><mfrac><mn>1</mn><mn>2</mn></mfrac><mi>x</mi></mrow></math>
    """
    tokens = _Tokens(latex)
    return f'<math display="block">{_row(list(_items(tokens)))}</math>'


class _Tokens:
    """LaTeX in pieces; the inside of text is read whole, with its spaces."""

    def __init__(self, latex: str) -> None:
        self.rest = latex

    def peek(self) -> str:
        found = _TOKEN.search(self.rest)
        return found.group() if found else ""

    def next(self) -> str:
        found = _TOKEN.search(self.rest)
        if found is None:
            return ""
        self.rest = self.rest[found.end() :]
        return found.group()

    def text(self) -> str:
        """Read what stands in the next braces as it is."""
        inside = self.rest[self.rest.index("{") + 1 :]
        end = re.search(r"(?<!\\)\}", inside)
        stop = end.start() if end else len(inside)
        self.rest = inside[stop + 1 :]
        return re.sub(r"\\(.)", r"\1", inside[:stop])


def _items(tokens: _Tokens, stop: str = "") -> Iterator[str]:
    """Yield elements up to the token at which a group ends."""
    held: str | None = None
    while (token := tokens.peek()) and token != stop:
        if token in "^_":
            tokens.next()
            tag = "msup" if token == "^" else "msub"
            held = f"<{tag}>{held or '<mrow></mrow>'}{_one(tokens)}</{tag}>"
            continue
        if held is not None:
            yield held
        held = _one(tokens)
    tokens.next()
    if held is not None:
        yield held


def _one(tokens: _Tokens) -> str:
    """Return the next element: a symbol, or a group in braces."""
    token = tokens.next()
    if token == "{":
        return _row(list(_items(tokens, "}")))
    if not token.startswith("\\"):
        return _plain(token)
    name = token[1:]
    if name in _SPACES:
        return f'<mspace width="{_SPACES[name]}"/>'
    if name in ("text", "operatorname", "mathbf"):
        inside = html.escape(tokens.text())
        return f"<mtext>{inside}</mtext>" if name == "text" else f"<mi>{inside}</mi>"
    if name == "frac":
        return f"<mfrac>{_one(tokens)}{_one(tokens)}</mfrac>"
    if name == "sqrt":
        return f"<msqrt>{_one(tokens)}</msqrt>"
    if name in ("left", "right"):
        bracket = tokens.next()
        return "" if bracket == "." else f"<mo>{html.escape(bracket.lstrip(chr(92)))}</mo>"
    if name in _FUNCTIONS:
        return f"<mi>{name}</mi>"
    symbol = _SYMBOLS.get(name, name)
    return f"<mo>{symbol}</mo>" if name in _OPERATORS else f"<mi>{html.escape(symbol)}</mi>"


def _plain(token: str) -> str:
    tag = "mn" if token[0].isdigit() else "mi" if token.isalpha() else "mo"
    return f"<{tag}>{html.escape(token)}</{tag}>"


def _row(items: list[str]) -> str:
    return items[0] if len(items) == 1 else f"<mrow>{''.join(items)}</mrow>"
