"""One cause at its best with its evidence, and how probable each of several is."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from hybridsurrogate.diagnosis.search.context import Fitted
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.inference.evidence.settings import SETTINGS
from hybridsurrogate.types import FloatArray

# kinds that are no name for what is wrong
NAMELESS = ("none", "unexplained")
# less probable causes are not looked at again, not drawn, and not fitted to further data
MIN_PROBABILITY = 0.01


class Candidate(NamedTuple):
    """One cause (None: nothing is wrong) at its best, with its evidence.

    Attributes
    ----------
    cause : Cause or None
    fit : Fitted
    log_evidence : float
        Of the cause alone.
    log_evidence_with_remainder, log_evidence_with_noise : float
        Given a smooth discrepancy of unknown shape, and given noise that neighbouring rows share;
        minus infinity where not compared.
    is_estimate : bool
        Whether the evidence is that of a sample of the rows, in which it is far behind.
    """

    cause: Cause | None
    fit: Fitted
    log_evidence: float
    log_evidence_with_remainder: float = -np.inf
    log_evidence_with_noise: float = -np.inf
    is_estimate: bool = False

    def __repr__(self) -> str:
        name = "none" if self.cause is None else f"{self.cause.name}: {self.cause.variant}"
        return f"Candidate({name.removesuffix(': ')}, log_evidence={self.log_evidence:.2f})"

    def moved(self, by: float) -> Candidate:
        """Return the candidate with all its log evidence larger by so much."""
        return self._replace(
            log_evidence=self.log_evidence + by,
            log_evidence_with_remainder=self.log_evidence_with_remainder + by,
            log_evidence_with_noise=self.log_evidence_with_noise + by,
        )

    @property
    def kind(self) -> str:
        """The kind of the cause, "none" without one."""
        return "none" if self.cause is None else self.cause.kind

    @property
    def concerns(self) -> str:
        """What is at fault, "nothing" without a cause."""
        return "nothing" if self.cause is None else self.cause.concerns

    @property
    def has_name(self) -> bool:
        """Whether it says what is wrong."""
        return self.kind not in NAMELESS


def prior_odds(causes: Sequence[Cause | None]) -> FloatArray:
    """Return the prior probability of each cause, None for nothing that is wrong.

    Kinds share the prior equally, and the forms of a kind share that of their kind. Causes that
    differ only in their level share that of one form. What a cause chose from the data has a share
    of that (`Cause.log_prior_of_choice`).
    """
    kinds = ["none" if cause is None else cause.kind for cause in causes]
    forms = [
        (kind, cause.target if cause is not None and cause.is_one_level else k)
        for k, (kind, cause) in enumerate(zip(kinds, causes, strict=True))
    ]
    of_kind = Counter(kind for kind, _ in set(forms))
    of_form = Counter(forms)
    fixed = {"none": SETTINGS.prior_none, "unexplained": SETTINGS.prior_unexplained}
    share = (1 - sum(fixed.values())) / max(len(of_kind.keys() - fixed.keys()), 1)
    chosen = np.exp([0.0 if cause is None else cause.log_prior_of_choice for cause in causes])
    return chosen * np.array(
        [
            fixed.get(kind) or share / of_kind[kind] / of_form[form]
            for kind, form in zip(kinds, forms, strict=True)
        ]
    )


def prior_of(candidates: Sequence[Candidate]) -> FloatArray:
    """Return the prior probability of each candidate, (k,)."""
    return prior_odds([w.cause for w in candidates])


def probabilities(candidates: Sequence[Candidate]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the probability of each cause, of a remainder and of correlated noise given it."""
    parts = _alone_and_given(candidates)
    log_total = np.logaddexp.reduce(parts, axis=1)
    # of what is impossible there are no shares
    shares = np.exp(parts - np.where(np.isfinite(log_total), log_total, 0.0)[:, None])
    log_total = log_total + np.log(prior_of(candidates))
    return np.exp(log_total - np.logaddexp.reduce(log_total)), shares[:, 1], shares[:, 2]


def total_evidence(candidates: Sequence[Candidate]) -> FloatArray:
    """Return the log evidence of each cause, alone or given a process, whichever is true."""
    return np.asarray(np.logaddexp.reduce(_alone_and_given(candidates), axis=1))


def shares(
    candidates: Sequence[Candidate], probability: FloatArray, group: Callable[[Candidate], str]
) -> dict[str, float]:
    """Return the probability of each group of candidates, given that something is wrong.

    Parameters
    ----------
    candidates : sequence of Candidate
        "None" first.
    probability : ndarray of shape (k,)
    group : callable
        Of a candidate, such as its kind.
    """
    out: dict[str, float] = {}
    for w, share in zip(candidates[1:], probability[1:], strict=True):
        out[group(w)] = out.get(group(w), 0.0) + float(share)
    total = sum(out.values())
    return {name: value / total for name, value in out.items()} if total else out


def _alone_and_given(candidates: Sequence[Candidate]) -> FloatArray:
    """Return log evidence and prior of each cause alone, given a curve, given noise, (k, 3)."""
    alone = np.array([w.log_evidence for w in candidates])
    given = np.array(
        [[w.log_evidence_with_remainder, w.log_evidence_with_noise] for w in candidates]
    )
    # correlated noise is as probable before the data given a cause as without one
    odds = prior_of(candidates)
    alone_too = [w.cause is not None and w.cause.is_correlated_noise for w in candidates]
    paths = float(odds[alone_too].sum())
    # "none" with a remainder is "unexplained", which is compared separately
    named = np.array([w.cause is not None for w in candidates])
    splits = np.isfinite(given) & named[:, None]
    prior = np.where(splits, [SETTINGS.prior_remainder, paths / (paths + odds[0])], 0.0)
    with np.errstate(divide="ignore"):
        log_given = np.where(splits, given, 0.0) + np.log(prior)
    return np.column_stack([alone + np.log1p(-prior.sum(axis=1)), log_given])
