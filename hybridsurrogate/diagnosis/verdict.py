"""Who leads, who cannot be told apart, and the table of all causes."""

from __future__ import annotations

import numpy as np
import pandas as pd

from hybridsurrogate.diagnosis.evidence import Search, kind_of
from hybridsurrogate.effects.catalogue import Skipped

_SET_MASS = 0.9


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


def credible_kinds(found: Search) -> list[str]:
    """Return the kinds that together reach 90 % probability, most probable first."""
    kinds, mass = [], 0.0
    for kind, share in sorted(kind_shares(found).items(), key=lambda item: -item[1]):
        kinds.append(kind)
        mass += share
        if mass >= _SET_MASS:
            break
    return kinds


def cause_table(found: Search, skipped: list[Skipped]) -> pd.DataFrame:
    """Return one row a cause, most probable first, those not weighed last with the reason."""
    base = found.weighed[0].log_evidence
    rows = [
        {
            "kind": kind_of(w),
            "target": w.cause.target if w.cause else None,
            "probability": probability,
            "log_evidence": w.log_evidence - base,
            "remainder": remainder,
            "note": "",
        }
        for w, probability, remainder in zip(
            found.weighed, found.probability, found.remainder, strict=True
        )
    ]
    rows += [
        {
            "kind": s.kind,
            "target": s.target,
            "probability": 0.0,
            "log_evidence": np.nan,
            "remainder": np.nan,
            "note": f"not weighed: {s.reason}",
        }
        for s in skipped
    ]
    table = pd.DataFrame(rows).sort_values(
        "probability", ascending=False, kind="stable", ignore_index=True
    )
    return table
