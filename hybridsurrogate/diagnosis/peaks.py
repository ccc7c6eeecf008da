"""Where each cause fits best: climbs from several starts, grids refined where the evidence is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import special

from hybridsurrogate.diagnosis.interruption import InterruptedSearch
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.effects.nothing import Nothing
from hybridsurrogate.estimators.problem import Problem
from hybridsurrogate.inference.layout import Layout, at_cells, layout, refine
from hybridsurrogate.inference.linearised import Belief, linearise
from hybridsurrogate.inference.measured import MeasuredModel
from hybridsurrogate.inference.multistart import best_of_many, is_followed
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


# causes this far (in nats) behind the best one are not followed in earnest: after a first climb,
# which may have found a lower hill, and where the climbs in other rows ended, which is nearly it
_FAR_BEHIND, _FAR_BEHIND_NEARBY = 12.0, 6.0


# a fit this many times closer than without the cause is as good as exact
_NEGLIGIBLE = 1e-3


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
    plan = layout(model)
    peak = _highest(
        problem, belief, model, plan, held(problem, accepted, belief, noise), accepted.sigma
    )
    return Fitted(model, plan, peak, _sigma_of(problem, peak, accepted.sigma))


def held(problem: Problem, accepted: Fitted, belief: Belief, noise: NoiseTable) -> list[FloatArray]:
    """Return where an accepted cause can be held: at the mean of its place, or at the best node.

    The mean is the better place, but only on the hill on which the best node is.
    """
    model, plan, peak, _ = accepted
    if not len(plan.nodes):
        return [peak.z]
    places = [_mean_node(problem, accepted, belief, noise)]
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
    belief: Belief,
    noise: NoiseTable,
) -> Fitted:
    """Fit a model from starts near its peak, its last cause's grid as fine as it already was."""
    plan = at_cells(model, layout(model), edges)
    peak = _highest(problem, belief, model, plan, starts, sigma)
    return _settled(problem, belief, noise, Fitted(model, plan, peak, sigma))


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
    sigma = 0.3 * problem.scale
    peak = _highest(problem, belief, model, plan, [z[0], *starts], sigma)
    return _settled(problem, belief, noise, Fitted(model, plan, peak, sigma))


def best_peaks(
    problem: Problem,
    causes: Sequence[Cause],
    belief: Belief,
    noise: NoiseTable,
    null: Fitted,
    nearby: Sequence[Fitted] | None = None,
) -> tuple[list[Fitted], FloatArray]:
    """Fit every cause: from one start, and in earnest where that looks promising.

    ``nearby`` are the peaks of the same causes in other rows of the same data: they stand for that
    first climb, and what is promising is followed from there alone. An `InterruptedSearch` holds
    the fits of the first so many causes.

    Returns
    -------
    fits : list of Fitted
    behind : ndarray
        Log evidence of the causes that are far behind, from few sizes; NaN for the others.
    """
    fits: list[Fitted] = []
    try:
        for k, cause in enumerate(causes):
            model = problem.model.with_effects((*problem.model.effects, cause))
            plan = layout(model)
            if is_followed(cause):
                # with every unknown followed a start is a choice, which other rows must not make
                fits.append(_followed(problem, belief, noise, model, plan, null))
            elif nearby is None or _is_noise_process(model):
                fits.append(_once(problem, belief, model, plan, null))
            else:
                fits.append(_unmoved(problem, model, plan, nearby[k]))
        margin = _FAR_BEHIND if nearby is None else _FAR_BEHIND_NEARBY
        behind = _far_behind(problem, belief, noise, null, fits, margin)
        for k in map(int, np.flatnonzero(np.isnan(behind))):
            model, plan, peak, sigma = fits[k]
            if _is_noise_process(model) or is_followed(model.effects[-1]):
                continue
            if nearby is None:
                sigma = null.sigma
                others = _starts(model, plan, null)[1:]
                other = _highest(problem, belief, model, plan, others, sigma)
                peak = min(peak, other, key=lambda found: found.objective)
            fits[k] = _settled(problem, belief, noise, Fitted(model, plan, peak, sigma))
    except KeyboardInterrupt as stop:
        raise InterruptedSearch(fits) from stop
    return fits, behind


def _followed(
    problem: Problem,
    belief: Belief,
    noise: NoiseTable,
    model: MeasuredModel,
    plan: Layout,
    null: Fitted,
) -> Fitted:
    """Fit a cause whose unknowns are all followed, from many starts."""
    plain, floor = plan.followed(), _NEGLIGIBLE * null.sigma
    z, sigma = best_of_many(model, problem.X, problem.y, belief, plan, null.peak.z, floor)
    peak = _highest(problem, belief, model, plain, [z], sigma)
    return _settled(problem, belief, noise, Fitted(model, plain, peak, sigma))


