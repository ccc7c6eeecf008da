"""The expression of a cause in plain text, in LaTeX and in Python.

A cause is written once, as Python with names in braces (`effects.code`). Here that is read as a
sum, its names become words and numbers, and it is printed as text, or as LaTeX in the part of it
that matplotlib's mathtext reads too.
"""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Literal

from hybridsurrogate.effects.context import Rows
from hybridsurrogate.types import FloatArray

# characters with a meaning in LaTeX; mathtext knows no braces or backslashes inside \text
_IN_TEXT = {
    "\\": "/",
    "{": "(",
    "}": ")",
    "$": r"\$",
    "%": r"\%",
    "&": r"\&",
    "#": r"\#",
    "_": r"\_",
    "^": r"}{}^{\wedge}\text{",
    "~": r"}\sim\text{",
}


def word(text: str) -> str:
    r"""Return any text as upright letters.

    Examples
    --------
    >>> from hybridsurrogate.effects.expressions import word
    >>> print(word("contact_rate"))
    \text{contact\_rate}
    """
    inside = "".join(_IN_TEXT.get(character, character) for character in text)
    return rf"\text{{{inside}}}".replace(r"\text{}", "")


def number(value: float, digits: int = 4) -> str:
    r"""Return a number with so many significant digits.

    Examples
    --------
    >>> from hybridsurrogate.effects.expressions import number
    >>> print(number(-0.0000123))
    -1.23 \times 10^{-5}
    """
    if not math.isfinite(value):
        return r"\infty" if value > 0 else r"-\infty" if value < 0 else r"\text{unknown}"
    mantissa, _, exponent = f"{value:.{digits}g}".partition("e")
    return rf"{mantissa} \times 10^{{{int(exponent)}}}" if exponent else mantissa


def digits_at(place: float, scale: float, least: int = 5) -> int:
    """Return the significant digits of a place that resolve it to a share of a scale.

    So many as ``least`` where the place is within the scale, more where it is far from zero, as
    days are that are counted from the year one.

    Examples
    --------
    >>> from hybridsurrogate.effects.expressions import digits_at
    >>> digits_at(31.2, 100.0), digits_at(738042.8, 100.0)
    (5, 8)
    """
    size = abs(scale)
    if not 0 < size < math.inf or not math.isfinite(place):
        return least
    return least + math.floor(math.log10(max(abs(place) / size, 1.0)))


Does = Literal[
    "adds",
    "responds",
    "moves",
    "replaces",
    "scales rate",
    "adds to slope",
    "delays",
    "scatters",
    "nothing",
]
# tables of numbers by name, made of draws of theta and of the coefficients
Tables = Callable[[Rows, Rows], dict[str, FloatArray]]


@dataclass(frozen=True)
class LevelTable:
    """Numbers of a cause that belong to the levels of a column.

    Attributes
    ----------
    column : str
    levels : tuple of (float, str)
        Each level, and the name of its number.
    unit : str
        As in `Code.numbers`.
    """

    column: str
    levels: tuple[tuple[float, str], ...]
    unit: str = "{y}"


