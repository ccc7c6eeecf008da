"""The evidence of a cause twice: as a search has it, and by importance sampling of its model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hybridsurrogate.diagnosis.search.context import SearchContext
from hybridsurrogate.diagnosis.search.exact_scores import _sized
from hybridsurrogate.diagnosis.search.search import Search, search
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.inference.posterior_sampler import evidence_around
from hybridsurrogate.inference.procedure import make_target
from hybridsurrogate.model.problem import Problem
from hybridsurrogate.model.statistics import emulator_posterior


def searched(problem: Problem, causes: Sequence[Cause]) -> Search:
    """Return the search over some causes of a simulation that is run, without remainders."""
    emulator = emulator_posterior(problem.model.basis, None)
    return search(SearchContext.of(problem, emulator), causes)


def by_importance(result: Search, k: int) -> float:
    """Return the log evidence of the k-th candidate of a search in normal rows."""
    candidate = result.candidates[k]
    model, starts = _sized(result, candidate)
    u = np.column_stack([starts, np.full(len(starts), np.log(candidate.fit.sigma))])
    target = make_target(replace(result.problem, model=model), 0.0, 1.0)
    return evidence_around(target, u, np.random.RandomState(0))


def both(problem: Problem, cause: Cause) -> tuple[float, float]:
    """Return the log evidence of a cause over that of none: of a search, and by importance."""
    result = searched(problem, [cause])
    none, one = result.candidates
    sampled = by_importance(result, 1) - by_importance(result, 0)
    return one.log_evidence - none.log_evidence, sampled
