"""Who leads, and who cannot be told apart."""

from __future__ import annotations

from hybridsurrogate.diagnosis.search.evidence import Search, Weighed, kind_of
from hybridsurrogate.inference.evidence.settings import SETTINGS

_VERDICTS = {"none": "adequate", "unexplained": "unexplained"}


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
    return "named" if kind_shares(found)[kind] >= SETTINGS.named else "ambiguous"


def credible_kinds(found: Search) -> list[str]:
    """Return the kinds that together reach 90 % probability, most probable first."""
    kinds, mass = [], 0.0
    for kind, share in sorted(kind_shares(found).items(), key=lambda item: -item[1]):
        kinds.append(kind)
        mass += share
        if mass >= SETTINGS.set_mass:
            break
    return kinds
