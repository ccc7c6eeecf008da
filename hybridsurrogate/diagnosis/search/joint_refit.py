"""Two causes placed together: each anew given the other, until they converge.

A cause that was placed alone also explains what it can of another cause, and stands a little off
its place. Fixed there it biases the other: a period that is five per cent off leaves a wave.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hybridsurrogate.diagnosis.search.candidate import Candidate
from hybridsurrogate.diagnosis.search.context import Fitted
from hybridsurrogate.diagnosis.search.search import Search
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.inference.evidence.grid import Grid
from hybridsurrogate.inference.evidence.levenberg_marquardt import is_followed
from hybridsurrogate.inference.evidence.settings import SETTINGS


def placed_together(
    result: Search, first: Candidate, conditional: Search, nearby: Search | None = None
) -> Search:
    """Return the search given a first cause, with the best second causes placed together with it.

    Parameters
    ----------
    result : Search
        In which ``first`` was compared.
    first : Candidate
    conditional : Search
        For a further cause, with ``first`` fixed at its fit.
    nearby : Search or None
        The same in other rows, where causes are placed together: those far behind stay.
    """
    evidence = np.array([w.log_evidence for w in conditional.candidates])
    able = [k for k, w in enumerate(conditional.candidates) if w.cause and movable(w.cause)]
    able = sorted(able, key=lambda k: -evidence[k])[: SETTINGS.most_second_causes]
    if first.cause is None or not movable(first.cause) or not able:
        return conditional
    candidates = list(conditional.candidates)
    elsewhere = np.array([w.log_evidence for w in nearby.candidates]) if nearby else evidence
    behind = SETTINGS.pruned_nearby if nearby else SETTINGS.second_cause_behind
    for k in able:
        near = elsewhere[k] > max(elsewhere[able]) - behind
        if near and evidence[k] > evidence[able[0]] - SETTINGS.second_cause_behind:
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
    base, sizes = conditional.candidates[0].log_evidence, conditional.sizes
    best = second._replace(log_evidence=-np.inf)
    fit, reached = second.fit, second.log_evidence
    for _ in range(SETTINGS.turns):
        turned = _turned(result, fit, first.fit.grid)
        back = _turned(result, turned, second.fit.grid)
        if not np.isfinite(turned.mode.objective + back.mode.objective):
            break
        both = result.context.at(replace(result.problem, model=back.model))
        neither = both.nothing_further(back)
        alone = both.evidence(back, sizes)
        pair = both.evidence(turned, result.sizes) + alone - both.evidence(neither, sizes)
        if (value := base + pair - first.log_evidence) > best.log_evidence:
            best = Candidate(second.cause, back, value)
        if alone < reached + SETTINGS.worth_a_turn:
            break
        fit, reached = back, alone
    return best if np.isfinite(best.log_evidence) else second


def _turned(result: Search, fit: Fitted, cells: Grid) -> Fitted:
    """Return the last but one cause placed anew, the last one fixed at its fit."""
    *before, one, other = fit.model.effects
    turned, order = fit.model.reordered((*before, other, one))
    starts = [z[order] for z in result.context.places_of(fit)]
    return result.context.placed_anew(turned, starts, fit.sigma, cells)
