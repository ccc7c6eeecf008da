"""Reasons to doubt a verdict: each stands in the first lines of the report and is a warning."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import NamedTuple

from hybridsurrogate.exceptions import DiagnosisWarning


class Caution(NamedTuple):
    """A reason to doubt the verdict.

    Attributes
    ----------
    about : {"data", "columns", "prior", "runs", "rows", "noise", "simulation"}
        Where to look first: single measurements, the table's columns and units, priors of
        parameters, runs of the simulation, too few rows, the likelihood, the simulation itself.
    sentence : str
        What is the matter, then what to do; complete sentences.
    """

    about: str
    sentence: str


def warn_of(cautions: Sequence[Caution], stacklevel: int) -> None:
    """Warn the caller of ``fit`` of each.

    Parameters
    ----------
    cautions : sequence of Caution
    stacklevel : int
    """
    for one in cautions:
        warnings.warn(one.sentence, DiagnosisWarning, stacklevel=stacklevel)
