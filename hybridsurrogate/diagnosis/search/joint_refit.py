"""Two causes placed together: each anew given the other, until they converge.

A cause that was placed alone also explains what it can of another cause, and stands a little off
its place. Fixed there it biases the other: a period that is five per cent off leaves a wave.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import special

from hybridsurrogate.diagnosis.search.conditioning import (
    conditioned_places,
    nothing_further,
    placed_anew,
)
from hybridsurrogate.diagnosis.search.evidence import Candidate, Search
from hybridsurrogate.diagnosis.search.local_fit import Fitted, node_evidence
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.inference.evidence.grid import Grid
from hybridsurrogate.inference.evidence.levenberg_marquardt import is_followed
from hybridsurrogate.inference.evidence.settings import SETTINGS
from hybridsurrogate.model.problem import Problem


def placed_together(result: Search, first: Candidate, conditional: Search) -> Search:
    """Return the search given a first cause, with the best second causes placed together with it.

    Parameters
    ----------
    result : Search
        In which ``first`` was compared.
    first : Candidate
    conditional : Search
        For a further cause, with ``first`` fixed at its fit.
    """
    evidence = np.array([w.log_evidence for w in conditional.candidates])
    able = [k for k, w in enumerate(conditional.candidates) if w.cause and movable(w.cause)]
    able = sorted(able, key=lambda k: -evidence[k])[: SETTINGS.most_second_causes]
    if first.cause is None or not movable(first.cause) or not able:
        return conditional
    candidates = list(conditional.candidates)
    for k in able:
        if evidence[k] > evidence[able[0]] - SETTINGS.second_cause_behind:
            candidates[k] = _together(result, first, conditional, candidates[k])
    return conditional.reweighed(candidates)


def movable(cause: Cause) -> bool:
    """Whether a cause is in the mean, and cheap enough to be placed again and again.

    A curve of any shape is, too: a second cause that is not placed would keep an advantage.
    """
    return cause.changes_output and not is_followed(cause)


def _together(
    result: Search, first: Candidate, conditional: Search, second: Candidate
) -> Candidate:
    """Return the second cause with the first at its best place given it.

    The evidence of two causes a and b that are placed at a*, b* is that of a with b fixed plus that
    of b with a fixed, less that of both fixed. This is exact where one place does not depend on the
    other, too small where it does. What the first explains alone is subtracted, so that the result
    compares with the evidence of "nothing further".
    """
    problem, base = result.problem, conditional.candidates[0].log_evidence
    assert first.cause is not None
    assert second.cause is not None
    best = second._replace(log_evidence=-np.inf)
    fit, reached = Fitted(*second[1:5]), second.log_evidence
    for _ in range(SETTINGS.turns):
        turned = _turned(result, fit, first.grid)
        back = _turned(result, turned, second.grid)
        if not np.isfinite(turned.mode.objective + back.mode.objective):
            break
        both = replace(problem, model=problem.model.with_effects(back.model.effects))
        neither = nothing_further(both, back, result.emulator, result.noise)
        alone = _log_evidence(both, conditional, back)
        pair = (
            _log_evidence(both, result, turned) + alone - _log_evidence(both, conditional, neither)
        )
        if (value := base + pair - first.log_evidence) > best.log_evidence:
            best = Candidate(second.cause, *back, value)
        if alone < reached + SETTINGS.worth_a_turn:
            break
        fit, reached = back, alone
    return best if np.isfinite(best.log_evidence) else second


def _turned(result: Search, fit: Fitted, cells: Grid) -> Fitted:
    """Return the last but one cause placed anew, the last one fixed at its fit."""
    problem, model = result.problem, fit.model
    *before, one, other = model.effects
    turned = problem.model.with_effects((*before, other, one))
    old = [(id(model.effects[owner]), name) for owner, name in model.theta_names]
    new = [(id(turned.effects[owner]), name) for owner, name in turned.theta_names]
    d = model.n_parameters
    order = [*range(d), *(d + old.index(key) for key in new)]
    starts = [z[order] for z in conditioned_places(problem, fit, result.emulator, result.noise)]
    return placed_anew(problem, turned, starts, fit.sigma, cells, result.emulator, result.noise)


def _log_evidence(problem: Problem, search: Search, fit: Fitted) -> float:
    nodes = node_evidence(problem, search.emulator, search.noise, fit, search.sizes)
    return float(special.logsumexp(nodes))
