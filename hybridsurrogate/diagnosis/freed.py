"""The places of accepted causes, such as a period, free again to first order.

An accepted cause that is held at its place can neither give way to another one nor be as uncertain
as it is: a test of "nothing further" would be about this one place.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from hybridsurrogate.diagnosis.evidence import Search
from hybridsurrogate.inference.linearised import Linearised, linearise
from hybridsurrogate.priors import FloatArray

# half a difference, in standard normal coordinates: about the rows next to a step
_MOVE = 0.03


def freed(found: Search) -> Callable[[Linearised], Linearised]:
    """Return what adds the places of the accepted causes to a model linearised at the null fit."""
    problem, null = found.problem, found.weighed[0]
    model, plan, z = null.model, null.plan, null.peak.z
    taken = [*plan.fixed, *plan.sizes, *plan.nodes]
    places = np.setdiff1d(np.arange(model.n_unknowns), taken).astype(int)
    if not len(places):
        return lambda parts: parts
    parts = linearise(model, problem.X, found.belief, plan, z)
    ((unit, unequal),) = parts.at(np.zeros(1, dtype=int)).by_noise()
    G = unit.G[0]
    precision = null.sigma**2 * np.eye(G.shape[1]) + G.T @ G
    fitted = np.linalg.solve(precision, G.T @ (problem.y / unequal - unit.mean[0]))
    sizes = fitted[len(plan.fixed) :] * model.column_sd
    points = np.tile(z, (2, len(places), 1))
    points[0, range(len(places)), places] += _MOVE
    points[1, range(len(places)), places] -= _MOVE
    values = model.values(points.reshape(-1, len(z)))
    output, _, _ = model.simulated(problem.X, values, found.belief.mean)
    means = output + model.added(problem.X, values) @ sizes
    up, down = np.nan_to_num(means).reshape(2, len(places), -1)
    slopes: FloatArray = (up - down).T / (2 * _MOVE)

    def free(parts: Linearised) -> Linearised:
        wide = np.broadcast_to(slopes, (len(parts.G), *slopes.shape))
        return replace(
            parts,
            mean=parts.mean - slopes @ z[places],
            G=np.concatenate([parts.G, wide], axis=2),
        )

    return free