@dataclass(frozen=True)
class Code:
    """What a cause does, as an expression of numpy.

    Names in braces are replaced by what is named below. ``{simulated}`` is the output on the scale
    on which causes act, ``{of}`` the quantity that is moved, and ``{sigma}`` the standard deviation
    of the noise. Of an ODE ``{t}`` is the time and ``{step}`` the solver's step.

    Attributes
    ----------
    expression : str
    numbers : mapping of str to str
        Names of the numbers, as `Cause.estimates` or else the cause's parameters have them,
        and their units: ``{y}`` is that of the output on the scale on which causes act,
        ``{plain}`` that of the output itself; names of columns and states stand for theirs.
    columns : mapping of str to str
        The measured column that each name stands for.
    constants : mapping of str to float
    levels : mapping of str to (str, float)
        Values of a column of labels: the column and the value.
    labels : tuple of str
        Names that this column numbers from zero; of values none.
    steps : mapping of str to str
        Variables that the expression uses, in order.
    does : str
        The expression "adds" to the output, is what the output becomes ("responds"), what a column
        or a parameter becomes ("moves"), or the noise ("scatters"); a number "replaces" a parameter
        or constant. Of an ODE it "scales rate", "adds to slope", or is how long ago the state is
        seen ("delays"). "nothing": what it changes is not in the simulation.
    of : str
        The column, parameter or state concerned.
    states : mapping of str to str
        The state of an ODE that each name stands for.
    table : Table or None
        ``{table}`` in the expression.
    unseen : str
        The slope of an unseen state, ``{store}``, that takes what the expression adds to a slope,
        over ``{ratio}``, and begins at that state plus ``{gap}``.
    through : (str, float) or None
        The parameter whose term of the slope acts on the unseen state instead, and its value
        without that term.
    by_row : mapping of str to str
        Numbers of an ODE that differ between rows, as expressions.
    grids : mapping of str to (float, float, int)
        Ends and number of places of grids on which ``tables`` store a curve.
    tables : callable or None
        ``(theta, coefficients) -> {name: array}``; means over draws.
    arguments : mapping of str to str
        What else the noise depends on, with words for it.
    note : str
        What a formula says in brackets of a number that replaces another.
    name : str
        Of the function; empty: that of the kind.
    output : str or None
        Of several outputs the one concerned.

    Examples
    --------
    >>> line = Code("{slope} * {x}", {"slope": "{y} / {x}"}, {"x": "t"})
    >>> line.does, line.expression.format(slope="slope", x="t")
    ('adds', 'slope * t')
    """

    expression: str
    numbers: Mapping[str, str] = field(default_factory=dict)
    columns: Mapping[str, str] = field(default_factory=dict)
    constants: Mapping[str, float] = field(default_factory=dict)
    levels: Mapping[str, tuple[str, float]] = field(default_factory=dict)
    labels: tuple[str, ...] = ()
    steps: Mapping[str, str] = field(default_factory=dict)
    does: Does = "adds"
    of: str = ""
    states: Mapping[str, str] = field(default_factory=dict)
    unseen: str = ""
    through: tuple[str, float] | None = None
    table: LevelTable | None = None
    by_row: Mapping[str, str] = field(default_factory=dict)
    grids: Mapping[str, tuple[float, float, int]] = field(default_factory=dict)
    tables: Tables | None = None
    arguments: Mapping[str, str] = field(default_factory=dict)
    note: str = ""
    name: str = ""
    output: str | None = None


def names_in(template: str) -> list[str]:
    """Return the names in braces."""
    return re.findall(r"(?<!\{)\{(\w+)\}", template)


Values = Mapping[str, float]
Printer = Callable[[Code, Values, Mapping[str, float]], str]

# digits of a number, of a place, and of a level that is compared exactly: a choice of presentation
_DIGITS, _DIGITS_OF_PLACE, _DIGITS_OF_LEVEL = 4, 5, 12
# how tightly a sum, a product and a power hold together
_SUM, _PRODUCT, _POWER, _WHOLE = range(4)
_RELATIONS: dict[type, tuple[str, str]] = {
    ast.Eq: ("=", "="),
    ast.Lt: ("<", "<"),
    ast.LtE: ("<=", r"\leq"),
    ast.Gt: (">", ">"),
    ast.GtE: (">=", r"\geq"),
}
_TURNED: dict[type, type] = {ast.GtE: ast.LtE, ast.Gt: ast.Lt}
_SHORT = {"maximum": "max", "minimum": "min"}
_IN_LATEX = ("exp", "cos", "sin", "log", "max", "min", "tanh")


@dataclass(frozen=True)
class _Number:
    value: float
    digits: int = _DIGITS


@dataclass(frozen=True)
class _Word:
    text: str
    latex: str
    # of a column: how far its rows reach
    span: float | None = None


@dataclass(frozen=True)
class _Sum:
    terms: tuple[_Node, ...]


@dataclass(frozen=True)
class _Product:
    sign: int
    factors: tuple[_Node, ...]
    divisors: tuple[_Node, ...] = ()


@dataclass(frozen=True)
class _Power:
    base: _Node
    exponent: _Node


@dataclass(frozen=True)
class _Call:
    function: str
    arguments: tuple[_Node, ...]


@dataclass(frozen=True)
class _Condition:
    parts: tuple[tuple[_Node, type, _Node], ...]


_Node = _Number | _Word | _Sum | _Product | _Power | _Call | _Condition

_ONE, _OUTPUT = _Number(1.0), _Word("simulation", word("simulation"))


