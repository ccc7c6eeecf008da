"""The table of all causes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from hybridsurrogate.catalogue import Skipped
from hybridsurrogate.diagnosis.answers.failures import failures
from hybridsurrogate.diagnosis.search.candidate import total_evidence
from hybridsurrogate.diagnosis.search.search import Search
from hybridsurrogate.effects.base import Cause

NOT_COMPARED = "not compared: "
ESTIMATED = "far behind in a sample of the rows, from which its evidence is estimated"


def form_of(cause: Cause) -> str:
    """Return the kind and, where it has several forms, which: "trend: quadratic"."""
    return f"{cause.kind}: {cause.variant}" if cause.variant else cause.kind


def cause_table(result: Search, skipped: list[Skipped]) -> pd.DataFrame:
    """Return one row a cause, most probable first, those not compared last with the reason."""
    evidence = total_evidence(result.candidates)
    notes = failures(result)
    rows = [
        {
            "kind": w.kind,
            "target": w.cause.target if w.cause else None,
            "form": form_of(w.cause) if w.cause else "none",
            "probability": probability,
            "log_evidence": log_evidence,
            "smooth_curve": remainder,
            "correlated": correlated,
            "note": note or (ESTIMATED if w.is_estimate else ""),
        }
        for w, probability, log_evidence, remainder, correlated, note in zip(
            result.candidates,
            result.probability,
            evidence - evidence[0],
            result.remainder,
            result.correlated,
            notes,
            strict=True,
        )
    ]
    rows += [
        {
            "kind": s.kind,
            "target": s.target,
            "form": s.kind,
            "probability": 0.0,
            "log_evidence": np.nan,
            "smooth_curve": np.nan,
            "correlated": np.nan,
            "note": f"{NOT_COMPARED}{s.reason}",
        }
        for s in skipped
    ]
    table = pd.DataFrame(rows).sort_values(
        "probability", ascending=False, kind="stable", ignore_index=True
    )
    return table


def not_reached(result: Search, causes: Sequence[Cause]) -> list[Skipped]:
    """Return the causes that an interrupted search left out."""
    reached = [w.cause for w in result.candidates]
    return [
        Skipped(cause.kind, cause.target, "the search was interrupted")
        for cause in causes
        if all(cause is not other for other in reached)
    ]


def is_compared(table: pd.DataFrame) -> pd.Series:
    """Return which rows of the table of causes were compared, not left out."""
    return ~table["note"].str.startswith(NOT_COMPARED)
