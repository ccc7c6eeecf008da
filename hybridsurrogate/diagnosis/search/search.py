"""Every cause compared with "nothing is wrong" and with the others, on the measured rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.diagnosis.search.candidate import (
    NAMELESS,
    Candidate,
    prior_odds,
    probabilities,
    shares,
)
from hybridsurrogate.diagnosis.search.context import Fitted, InterruptedSearch, SearchContext
from hybridsurrogate.diagnosis.search.screening import best_modes
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.inference.evidence.settings import SETTINGS
from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.model.problem import Problem
from hybridsurrogate.types import FloatArray


@dataclass(frozen=True)
class Search:
    """A finished search over the catalogue.

    Attributes
    ----------
    context : SearchContext
    candidates : list of Candidate
        "None" first, then the causes in the order of the catalogue.
    sizes : ndarray
        Prior scales of effect sizes, in units of eta.
    probability : ndarray
        Posterior probability of each.
    remainder : ndarray
        Probability that a smooth remainder is needed in addition to each cause.
    correlated : ndarray
        Probability that, given each cause, the noise of neighbouring rows is correlated.
    """

    context: SearchContext
    candidates: list[Candidate]
    sizes: FloatArray
    probability: FloatArray
    remainder: FloatArray
    correlated: FloatArray

    @classmethod
    def of(cls, context: SearchContext, candidates: list[Candidate], sizes: FloatArray) -> Search:
        """Return a search with the probabilities that follow from the evidence."""
        return cls(context, candidates, sizes, *probabilities(candidates))

    def __repr__(self) -> str:
        order = np.argsort(-self.probability)[:3]
        best = ", ".join(f"{self.candidates[k].kind} {self.probability[k]:.2f}" for k in order)
        rows = len(self.problem.y)
        return f"Search({len(self.candidates)} candidates on {rows} rows; {best})"

    @property
    def problem(self) -> Problem:
        """The problem without effects, or with those that an earlier search accepted."""
        return self.context.problem

    @property
    def kind_shares(self) -> dict[str, float]:
        """Probability of each kind, given that something is wrong."""
        return shares(self.candidates, self.probability, lambda w: w.kind)

    @property
    def leader(self) -> int:
        """The position of the most probable cause other than "none".

        By what it concerns first, then by kind, then by target: what only scatters the measurements
        and what changes the mean do not win by being split among more kinds.
        """
        families = shares(self.candidates, self.probability, lambda w: w.concerns)
        of_kind = self.kind_shares
        family = max(families, key=lambda name: families[name])
        among = {w.kind for w in self.candidates[1:] if w.concerns == family}
        # of equal kinds the first of the catalogue
        kind = max((k for k in of_kind if k in among), key=lambda name: of_kind[name])
        anywhere = kind in NAMELESS  # a curve of any shape, where it beats every kind of these
        if anywhere:
            kind = max(of_kind, key=lambda name: of_kind[name])
        member = [
            k
            for k, w in enumerate(self.candidates)
            if k and w.kind == kind and (anywhere or w.concerns == family)
        ]
        return max(member, key=lambda k: self.probability[k])

    @property
    def credible_kinds(self) -> list[str]:
        """The kinds that together reach 90 % probability, most probable first."""
        kinds, mass = [], 0.0
        for kind, share in sorted(self.kind_shares.items(), key=lambda item: -item[1]):
            kinds.append(kind)
            mass += share
            if mass >= SETTINGS.set_mass:
                break
        return kinds

    def place_of(self, cause: Cause | None) -> int | None:
        """Return the position of a cause, None where it was not compared."""
        return next((k for k, w in enumerate(self.candidates) if w.cause is cause), None)

    def compares(self, model: MeasuredModel, causes: Sequence[Cause]) -> bool:
        """Whether it compares the same causes, in other rows, given the same causes of a model."""

        def forms(some: Sequence[Cause]) -> list[tuple[str, ...]]:
            # other rows may lack an experiment, which has a separate number
            return [(cause.name, cause.variant, *cause.parameters) for cause in some]

        own = [w.cause for w in self.candidates if w.cause is not None]
        return forms(self.problem.model.effects) == forms(model.effects) and forms(own) == forms(
            causes
        )

    def reweighed(self, candidates: list[Candidate]) -> Search:
        """Return the search with other evidence for its candidates."""
        return Search.of(self.context, candidates, self.sizes)


def search(
    context: SearchContext,
    causes: Sequence[Cause],
    accepted: Candidate | None = None,
    nearby: Search | None = None,
) -> Search:
    """Compare "nothing is wrong" and every cause alone.

    Parameters
    ----------
    context : SearchContext
    causes : sequence of Cause
        Prepared.
    accepted : Candidate or None
        The last of the problem's effects as it was fitted, in place of "nothing is wrong".
    nearby : Search or None
        The search over the same causes in other rows of the same data (`Search.compares`): only
        what is promising there is optimised, from where it ended there. Grids are searched anew,
        but an optimisation may keep to its hill.

    Raises
    ------
    InterruptedSearch
        On an interrupt: it contains the search over the causes that were fitted by then.
    """
    null = context.best_null() if accepted is None else context.nothing_further(accepted.fit)
    ends = [w.fit for w in nearby.candidates[1:]] if nearby is not None else None
    compared = np.arange(len(causes)) if nearby is None else _within_reach(nearby, causes)
    some = [causes[int(k)] for k in compared]
    log_prior = np.log(prior_odds([None, *causes]))[[0, *(1 + compared)]]
    fits: Sequence[Fitted] = []
    is_sample = nearby is not None and len(nearby.problem.y) < len(context.problem.y)
    try:
        near = None if ends is None else [ends[k] for k in compared]
        fits, behind = best_modes(context, some, null, log_prior, near, is_sample)
    except KeyboardInterrupt as stop:
        kept = [null, *(stop.kept if isinstance(stop, InterruptedSearch) else fits)]
        unknown = np.full(len(kept), np.nan)
        raise InterruptedSearch(_compare(context, some, kept, unknown)) from stop
    every, known = list(ends or fits), np.full(1 + len(causes), -np.inf)
    for k, fit in zip(compared, fits, strict=True):
        every[k] = fit
    known[0], known[1 + compared] = np.nan, behind
    result = _compare(context, causes, [null, *every], known)
    return _estimated(result, nearby) if nearby is not None and is_sample else result


def _estimated(result: Search, sample: Search) -> Search:
    """Return the search with the evidence that a sample, as so much of it, has for the rest."""
    none, few = result.candidates[0].log_evidence, sample.candidates[0].log_evidence
    share = len(result.problem.y) / len(sample.problem.y)
    return result.reweighed(
        [
            w._replace(log_evidence=none + share * (of_few.log_evidence - few), is_estimate=True)
            if w.log_evidence == -np.inf
            else w
            for w, of_few in zip(result.candidates, sample.candidates, strict=True)
        ]
    )


def _within_reach(nearby: Search, causes: Sequence[Cause]) -> NDArray[np.intp]:
    """Return the causes that may explain some of the rows best, given a search in all of them.

    Processes are always compared: what has no other explanation in few rows is theirs.
    """
    with np.errstate(divide="ignore"):
        log_share = np.log(nearby.probability[1:])
    best = np.max(log_share, initial=-np.inf)
    always = np.array([cause.is_process or cause.is_correlated_noise for cause in causes])
    return np.flatnonzero(always | (log_share > best - SETTINGS.pruned_nearby))


def _compare(
    context: SearchContext,
    causes: Sequence[Cause],
    modes: Sequence[Fitted],
    known: FloatArray,
) -> Search:
    """Compare "nothing is wrong" and the first so many causes at their best fits.

    ``known`` is the log evidence where it is known well enough already, NaN elsewhere; minus
    infinity for causes that are not compared.
    """
    compared = [fit for fit, evidence in zip(modes, known, strict=False) if evidence != -np.inf]
    sizes = context.sizes(compared)
    candidates = []
    for cause, fit, evidence in zip([None, *causes], modes, known, strict=False):
        value = context.evidence(fit, sizes) if np.isnan(evidence) else float(evidence)
        candidates.append(Candidate(cause, fit, value))
    return Search.of(context, candidates, sizes)
