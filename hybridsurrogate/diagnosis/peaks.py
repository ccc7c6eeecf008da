"""Where each cause fits best: climbs from several starts, grids refined where the evidence is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import special

from hybridsurrogate.effects.base import Cause
from hybridsurrogate.effects.nothing import Nothing
from hybridsurrogate.estimators.problem import Problem
from hybridsurrogate.inference.layout import Layout, layout, refine
from hybridsurrogate.inference.linearised import Belief, linearise
from hybridsurrogate.inference.measured import MeasuredModel
from hybridsurrogate.inference.noise import NoiseTable
from hybridsurrogate.inference.scan import Peak, climb, scan
from hybridsurrogate.priors import FloatArray, to_normal

# effects between a fraction of the noise and a few times the spread of the output
SMALLEST_SIZE, LARGEST_SIZE = 0.3, 3.0


_MAX_REFINEMENTS = 5


# cells to either side of the best node that belong to the same peak
_NEIGHBOURS = 6


# noise below this share of the output's scale is rounding
_FLOOR = 1e-6


# causes this far (in nats) behind the best one after a first climb are not followed in earnest
_PROMISING = 12.0


_NEUTRAL_MOVES = (0.0, 0.7, -0.7)


class Fitted(NamedTuple):
    """A model at its best fit: the layout of its last cause, the peak and the noise there."""

    model: MeasuredModel
    plan: Layout
    peak: Peak
    sigma: float


def nothing_further(
    problem: Problem, accepted: Fitted, belief: Belief, noise: NoiseTable
) -> Fitted:
    """Fit "nothing else is wrong" from where the accepted cause was found."""
    model = problem.model.with_effects((*problem.model.effects, Nothing()))
    plan, known = layout(model), accepted.plan
    z = accepted.peak.z.copy()
    if len(known.nodes):
        priors = [accepted.model.priors[k] for k in known.nodes]
        z[known.nodes] = to_normal(priors, _mean_node(problem, accepted, belief, noise))
    largest = LARGEST_SIZE * problem.scale
    peak = climb(model, problem.X, problem.y, belief, plan, z, accepted.sigma, largest)
    sigma = max(float(np.sqrt(peak.squares / len(problem.y))), _FLOOR * problem.scale)
    return Fitted(model, plan, peak, sigma)


def _mean_node(problem: Problem, accepted: Fitted, belief: Belief, noise: NoiseTable) -> FloatArray:
    """Return the mean of the enumerated coordinates, (len(nodes),), around the best node.

    A node is only as near as its cell is small, and what it misses would look like another cause.
    """
    plan = accepted.plan
    parts = linearise(accepted.model, problem.X, belief, plan, accepted.peak.z)
    sizes = np.array([LARGEST_SIZE * problem.scale])
    log_evidence = scan(parts, problem.y[None], accepted.sigma, noise, sizes)[0]
    best = int(np.argmax(log_evidence))
    reach = _NEIGHBOURS * np.diff(plan.edges[best], axis=1)[:, 0]
    near = np.all(np.abs(plan.grid - plan.grid[best]) <= reach, axis=1)
    weight = np.exp(log_evidence - log_evidence[best]) * near
    return weight @ plan.grid / weight.sum()


def best_null(problem: Problem, belief: Belief, noise: NoiseTable) -> Fitted:
    """Fit "nothing is wrong" from several starting points."""
    model = problem.model
    plan = layout(model)
    d = model.n_unknowns
    # a fixed spread of starts: the search has no randomness of its own
    z = np.vstack([np.zeros(d), np.random.RandomState(0).standard_normal((16 * d, d))])
    known, features, factor = model.simulated(problem.X, model.values(z))
    squares = np.sum(((problem.y - known - features @ belief.mean) / factor) ** 2, axis=1)
    squares = np.where(np.isfinite(squares), squares, np.inf)
    starts = z[np.argsort(squares)[:2]]
    return _best(problem, belief, noise, model, plan, [z[0], *starts], 0.3 * problem.scale)


def _with_cause(problem: Problem, cause: Cause) -> MeasuredModel:
    return problem.model.with_effects((*problem.model.effects, cause))


def best_peaks(
    problem: Problem,
    causes: Sequence[Cause],
    belief: Belief,
    noise: NoiseTable,
    null: Fitted,
) -> list[Fitted]:
    """Fit every cause: once from the null fit, and in earnest where that looks promising."""
    fits = [_best_peak(problem, cause, belief, noise, null, thorough=False) for cause in causes]
    sizes = np.geomspace(SMALLEST_SIZE * null.sigma, LARGEST_SIZE * problem.scale, 4)
    reached = np.empty(len(fits))
    for k, (model, plan, peak, sigma) in enumerate(fits):
        parts = linearise(model, problem.X, belief, plan, peak.z)
        nodes = scan(parts, problem.y[None], sigma, noise, sizes)[0]
        reached[k] = special.logsumexp(nodes)
    # a curve of any shape reaches high at once: named causes are compared with each other; what
    # could not be followed at all gets its other starting points, too
    named = [cause.kind != "unexplained" for cause in causes]
    promising = ~(reached < np.max(reached[named], initial=-np.inf) - _PROMISING)
    return [
        _best_peak(problem, cause, belief, noise, null) if earnest else fit
        for cause, fit, earnest in zip(causes, fits, promising, strict=True)
    ]


def _best_peak(
    problem: Problem,
    cause: Cause,
    belief: Belief,
    noise: NoiseTable,
    null: Fitted,
    thorough: bool = True,
) -> Fitted:
    """Fit one cause, starting from the null fit and from the prior's centre.

    A cause that is far behind already is followed from the null fit alone, on its first grid.
    """
    model = _with_cause(problem, cause)
    plan = layout(model)
    if cause.is_process and not cause.changes_output:
        # correlated noise left free would take all the noise there is: it has the size of the noise
        z = np.concatenate([null.peak.z, plan.neutral[len(null.peak.z) :]])
        peak = climb(model, problem.X, problem.y, belief, plan, z, null.sigma, null.sigma)
        return Fitted(model, plan, peak, null.sigma)
    starts = []
    centres = [null.peak.z]
    if np.linalg.norm(null.peak.z[: model.n_parameters]) > 1.0:
        # the simulation's parameters start anew, accepted causes stay where they are
        anew = null.peak.z.copy()
        anew[: model.n_parameters] = 0.0
        centres.append(anew)
    for z_parameters in centres:
        for move in _NEUTRAL_MOVES if len(plan.sizes) else (0.0,):
            z = plan.neutral.copy()
            z[: len(z_parameters)] = z_parameters
            z[plan.sizes] += move
            starts.append(z)
    if not thorough:
        largest = LARGEST_SIZE * problem.scale
        peak = climb(model, problem.X, problem.y, belief, plan, starts[0], null.sigma, largest)
        if np.isfinite(peak.objective):
            sigma = float(np.sqrt(peak.squares / len(problem.y)))
            return Fitted(model, plan, peak, max(sigma, _FLOOR * problem.scale))
    return _best(problem, belief, noise, model, plan, starts, null.sigma)


def _best(
    problem: Problem,
    belief: Belief,
    noise: NoiseTable,
    model: MeasuredModel,
    plan: Layout,
    starts: Sequence[FloatArray],
    sigma: float,
) -> Fitted:
    """Climb from every start, then again with the noise that the best fit suggests."""
    largest = LARGEST_SIZE * problem.scale
    peaks = [climb(model, problem.X, problem.y, belief, plan, z, sigma, largest) for z in starts]
    peak = min(peaks, key=lambda found: found.objective)
    if not np.isfinite(peak.objective):
        return Fitted(model, plan, peak, sigma)
    sizes = np.array([largest])
    for round_ in range(_MAX_REFINEMENTS):
        sigma = max(float(np.sqrt(peak.squares / len(problem.y))), _FLOOR * problem.scale)
        finer = plan
        if len(plan.nodes):
            parts = linearise(model, problem.X, belief, plan, peak.z)
            log_evidence = scan(parts, problem.y[None], sigma, noise, sizes)[0]
            finer = refine(model, plan, log_evidence)
        settled = finer is plan and round_ > 0
        plan = finer
        if settled:
            break
        peak = climb(model, problem.X, problem.y, belief, plan, peak.z, sigma, largest)
    return Fitted(model, plan, peak, sigma)