def in_words(code: Code, values: Values, spans: Mapping[str, float]) -> str:
    """Return the extended simulation in plain text.

    Parameters
    ----------
    code : Code
    values : dict of name to float
        The numbers of the cause.
    spans : dict of column to float
        How far measured rows reach: places are written with digits that resolve it.

    Examples
    --------
    >>> line = Code("{slope} * ({x} - {center})", {"slope": "{y} / {x}"}, {"x": "t"}, {"center": 5})
    >>> in_words(line, {"slope": -0.25}, {"t": 10.0})
    'simulation - 0.25 (t - 5)'
    """
    show = _Printer(is_latex=False).show
    whole, note = _whole(code, values, spans), f" ({code.note})" if code.note else ""
    if code.does == "moves":
        run_at = "run at" if code.of in code.columns.values() else "with"
        return f"simulation {run_at} {show(whole)}"
    if code.does == "scales rate":
        return f"simulation with {show(whole)}"
    if code.does == "replaces":
        return f"simulation with {code.of} = {show(whole)}{note}"
    if code.does == "adds to slope":
        store = ""
        if code.unseen:
            slope = show(_Reader(code, values, spans).read(code.unseen))
            store = f" and {slope} in that of the {code.states['store']}"
        return f"simulation with {show(whole)} in the slope of {code.of}{store}"
    return show(whole)


def in_latex(code: Code, values: Values, spans: Mapping[str, float]) -> str:
    r"""Return the extended simulation in LaTeX, as `in_words` does in text.

    Examples
    --------
    >>> line = Code("{slope} * ({x} - {center})", {"slope": "{y} / {x}"}, {"x": "t"}, {"center": 5})
    >>> print(in_latex(line, {"slope": -0.25}, {"t": 10.0}))
    \text{simulation} - 0.25 \, \left(\text{t} - 5\right)
    """
    show = _Printer(is_latex=True).show
    whole, of = _whole(code, values, spans), word(code.of)
    if code.does == "adds to slope":
        slope = rf"\frac{{d}}{{dt}} {of}"
        changed, store = _added(_Word("", slope), whole), ""
        if code.unseen:
            other = show(_Reader(code, values, spans).read(code.unseen))
            store = rf", \quad \frac{{d}}{{dt}} {word(code.states['store'])} = {other}"
        return rf"{word('simulation')}, \quad {slope} \to {show(changed)}{store}"
    text = show(whole)
    if code.does == "moves" and code.of in code.columns.values():
        return rf"{word('simulation')}\left({text}\right)"
    if code.does in ("moves", "scales rate"):
        return rf"{word('simulation')}, \quad {of} \to {text}"
    if code.does == "replaces":
        note = rf" \, {word(f'({code.note})')}" if code.note else ""
        return rf"{word('simulation')}, \quad {of} = {text}{note}"
    return text


def sentence(text: str) -> str:
    r"""Return a formula in words in LaTeX.

    Examples
    --------
    >>> print(sentence("simulation, with noise"))
    \text{simulation}, \quad \text{with noise}
    """
    if not text.startswith("simulation"):
        return word(text)
    rest = text.removeprefix("simulation")
    between, rest = (r", \quad", rest[1:]) if rest[:1] in (",", ";") else (r" \,", rest)
    return f"{word('simulation')}{between} {word(rest.strip())}" if rest else word("simulation")


def _whole(code: Code, values: Values, spans: Mapping[str, float]) -> _Node:
    reader = _Reader(code, values, spans)
    change = reader.read(code.expression)
    if code.does == "adds":
        return _added(reader.word("simulated"), change)
    return _multiplied(reader.word("of"), change) if code.does == "scales rate" else change


