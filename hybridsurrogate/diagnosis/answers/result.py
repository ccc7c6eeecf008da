"""What a search ended with, for whoever reads it: report, averages, further folds."""

from __future__ import annotations

from dataclasses import dataclass

from hybridsurrogate.diagnosis.search.evidence import Search, kind_of
from hybridsurrogate.diagnosis.search.forward_selection import SearchStep
from hybridsurrogate.diagnosis.search.null_test import NullTest


@dataclass(frozen=True)
class DiagnosisResult:
    """The search of one fit; a later `set_params` does not change it.

    Attributes
    ----------
    steps : tuple of SearchStep
        One for each search, each given the causes that were accepted before it.
    asked : Search
        The one whose alternatives a further measurement would best separate.
    test : NullTest
        Of the first search.
    false_alarm_rate : float
    n_replicates : int
    """

    steps: tuple[SearchStep, ...]
    asked: Search
    test: NullTest
    false_alarm_rate: float
    n_replicates: int

    def __repr__(self) -> str:
        found = ", ".join(kind_of(step.chosen) for step in self.steps)
        return f"DiagnosisResult({found}; {len(self.steps)} steps, p = {self.test.p_value:.3g})"