def _unmoved(problem: Problem, model: MeasuredModel, plan: Layout, other: Fitted) -> Fitted:
    """Return the fit to other rows as one to these, on the first grid, before any climb."""
    if not np.isfinite(other.peak.objective):
        return Fitted(model, plan, other.peak, other.sigma)
    peak = Peak(other.peak.z, len(problem.y) * other.sigma**2, 0.0, 0)
    return Fitted(model, plan, peak, other.sigma)


def _once(
    problem: Problem,
    belief: Belief,
    model: MeasuredModel,
    plan: Layout,
    null: Fitted,
) -> Fitted:
    """Climb once, on the first grid."""
    start, sigma = _starts(model, plan, null)[0], null.sigma
    if _is_noise_process(model):
        # left free it would take all the noise there is: it has the size of the noise
        peak = climb(model, problem.X, problem.y, belief, plan, start, sigma, sigma)
        return Fitted(model, plan, peak, sigma)
    peak = _highest(problem, belief, model, plan, [start], sigma)
    return Fitted(model, plan, peak, _sigma_of(problem, peak, sigma))


def _far_behind(
    problem: Problem,
    belief: Belief,
    noise: NoiseTable,
    null: Fitted,
    fits: Sequence[Fitted],
    margin: float,
) -> FloatArray:
    """Return the log evidence of fits that are far behind; NaN for the others, failed or not."""
    sizes = np.geomspace(SMALLEST_SIZE * null.sigma, LARGEST_SIZE * problem.scale, 4)
    reached = np.empty(len(fits))
    for k, (model, plan, peak, sigma) in enumerate(fits):
        parts = linearise(model, problem.X, belief, plan, peak.z)
        nodes = scan(parts, problem.y[None], sigma, noise, sizes)[0]
        reached[k] = special.logsumexp(nodes)
    # a curve of any shape reaches high at once: named causes are compared with each other; what
    # could not be followed at all gets its other starting points, too
    named = [fit.model.effects[-1].kind != "unexplained" for fit in fits]
    behind = reached < np.max(reached[named], initial=-np.inf) - margin
    behind &= np.isfinite(reached)
    return np.where(behind, reached, np.nan)


def _is_noise_process(model: MeasuredModel) -> bool:
    cause = model.effects[-1]
    return cause.is_process and not cause.changes_output


def _starts(model: MeasuredModel, plan: Layout, null: Fitted) -> list[FloatArray]:
    """Return starting points: the null fit first, then other sizes, then the prior's centre."""
    centres = [null.peak.z]
    if np.linalg.norm(null.peak.z[: model.n_parameters]) > 1.0:
        # the simulation's parameters start anew, accepted causes stay where they are
        anew = null.peak.z.copy()
        anew[: model.n_parameters] = 0.0
        centres.append(anew)
    starts = []
    for centre in centres:
        for move in _NEUTRAL_MOVES if len(plan.sizes) else (0.0,):
            z = plan.neutral.copy()
            z[: len(centre)] = centre
            z[plan.sizes] += move
            starts.append(z)
    return starts


def _sigma_of(problem: Problem, peak: Peak, sigma: float) -> float:
    """Return the noise that a fit suggests; the one it was made with where it failed."""
    if not np.isfinite(peak.objective):
        return sigma
    return max(float(np.sqrt(peak.squares / len(problem.y))), _FLOOR * problem.scale)


def _highest(
    problem: Problem,
    belief: Belief,
    model: MeasuredModel,
    plan: Layout,
    starts: Sequence[FloatArray],
    sigma: float,
) -> Peak:
    """Climb from every start and return the best fit; one at infinity where there is no start."""
    largest = LARGEST_SIZE * problem.scale
    peaks = [climb(model, problem.X, problem.y, belief, plan, z, sigma, largest) for z in starts]
    nowhere = Peak(plan.neutral, np.inf, np.inf, 0)
    return min(peaks, key=lambda found: found.objective, default=nowhere)


def _settled(problem: Problem, belief: Belief, noise: NoiseTable, fit: Fitted) -> Fitted:
    """Climb on with the noise that the fit suggests, and a finer grid where the evidence is."""
    model, plan, peak, sigma = fit
    if not np.isfinite(peak.objective):
        return fit
    largest = LARGEST_SIZE * problem.scale
    for round_ in range(_MAX_REFINEMENTS):
        sigma = _sigma_of(problem, peak, sigma)
        finer = plan
        if len(plan.nodes):
            parts = linearise(model, problem.X, belief, plan, peak.z)
            nodes = scan(parts, problem.y[None], sigma, noise, np.array([largest]))[0]
            finer = refine(model, plan, nodes)
        settled = finer is plan and round_ > 0
        plan = finer
        if settled:
            break
        peak = climb(model, problem.X, problem.y, belief, plan, peak.z, sigma, largest)
    return Fitted(model, plan, peak, sigma)
