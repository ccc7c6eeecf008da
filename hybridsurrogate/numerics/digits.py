"""Numbers with as many digits as they deserve."""

from __future__ import annotations

import math


def number(value: float, digits: int = 4) -> str:
    """Return a number with at least so many significant digits, no needless zeros."""
    if not math.isfinite(value):
        return "unknown"
    if value and not 1e-4 <= abs(value) < 1e7:
        return f"{value:.{digits - 1}e}"
    decimals = digits - 1 - (math.floor(math.log10(abs(value))) if value else 0)
    text = fixed(value, max(decimals, 0))
    return text.rstrip("0").rstrip(".") if "." in text else text


def fixed(value: float, decimals: int) -> str:
    """Return a number rounded to so many decimals; negative ones round to tens and hundreds."""
    if not math.isfinite(value):
        return "unknown"
    text = f"{round(value, decimals):.{max(decimals, 0)}f}"
    return text.lstrip("-") if not float(text) else text


def interval(mean: float, low: float, high: float) -> str:
    """Return a mean and its interval, two digits of half its width."""
    width = high - low
    if width == 0:
        return number(mean, 6)
    size = max(abs(mean), abs(low), abs(high))
    # far from zero, as times since 1970 are, only the width says how many digits count
    small, large = size < 1e-4, size >= 1e7 and width > 1e-3 * size
    if not math.isfinite(width) or width <= 0 or small or large:
        return f"{number(mean)} ({number(low)} to {number(high)})"
    decimals = 1 - math.floor(math.log10(width / 2))
    return f"{fixed(mean, decimals)} ({fixed(low, decimals)} to {fixed(high, decimals)})"


def plus_minus(value: float, error: float, sign: bool = False) -> str:
    """Return a value and its standard error, two digits of the error."""
    decimals = _decimals(error)
    plus = "+" if sign and value > 0 else ""
    return f"{plus}{fixed(value, decimals)} ± {fixed(error, decimals)}"


def score(value: float, error: float) -> str:
    """Return a score, rounded to the digits of its standard error."""
    return fixed(value, _decimals(error))


def percent(share: float) -> str:
    """Return a share in percent; never 0 or 100 % of what is only nearly so."""
    return f"{100 * share:.0f} %" if share in (0, 1) else probability(share)


def probability(share: float) -> str:
    """Return a probability in percent: never 0 or 100 %, as no data are certain."""
    value = 100 * share
    if value < 0.1:
        return "less than 0.1 %"
    if value > 99.9:
        return "more than 99.9 %"
    return f"{value:.0f} %" if 9.95 <= value <= 99 else f"{value:.1f} %"


def at_least(value: float, least: float = 0.01) -> str:
    """Return a number with two digits, or that it is less than what matters."""
    return f"less than {least:g}" if value < least else number(value, 2)


def listing(words: list[str]) -> str:
    """Return words in a row: a, b and c."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def _decimals(error: float) -> int:
    if not (math.isfinite(error) and error > 0):
        return 3
    return max(1 - math.floor(math.log10(error)), 0)
