"""Names and numbers in LaTeX, in the part of it that matplotlib's mathtext reads too."""

from __future__ import annotations

import math

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
    >>> from hybridsurrogate.effects.notation import word
    >>> print(word("contact_rate"))
    \text{contact\_rate}
    """
    inside = "".join(_IN_TEXT.get(character, character) for character in text)
    return rf"\text{{{inside}}}".replace(r"\text{}", "")


def number(value: float, digits: int = 4) -> str:
    r"""Return a number with so many significant digits.

    Examples
    --------
    >>> from hybridsurrogate.effects.notation import number
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
    >>> from hybridsurrogate.effects.notation import digits_at
    >>> digits_at(31.2, 100.0), digits_at(738042.8, 100.0)
    (5, 8)
    """
    size = abs(scale)
    if not 0 < size < math.inf or not math.isfinite(place):
        return least
    return least + math.floor(math.log10(max(abs(place) / size, 1.0)))
