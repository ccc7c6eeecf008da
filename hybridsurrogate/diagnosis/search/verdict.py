"""Who leads, and who cannot be told apart."""

from __future__ import annotations

from hybridsurrogate.diagnosis.search.evidence import Candidate, Search, kind_of
from hybridsurrogate.inference.evidence.settings import SETTINGS

_VERDICTS = {"none": "adequate", "unexplained": "unexplained"}


def leader(result: Search) -> int:
    """Return the position of the most probable cause other than "none", by kind then target."""
    shares = kind_shares(result)
    kind = max(shares, key=lambda name: shares[name])
    member = [k for k, w in enumerate(result.candidates) if kind_of(w) == kind]
    return max(member, key=lambda k: result.probability[k])


def kind_shares(result: Search) -> dict[str, float]:
    """Return the probability of each kind, given that something is wrong."""
    shares: dict[str, float] = {}
    for w, probability in zip(result.candidates[1:], result.probability[1:], strict=True):
        shares[kind_of(w)] = shares.get(kind_of(w), 0.0) + float(probability)
    total = sum(shares.values())
    return {kind: value / total for kind, value in shares.items()} if total else shares


def verdict_on(chosen: Candidate, result: Search) -> str:
    """Return the verdict, given what the search chose."""
    kind = kind_of(chosen)
    if kind in _VERDICTS:
        return _VERDICTS[kind]
    return "named" if kind_shares(result)[kind] >= SETTINGS.named else "ambiguous"


def credible_kinds(result: Search) -> list[str]:
    """Return the kinds that together reach 90 % probability, most probable first."""
    kinds, mass = [], 0.0
    for kind, share in sorted(kind_shares(result).items(), key=lambda item: -item[1]):
        kinds.append(kind)
        mass += share
        if mass >= SETTINGS.set_mass:
            break
    return kinds
