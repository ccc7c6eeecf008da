"""Diagnoses that compare few kinds: where a test is not about which kind is found."""

from hybridsurrogate.effects.registry import kinds


def all_but(*kept: str) -> list[str]:
    """Return the kinds to exclude from a diagnosis, for which these are left."""
    return sorted({*kinds()} - {*kept})