@dataclass(eq=False, repr=False)
class _Reader:
    """Reads a template, with words and numbers for its names."""

    code: Code
    values: Values
    spans: Mapping[str, float]

    def read(self, template: str) -> _Node:
        names = {name: name for name in names_in(template)}
        return self.node(ast.parse(template.format_map(names), mode="eval").body)

    def node(self, tree: ast.expr) -> _Node:
        match tree:
            case ast.Name(id=name):
                return self.name(name)
            case ast.Constant(value=int() | float() as value):
                return _Number(value)
            case ast.UnaryOp(op=ast.USub(), operand=inner):
                return _negative(self.node(inner))
            case ast.BinOp(left=left, op=ast.BitAnd(), right=right):
                sides = (self.node(left), self.node(right))
                both = (side.parts for side in sides if isinstance(side, _Condition))
                return _Condition(tuple(part for parts in both for part in parts))
            case ast.BinOp(left=left, op=op, right=right):
                return self.operation(self.node(left), op, self.node(right), tree)
            case ast.Compare(left=left, ops=[op], comparators=[right]) if type(op) in _RELATIONS:
                place = self.node(left)
                return _Condition(((place, type(op), _resolved(place, self.node(right))),))
            case ast.Call(func=ast.Name(id="by_level")):
                return self.levels()
            case ast.Call(func=ast.Name(id="logistic"), args=[inner]):
                below = _added(_ONE, _Call("exp", (_negative(self.node(inner)),)))
                return _divided(_ONE, below)
            case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name), args=arguments):
                return _Call(_SHORT.get(name, name), tuple(map(self.node, arguments)))
            case ast.Attribute(attr="pi"):
                return _Word("pi", r"\pi")
        return self.other(tree)

    def other(self, tree: ast.expr) -> _Node:
        """Return what is none of these as it stands in Python."""
        text = ast.unparse(tree)
        return _Word(text, word(text))

    def operation(self, left: _Node, op: ast.operator, right: _Node, tree: ast.expr) -> _Node:
        match op:
            case ast.Add() | ast.Sub():
                right = _resolved(left, right)
                right = _negative(right) if isinstance(op, ast.Sub) else right
                if isinstance(left, _Number) and isinstance(right, _Number):
                    return replace(left, value=left.value + right.value)
                nothing = isinstance(right, _Number) and not right.value
                return left if nothing else _added(left, right)
            case ast.Mult():
                return _multiplied(left, right)
            case ast.Div():
                if isinstance(left, _Number) and isinstance(right, _Number) and right.value:
                    return replace(left, value=left.value / right.value)
                return _divided(left, right)
            case ast.Pow():
                return _Power(left, right)
        return self.other(tree)

    def name(self, name: str) -> _Node:
        code = self.code
        steps = {**code.steps, **code.by_row}
        if name in steps:
            return self.read(steps[name])
        if name in code.numbers and name in self.values:
            along = code.numbers[name].strip("{}") in (*code.columns, "t")
            return _Number(self.values[name], _DIGITS_OF_PLACE if along else _DIGITS)
        if name in code.constants:
            return _Number(code.constants[name], _DIGITS_OF_PLACE)
        if name in code.levels:
            return self.level(code.levels[name][1])
        return self.word(name)

    def word(self, name: str) -> _Word:
        if name == "phase":
            return _Word(name, r"\varphi")
        known = {**self.code.columns, **self.code.states, "simulated": "simulation"}
        text = known.get(name, self.code.of if name == "of" else name)
        return _Word(text, word(text), self.spans.get(text))

    def level(self, value: float) -> _Node:
        """Return a value of a column of labels, or its name."""
        if not self.code.labels:
            return _Number(value, _DIGITS_OF_LEVEL)
        name = self.code.labels[int(value)]
        return _Word(name, word(name))

    def levels(self) -> _Node:
        """Return the numbers of all levels, each where it is."""
        table = self.code.table
        assert table is not None
        column = _Word(table.column, word(table.column))
        terms = tuple(
            _multiplied(
                _Number(self.values[name]),
                _Condition(((column, ast.Eq, self.level(level)),)),
            )
            for level, name in table.levels
        )
        return _Sum(terms)


def _resolved(column: _Node, place: _Node) -> _Node:
    """Return a place on a column with digits that resolve its rows."""
    if not isinstance(column, _Word) or column.span is None or not isinstance(place, _Number):
        return place
    return replace(place, digits=max(digits_at(place.value, column.span), place.digits))


def _signed(node: _Node) -> tuple[int, _Node]:
    """Return the sign of a term, and the term without it."""
    if isinstance(node, _Number) and node.value < 0:
        return -1, replace(node, value=-node.value)
    return (node.sign, replace(node, sign=1)) if isinstance(node, _Product) else (1, node)


def _as_product(node: _Node) -> _Product:
    sign, size = _signed(node)
    return replace(size, sign=sign) if isinstance(size, _Product) else _Product(sign, (size,))


def _added(left: _Node, right: _Node) -> _Node:
    sides = (side.terms if isinstance(side, _Sum) else (side,) for side in (left, right))
    return _Sum(tuple(term for side in sides for term in side))


def _multiplied(left: _Node, right: _Node) -> _Node:
    a, b = _as_product(left), _as_product(right)
    return _Product(a.sign * b.sign, a.factors + b.factors, a.divisors + b.divisors)


def _divided(left: _Node, right: _Node) -> _Node:
    a, b = _as_product(left), _as_product(right)
    return _Product(a.sign * b.sign, a.factors + b.divisors, a.divisors + b.factors)


