"""Who leads, who cannot be told apart, and the table of all causes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from hybridsurrogate.diagnosis.evidence import Search, Weighed, kind_of
from hybridsurrogate.diagnosis.failures import failures
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.effects.catalogue import Skipped

_SET_MASS = 0.9
# one cause is "named" when it is three times as probable as all its rivals together
_NAMED = 0.75
_VERDICTS = {"none": "adequate", "unexplained": "unexplained"}
NOT_WEIGHED = "not weighed: "


def leader(found: Search) -> int:
    """Return the position of the most probable cause other than "none", by kind then target."""
    shares = kind_shares(found)
    kind = max(shares, key=lambda name: shares[name])
    member = [k for k, w in enumerate(found.weighed) if kind_of(w) == kind]
    return max(member, key=lambda k: found.probability[k])


def kind_shares(found: Search) -> dict[str, float]:
    """Return the probability of each kind, given that something is wrong."""
    shares: dict[str, float] = {}
    for w, probability in zip(found.weighed[1:], found.probability[1:], strict=True):
        shares[kind_of(w)] = shares.get(kind_of(w), 0.0) + float(probability)
    total = sum(shares.values())
    return {kind: value / total for kind, value in shares.items()} if total else shares


def verdict_on(chosen: Weighed, found: Search) -> str:
    """Return the verdict, given what the search chose."""
    kind = kind_of(chosen)
    if kind in _VERDICTS:
        return _VERDICTS[kind]
    return "named" if kind_shares(found)[kind] >= _NAMED else "ambiguous"


def credible_kinds(found: Search) -> list[str]:
    """Return the kinds that together reach 90 % probability, most probable first."""
    kinds, mass = [], 0.0
    for kind, share in sorted(kind_shares(found).items(), key=lambda item: -item[1]):
        kinds.append(kind)
        mass += share
        if mass >= _SET_MASS:
            break
    return kinds


def form_of(cause: Cause) -> str:
    """Return the kind and, where it has several forms, which: "trend: quadratic"."""
    return f"{cause.kind}: {cause.variant}" if cause.variant else cause.kind


def cause_table(found: Search, skipped: list[Skipped]) -> pd.DataFrame:
    """Return one row a cause, most probable first, those not weighed last with the reason."""
    base = found.weighed[0].log_evidence
    notes = failures(found)
    rows = [
        {
            "kind": kind_of(w),
            "target": w.cause.target if w.cause else None,
            "form": form_of(w.cause) if w.cause else "none",
            "probability": probability,
            "log_evidence": w.log_evidence - base,
            "remainder": remainder,
            "note": note,
        }
        for w, probability, remainder, note in zip(
            found.weighed, found.probability, found.remainder, notes, strict=True
        )
    ]
    rows += [
        {
            "kind": s.kind,
            "target": s.target,
            "form": s.kind,
            "probability": 0.0,
            "log_evidence": np.nan,
            "remainder": np.nan,
            "note": f"{NOT_WEIGHED}{s.reason}",
        }
        for s in skipped
    ]
    table = pd.DataFrame(rows).sort_values(
        "probability", ascending=False, kind="stable", ignore_index=True
    )
    return table


def not_reached(found: Search, causes: Sequence[Cause]) -> list[Skipped]:
    """Return the causes that an interrupted search left out."""
    reached = [w.cause for w in found.weighed]
    return [
        Skipped(cause.kind, cause.target, "the search was interrupted")
        for cause in causes
        if all(cause is not other for other in reached)
    ]


def is_weighed(table: pd.DataFrame) -> pd.Series:
    """Return which rows of the table of causes were weighed, not left out."""
    return ~table["note"].str.startswith(NOT_WEIGHED)
