"""Where an accepted cause is held while a further one is weighed, and both placed anew."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hybridsurrogate.diagnosis.search.local_fit import (
    Fitted,
    highest,
    largest_size,
    node_evidence,
    settled,
    sigma_of,
)
from hybridsurrogate.effects.nothing import Nothing
from hybridsurrogate.inference.conjugate.emulator_posterior import EmulatorPosterior
from hybridsurrogate.inference.conjugate.noise_marginal import LogMarginal
from hybridsurrogate.inference.evidence.grid import at_cells, layout
from hybridsurrogate.inference.evidence.settings import SETTINGS
from hybridsurrogate.inference.model.observation import MeasuredModel
from hybridsurrogate.priors import FloatArray, to_normal
from hybridsurrogate.problem.problem import Problem


def nothing_further(
    problem: Problem, accepted: Fitted, emulator: EmulatorPosterior, noise: LogMarginal
) -> Fitted:
    """Fit "nothing else is wrong" from where the accepted cause was found."""
    model = problem.model.with_effects((*problem.model.effects, Nothing()))
    plan = layout(model)
    peak = highest(
        problem, emulator, model, plan, held(problem, accepted, emulator, noise), accepted.sigma
    )
    return Fitted(model, plan, peak, sigma_of(problem, peak, accepted.sigma))


def held(
    problem: Problem, accepted: Fitted, emulator: EmulatorPosterior, noise: LogMarginal
) -> list[FloatArray]:
    """Return where an accepted cause can be held: at the mean of its place, or at the best node.

    The mean is the better place, but only on the hill on which the best node is.
    """
    model, plan, peak, _ = accepted
    if not len(plan.nodes):
        return [peak.z]
    places = [_mean_node(problem, accepted, emulator, noise)]
    low, high = plan.edges[peak.node].T
    if not np.all((places[0] >= low) & (places[0] <= high)):
        places.append(plan.grid[peak.node])
    out = np.repeat(peak.z[None], len(places), axis=0)
    out[:, plan.nodes] = [to_normal([model.priors[k] for k in plan.nodes], p) for p in places]
    return list(out)


def placed_anew(
    problem: Problem,
    model: MeasuredModel,
    starts: Sequence[FloatArray],
    sigma: float,
    edges: FloatArray,
    emulator: EmulatorPosterior,
    noise: LogMarginal,
) -> Fitted:
    """Fit a model from starts near its peak, its last cause's grid as fine as it already was."""
    plan = at_cells(model, layout(model), edges)
    peak = highest(problem, emulator, model, plan, starts, sigma)
    return settled(problem, emulator, noise, Fitted(model, plan, peak, sigma))


def _mean_node(
    problem: Problem, accepted: Fitted, emulator: EmulatorPosterior, noise: LogMarginal
) -> FloatArray:
    """Return the mean of the enumerated coordinates, (len(nodes),), around the best node.

    A node is only as near as its cell is small, and what it misses would look like another cause.
    """
    plan = accepted.plan
    sizes = np.array([largest_size(problem)])
    log_evidence = node_evidence(problem, emulator, noise, accepted, sizes)
    best = int(np.argmax(log_evidence))
    reach = SETTINGS.same_mode * np.diff(plan.edges[best], axis=1)[:, 0]
    near = np.all(np.abs(plan.grid - plan.grid[best]) <= reach, axis=1)
    weight = np.exp(log_evidence - log_evidence[best]) * near
    return weight @ plan.grid / weight.sum()
