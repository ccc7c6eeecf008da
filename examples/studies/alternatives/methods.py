"""The methods that are compared, and what each of them has words for."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np
from hidden_effects.by_hand import diagnose_by_hand
from hidden_effects.by_package import diagnose
from hidden_effects.forms import KINDS

from hybridsurrogate.effects.registry import kinds as whole_catalogue

from . import sparse_terms, structure, symbolic, toolbox
from .calibration import Measurements


class Method(NamedTuple):
    """A function of measurements and a seed; ``kind`` and ``predict`` are in what it returns."""

    title: str
    words: tuple[str, ...]  # the kinds that it can name
    answer: Callable[[Measurements, int], dict[str, Any]]
    library: str | None = None  # what has to be installed

    @property
    def trouble(self) -> str:
        """Why it cannot run here, or nothing."""
        if self.library is None or find_spec(self.library):
            return ""
        return f"{self.library} is not installed (extra `bench`)"


def _package(measured: Measurements, seed: int) -> dict[str, Any]:
    return diagnose(measured, seed)


def _package_of_nine(measured: Measurements, seed: int) -> dict[str, Any]:
    return diagnose(measured, seed, sorted({*whole_catalogue()} - {*KINDS}))


def _by_hand(measured: Measurements, seed: int) -> dict[str, Any]:
    return diagnose_by_hand(*measured, np.random.default_rng(seed))


METHODS = {
    "hybridsurrogate": Method("hybridsurrogate", KINDS, _package),
    "hybridsurrogate-nine": Method("hybridsurrogate, nine kinds only", KINDS, _package_of_nine),
    "by-hand": Method("least squares by hand, BIC", KINDS, _by_hand),
    "toolbox": Method("toolbox of tests", toolbox.WORDS, toolbox.diagnose),
    "structure": Method("Gaussian-process structure search", structure.WORDS, structure.diagnose),
    "pysindy": Method(
        "PySINDy, extended BIC", sparse_terms.WORDS, sparse_terms.diagnose, "pysindy"
    ),
    "pysindy-default": Method(
        "PySINDy, defaults",
        sparse_terms.WORDS_BY_DEFAULT,
        sparse_terms.diagnose_by_default,
        "pysindy",
    ),
    "gplearn": Method("gplearn", symbolic.WORDS, symbolic.diagnose, "gplearn"),
}
