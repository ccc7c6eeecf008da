"""Several causes: each one compared again, given all others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from hybridsurrogate.diagnosis.search.conditioning import conditioned_places
from hybridsurrogate.diagnosis.search.evidence import Candidate, Search, leader, search
from hybridsurrogate.diagnosis.search.forward_selection import SearchStep, ends_search
from hybridsurrogate.diagnosis.search.local_fit import Fitted
from hybridsurrogate.effects.base import Cause, Nothing
from hybridsurrogate.inference.evidence.grid import make_grid
from hybridsurrogate.inference.evidence.settings import SETTINGS
from hybridsurrogate.model.problem import Problem


def backfitted(
    steps: Sequence[SearchStep], problem: Problem, causes: Sequence[Cause]
) -> list[SearchStep]:
    """Return the steps, each cause compared again with all others part of the simulation.

    Alone the first cause also has to explain what the second one does, and a smooth curve may do
    that better than either: how probable each is shows only given the others. A cause is replaced
    where an alternative is more probable. A smooth curve or outliers that were accepted last stay
    out, as nothing is compared given them.

    Parameters
    ----------
    steps : sequence of SearchStep
    problem : Problem
        Without effects.
    causes : sequence of Cause
        All that were compared in the first search.
    """
    out = list(steps)
    named = [k for k, step in enumerate(out) if not ends_search(step.chosen)]
    if len(named) < 2:
        return out
    joint = out[named[-1]]
    stale = set(named[:-1])
    for k in named * SETTINGS.backfitting_rounds:
        if k not in stale:
            continue
        found = _without(out[k].chosen, joint, problem, causes)
        best = found.candidates[leader(found)]
        if ends_search(best):
            best = next(w for w in found.candidates if w.cause is out[k].chosen.cause)
        stale = stale - {k} if best.cause is out[k].chosen.cause else set(named) - {k}
        joint = out[k] = replace(out[k], chosen=best, conditional=found)
    return out


def _without(
    left_out: Candidate, joint: SearchStep, problem: Problem, causes: Sequence[Cause]
) -> Search:
    """Search for one cause, all others fixed where they are in the joint fit of all of them."""
    known = joint.conditional
    model, _, mode, sigma = fit = Fitted(*joint.chosen[1:5])
    others = [cause for cause in model.effects if cause is not left_out.cause]
    extended = replace(problem, model=problem.model.with_effects(others))
    old = [(id(model.effects[owner]), name) for owner, name in model.theta_names]
    new = [(id(others[owner]), name) for owner, name in extended.model.theta_names]
    d = model.n_parameters
    order = [*range(d), *(d + old.index(key) for key in new)]
    z = conditioned_places(known.problem, fit, known.emulator, known.noise)[0][order]
    # all places are known: there is no grid to look at
    grid = make_grid(extended.model.with_effects([*others, Nothing()]))
    accepted = Candidate(None, extended.model, grid, mode._replace(z=z), sigma, 0.0, 0.0)
    alternatives = [cause for cause in causes if all(cause is not other for other in others)]
    return search(extended, alternatives, known.emulator, True, accepted)
