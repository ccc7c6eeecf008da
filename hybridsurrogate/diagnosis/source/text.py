"""Names, numbers and calls as Python source."""

from __future__ import annotations

import keyword
import math
import re
import textwrap
import unicodedata
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from hybridsurrogate.effects.expressions import digits_at
from hybridsurrogate.numerics.digits import interval
from hybridsurrogate.types import FloatArray

# of a line of code: a choice of presentation
LINE_WIDTH = 88
# what modules call things themselves, and what is hard to read
RESERVED = re.findall(
    r"\w+",
    "np solve_ivp RectBivariateSpline float dict zip list len isinstance min max enumerate tuple "
    "simulation simulated output outputs rhs initial_state observe state states slopes seen "
    "extended rows by_level by_name each_row in_curves curve_of_level right_hand_side solutions "
    "solution START STEP OUTPUTS STATES SIZES SOLVER FIRST I l O sigma numbers columns times first "
    "derivative solved ends latest ago which moment piece late longest lags logistic added there "
    "gone moved_term",
)


class Names:
    """Identifiers for any names, each once."""

    def __init__(self, taken: Iterable[str]):
        self.taken = set(taken)

    def new(self, text: str) -> str:
        """Return an identifier that is like a text, and none that is taken."""
        # Python reads identifiers in this form, in which two may be one
        name = re.sub(r"\W", "_", unicodedata.normalize("NFKC", text)) or "x"
        name = name if name.strip("_") else "x" + name
        name = f"x{name}" if not name.isidentifier() else name
        if keyword.iskeyword(name) or name in self.taken:
            name = next(
                free
                for k in range(1, len(self.taken) + 3)
                if (free := f"{name}_{k if k > 1 else ''}") not in self.taken
            )
        self.taken.add(name)
        return name

    def local(self, text: str) -> str:
        """Return an identifier that is none of those taken, for one function alone."""
        name = self.new(text)
        self.taken.remove(name)
        return name


def inline(text: str) -> str:
    """Return any text as part of a comment or of a docstring: one line, and no end of it."""
    plain = "".join(c if c.isprintable() else " " for c in text)
    return plain.replace("\\", "/").replace('"""', "'''").strip()


def text_of(value: float) -> str:
    """Return a number as a literal."""
    value = float(value)
    if not math.isfinite(value):
        return "np.nan" if math.isnan(value) else "np.inf" if value > 0 else "-np.inf"
    return repr(value)


def literal(text: str) -> str:
    """Return a string as source, in double quotes; what cannot be printed is escaped."""
    shown = repr(text)
    inside = shown[1:-1]
    if shown.startswith("'"):
        inside = inside.replace("\\'", "'").replace('"', '\\"')
    return f'"{inside}"'


def tuple_of(texts: Sequence[str]) -> str:
    """Return strings as a tuple in source."""
    return f"({', '.join(map(literal, texts))}{',' if len(texts) == 1 else ''})"


def dict_of(values: Mapping[str, str]) -> str:
    """Return a dict of names and of what stands for them."""
    return f"{{{', '.join(f'{literal(key)}: {value}' for key, value in values.items())}}}"


def estimate(draws: FloatArray) -> tuple[str, str]:
    """Return the mean of draws as a literal, and their 90 % interval in words."""
    draws = np.ravel(np.asarray(draws, dtype=float))
    mean = float(draws.mean())
    low, high = (float(end) for end in np.quantile(draws, [0.05, 0.95]))
    if not high > low:
        return text_of(mean), ""
    # six digits beyond those of its interval: rounding is no part of the error
    digits = min(digits_at(mean, high - low, 6), 17)
    ends = re.search(r"\((.*)\)", interval(mean, low, high))
    return text_of(float(f"{mean:.{digits}g}")), f"90 %: {ends.group(1)}" if ends else ""


def array_of(name: str, values: FloatArray) -> list[str]:
    """Return an array of numbers with six digits."""
    wrapped = []
    for row in np.atleast_2d(values):
        text = ", ".join(repr(float(f"{value:.6g}")) for value in row)
        lines = textwrap.wrap(text, LINE_WIDTH - 8)
        wrapped += [f"    [{lines[0]}", *(f"     {line}" for line in lines[1:])]
        wrapped[-1] += "],"
    flat = [] if np.ndim(values) == 2 else [""]
    end = "])[0]" if flat else "])"
    return ["# fmt: off", f"{name} = np.array([", *wrapped, end, "# fmt: on"]


def definition(name: str, arguments: Sequence[str]) -> str:
    """Return the first line of a function, or its lines where it is long."""
    line = f"def {name}({', '.join(arguments)}):"
    if len(line) <= LINE_WIDTH:
        return line
    return "\n".join([f"def {name}(", *(f"    {one}," for one in arguments), "):"])


def call(name: str, arguments: Sequence[str], before: str = "", indent: int = 4) -> str:
    """Return a line that calls a function, over several lines where it is long."""
    space = " " * indent
    line = f"{space}{before}{name}({', '.join(arguments)})"
    if len(line) <= LINE_WIDTH:
        return line
    inside = f"{space}    {', '.join(arguments)}"
    if len(inside) <= LINE_WIDTH and not any(one.startswith("*") for one in arguments):
        return "\n".join([f"{space}{before}{name}(", inside, f"{space})"])
    return "\n".join(
        [f"{space}{before}{name}(", *(f"{space}    {one}," for one in arguments), f"{space})"]
    )


def keywords(names: Iterable[str], ids: Mapping[str, str]) -> list[str]:
    """Return arguments by name, those with names that are no identifiers in a dict."""
    names = list(names)
    plain = [n for n in names if n.isidentifier() and not keyword.iskeyword(n)]
    plain = [n for n in plain if unicodedata.normalize("NFKC", n) == n]
    others = [f"{literal(n)}: {ids[n]}" for n in names if n not in plain]
    return [
        *(f"{n}={ids[n]}" for n in plain),
        *([f"**{{{', '.join(others)}}}"] if others else []),
    ]