def _negative(node: _Node) -> _Node:
    if isinstance(node, _Number):
        return replace(node, value=-node.value)
    product = _as_product(node)
    return replace(product, sign=-product.sign)


def _is_output(node: _Node) -> bool:
    return (node.base if isinstance(node, _Power) else node) == _OUTPUT


@dataclass(frozen=True)
class _Printer:
    """Prints in plain text, or in LaTeX."""

    is_latex: bool

    def show(self, node: _Node, least: int = _SUM) -> str:
        """Return an expression, in brackets where it does not hold together enough."""
        text, holds = self.shown(node)
        if holds >= least:
            return text
        return rf"\left({text}\right)" if self.is_latex else f"({text})"

    def shown(self, node: _Node) -> tuple[str, int]:
        match node:
            case _Number(value, digits):
                text = number(value, digits) if self.is_latex else f"{value:.{digits}g}"
                return text, _WHOLE if value >= 0 else _SUM
            case _Word(text, latex):
                return latex if self.is_latex else text, _WHOLE
            case _Sum(terms):
                return self.sum(terms), _SUM
            case _Product(sign, factors, divisors):
                text = self.product(factors, divisors)
                return (f"-{text}", _SUM) if sign < 0 else (text, _PRODUCT)
            case _Power(base, exponent):
                raised = self.show(exponent, _SUM if self.is_latex else _WHOLE)
                raised = f"{{{raised}}}" if self.is_latex else raised
                return f"{self.show(base, _WHOLE)}^{raised}", _POWER
            case _Call("abs", (inner,)):
                return f"|{self.show(inner)}|", _WHOLE
            case _Call(name, arguments):
                inside = ", ".join(self.show(one) for one in arguments)
                if not self.is_latex:
                    return f"{name}({inside})", _WHOLE
                function = rf"\{name}" if name in _IN_LATEX else rf"\operatorname{{{name}}}"
                return rf"{function}\left({inside}\right)", _WHOLE
            case _Condition(parts):
                return self.condition(parts), _SUM

    def sum(self, terms: tuple[_Node, ...]) -> str:
        text = self.show(terms[0])
        for before, term in pairwise(terms):
            sign, size = _signed(term)
            # in words the condition of a term would hold for the next one, too
            factors = before.factors if isinstance(before, _Product) and not self.is_latex else ()
            comma = "," if any(isinstance(one, _Condition) for one in factors) else ""
            text += f"{comma} {'-' if sign < 0 else '+'} {self.show(size)}"
        return text

    def product(self, factors: tuple[_Node, ...], divisors: tuple[_Node, ...]) -> str:
        """Return factors over divisors, and where that holds."""
        where = [self.show(one) for one in factors if isinstance(one, _Condition)]
        factors = tuple(one for one in factors if not isinstance(one, _Condition))
        if not divisors:
            text = self.factors(factors)
        elif self.is_latex:
            sides = (
                self.show(s[0]) if len(s) == 1 else self.factors(s) for s in (factors, divisors)
            )
            text = r"\frac{{{}}}{{{}}}".format(*sides)
        else:
            below = self.show(divisors[0], _POWER)
            below = below if len(divisors) == 1 else f"({self.factors(divisors)})"
            text = f"{self.factors(factors)} / {below}"
        holds = r" \, \mathbf{{1}}_{{{}}}" if self.is_latex else " where {}"
        return text + "".join(map(holds.format, where))

    def factors(self, factors: tuple[_Node, ...]) -> str:
        factors = tuple(one for one in factors if one != _ONE) or (_ONE,)
        text, times = self.show(factors[0], _PRODUCT), (" ", " * ")
        times = (r" \, ", r" \cdot ") if self.is_latex else times
        for before, factor in pairwise(factors):
            apart = isinstance(factor, _Number) or _is_output(before) or _is_output(factor)
            text += times[apart] + self.show(factor, _PRODUCT)
        return text

    def condition(self, parts: tuple[tuple[_Node, type, _Node], ...]) -> str:
        if len(parts) == 2 and parts[0][0] == parts[1][0] and parts[0][1] in _TURNED:
            (column, first, low), (_, second, high) = parts
            names = [_RELATIONS[of][self.is_latex] for of in (_TURNED[first], second)]
            return f"{self.show(low)} {names[0]} {self.show(column)} {names[1]} {self.show(high)}"
        each = (
            f"{self.show(a)} {_RELATIONS[of][self.is_latex]} {self.show(b)}" for a, of, b in parts
        )
        return (r" \, \text{ and } \, " if self.is_latex else " and ").join(each)
