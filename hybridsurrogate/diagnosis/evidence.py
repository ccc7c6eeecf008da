"""How well each cause explains the measured rows: closed-form evidence, and probabilities.

The surrogate's coefficients come from the simulation alone (beta = 1), so that a fault of the
simulation is not absorbed by its emulator; the emulator's own uncertainty is part of the
covariance (DESIGN section 6).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy import special

from hybridsurrogate.effects.base import Cause
from hybridsurrogate.effects.discrepancy_process import GaussianProcessDiscrepancy
from hybridsurrogate.effects.nothing import Nothing
from hybridsurrogate.estimators.problem import Problem
from hybridsurrogate.inference.layout import Layout, layout, refine
from hybridsurrogate.inference.linearised import Belief, linearise
from hybridsurrogate.inference.measured import MeasuredModel
from hybridsurrogate.inference.noise import NoiseTable
from hybridsurrogate.inference.scan import Peak, climb, scan
from hybridsurrogate.priors import FloatArray, to_normal

# effects between a fraction of the noise and a few times the spread of the output
_SMALLEST_SIZE, _LARGEST_SIZE, _N_SIZES = 0.3, 3.0, 10
# prior odds: half on "none", a small share for "unexplained", the rest shared by kinds
_PRIOR_NONE, _PRIOR_UNEXPLAINED = 0.5, 0.02
# prior probability that a named cause leaves a smooth remainder
_PRIOR_REMAINDER = 0.1
_MAX_REFINEMENTS = 5
# cells to either side of the best node that belong to the same peak
_NEIGHBOURS = 6
# noise below this share of the output's scale is rounding
_FLOOR = 1e-6
# causes this far (in nats) behind the best one after a first climb are not followed in earnest
_PROMISING = 12.0
_NEUTRAL_MOVES = (0.0, 0.7, -0.7)


class Weighed(NamedTuple):
    """One cause (None: nothing is wrong) at its best, with its evidence."""

    cause: Cause | None
    model: MeasuredModel
    plan: Layout
    peak: Peak
    sigma: float
    log_evidence: float
    log_evidence_with_remainder: float


@dataclass(frozen=True)
class Search:
    """A finished search over the catalogue.

    Attributes
    ----------
    problem : Problem
    belief : Belief
        About the surrogate's coefficients, from the simulation alone.
    weighed : list of Weighed
        "None" first, then the causes in the order of the catalogue.
    probability : ndarray
        Posterior probability of each.
    remainder : ndarray
        Probability that a smooth remainder is needed beside each cause.
    sizes : ndarray
        Prior scales of effect sizes, in units of eta.
    noise : NoiseTable
        Sigma integrated out under the problem's prior.
    """

    problem: Problem
    belief: Belief
    weighed: list[Weighed]
    probability: FloatArray
    remainder: FloatArray
    sizes: FloatArray
    noise: NoiseTable


def search(
    problem: Problem,
    causes: Sequence[Cause],
    belief: Belief,
    with_remainder: bool = True,
    accepted: Weighed | None = None,
) -> Search:
    """Weigh "nothing is wrong" and every cause.

    Parameters
    ----------
    problem : Problem
        Without effects, or with those that an earlier search accepted.
    causes : sequence of Cause
        Prepared.
    belief : Belief
        About the surrogate's coefficients, from the simulation alone.
    with_remainder : bool
        Also weigh the winners beside a smooth remainder of unknown shape.
    accepted : Weighed or None
        The last of the problem's effects as it was found, in place of "nothing is wrong".
    """
    noise = NoiseTable(problem.noise_prior, problem.scale, len(problem.y))
    if accepted is None:
        null = best_null(problem, belief, noise)
    else:
        null = _nothing_further(problem, accepted, belief)
    peaks = [null, *_peaks(problem, causes, belief, noise, null)]
    smallest = min(sigma for *_, sigma in peaks)
    sizes = np.geomspace(
        _SMALLEST_SIZE * smallest,
        max(_LARGEST_SIZE * problem.scale, 2 * _SMALLEST_SIZE * smallest),
        _N_SIZES,
    )
    weighed = []
    for cause, (model, plan, peak, sigma) in zip([None, *causes], peaks, strict=True):
        parts = linearise(model, problem.X, belief, plan, peak.z)
        nodes = scan(parts, problem.y[None], sigma, noise, sizes)[0]
        weighed.append(
            Weighed(cause, model, plan, peak, sigma, float(special.logsumexp(nodes)), -np.inf)
        )
    if with_remainder:
        weighed = _weigh_remainder(problem, belief, noise, weighed, sizes)
    probability, remainder = probabilities(weighed)
    return Search(problem, belief, weighed, probability, remainder, sizes, noise)


class _Fitted(NamedTuple):
    model: MeasuredModel
    plan: Layout
    peak: Peak
    sigma: float


def _nothing_further(problem: Problem, accepted: Weighed, belief: Belief) -> _Fitted:
    """Fit "nothing else is wrong" from where the accepted cause was found."""
    model = problem.model.with_effects((*problem.model.effects, Nothing()))
    plan, known = layout(model), accepted.plan
    z = accepted.peak.z.copy()
    if len(known.nodes):
        priors = [accepted.model.priors[k] for k in known.nodes]
        z[known.nodes] = to_normal(priors, _mean_node(problem, accepted, belief))
    largest = _LARGEST_SIZE * problem.scale
    peak = climb(model, problem.X, problem.y, belief, plan, z, accepted.sigma, largest)
    sigma = max(float(np.sqrt(peak.squares / len(problem.y))), _FLOOR * problem.scale)
    return _Fitted(model, plan, peak, sigma)


def _mean_node(problem: Problem, accepted: Weighed, belief: Belief) -> FloatArray:
    """Return the mean of the enumerated coordinates, (len(nodes),), around the best node.

    A node is only as near as its cell is small, and what it misses would look like another cause.
    """
    plan = accepted.plan
    parts = linearise(accepted.model, problem.X, belief, plan, accepted.peak.z)
    noise = NoiseTable(problem.noise_prior, problem.scale, len(problem.y))
    sizes = np.array([_LARGEST_SIZE * problem.scale])
    log_evidence = scan(parts, problem.y[None], accepted.sigma, noise, sizes)[0]
    best = int(np.argmax(log_evidence))
    reach = _NEIGHBOURS * np.diff(plan.edges[best], axis=1)[:, 0]
    near = np.all(np.abs(plan.grid - plan.grid[best]) <= reach, axis=1)
    weight = np.exp(log_evidence - log_evidence[best]) * near
    return weight @ plan.grid / weight.sum()


def best_null(problem: Problem, belief: Belief, noise: NoiseTable) -> _Fitted:
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


def _peaks(
    problem: Problem,
    causes: Sequence[Cause],
    belief: Belief,
    noise: NoiseTable,
    null: _Fitted,
) -> list[_Fitted]:
    """Fit every cause: once from the null fit, and in earnest where that looks promising."""
    fits = [best_peak(problem, cause, belief, noise, null, thorough=False) for cause in causes]
    sizes = np.geomspace(_SMALLEST_SIZE * null.sigma, _LARGEST_SIZE * problem.scale, 4)
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
        best_peak(problem, cause, belief, noise, null) if earnest else fit
        for cause, fit, earnest in zip(causes, fits, promising, strict=True)
    ]


def best_peak(
    problem: Problem,
    cause: Cause,
    belief: Belief,
    noise: NoiseTable,
    null: _Fitted,
    thorough: bool = True,
) -> _Fitted:
    """Fit one cause, starting from the null fit and from the prior's centre.

    A cause that is far behind already is followed from the null fit alone, on its first grid.
    """
    model = _with_cause(problem, cause)
    plan = layout(model)
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
        largest = _LARGEST_SIZE * problem.scale
        peak = climb(model, problem.X, problem.y, belief, plan, starts[0], null.sigma, largest)
        if np.isfinite(peak.objective):
            sigma = float(np.sqrt(peak.squares / len(problem.y)))
            return _Fitted(model, plan, peak, max(sigma, _FLOOR * problem.scale))
    return _best(problem, belief, noise, model, plan, starts, null.sigma)


def _best(
    problem: Problem,
    belief: Belief,
    noise: NoiseTable,
    model: MeasuredModel,
    plan: Layout,
    starts: Sequence[FloatArray],
    sigma: float,
) -> _Fitted:
    """Climb from every start, then again with the noise that the best fit suggests."""
    largest = _LARGEST_SIZE * problem.scale
    peaks = [climb(model, problem.X, problem.y, belief, plan, z, sigma, largest) for z in starts]
    peak = min(peaks, key=lambda found: found.objective)
    if not np.isfinite(peak.objective):
        return _Fitted(model, plan, peak, sigma)
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
    return _Fitted(model, plan, peak, sigma)


def _weigh_remainder(
    problem: Problem,
    belief: Belief,
    noise: NoiseTable,
    weighed: list[Weighed],
    sizes: FloatArray,
) -> list[Weighed]:
    """Weigh the winners of the quick search beside a smooth discrepancy of unknown shape."""
    quick, _ = probabilities(weighed)
    process = next((w for w in weighed if isinstance(w.cause, GaussianProcessDiscrepancy)), None)
    if process is None:
        return weighed
    model, lengths = process.model, layout(process.model)
    values = np.repeat(model.values(np.zeros((1, model.n_unknowns))), len(lengths.grid), axis=0)
    values[:, lengths.nodes] = lengths.grid
    own = [owner == len(model.effects) - 1 for owner, _ in model.column_names]
    bases = model.added(problem.X, values)[:, :, own]
    bases = bases / np.sqrt(np.mean(np.sum(bases**2, axis=2), axis=1))[:, None, None]
    named = [k for k, w in enumerate(weighed) if kind_of(w) not in ("none", "unexplained")]
    best = max(named, key=lambda k: quick[k], default=None)
    out = []
    for k, (w, probability) in enumerate(zip(weighed, quick, strict=True)):
        # the best named cause always has its chance: data usually hold more than one wrong thing
        if w is process or (probability < 0.01 and w.cause is not None and k != best):
            out.append(w)
            continue
        if w.cause is None:
            out.append(w._replace(log_evidence_with_remainder=process.log_evidence))
            continue
        parts = linearise(w.model, problem.X, belief, w.plan, w.peak.z)
        nodes = scan(parts, problem.y[None], w.sigma, noise, sizes)[0]
        parts = parts.at(np.flatnonzero(nodes > nodes.max() - 10.0))
        terms = [
            np.logaddexp.reduce(
                scan(
                    replace(parts, U=np.hstack([parts.U, size * basis])),
                    problem.y[None],
                    w.sigma,
                    noise,
                    sizes,
                )[0]
            )
            for basis in bases
            for size in sizes[::2]
        ]
        total = float(np.logaddexp.reduce(terms) - np.log(len(terms)))
        out.append(w._replace(log_evidence_with_remainder=total))
    return out


def probabilities(weighed: Sequence[Weighed]) -> tuple[FloatArray, FloatArray]:
    """Return the posterior probability of each cause, and that of a remainder beside it.

    Kinds share the prior equally, targets share that of their kind.
    """
    kinds = [kind_of(w) for w in weighed]
    named = {kind for kind in kinds if kind not in ("none", "unexplained")}
    prior = np.empty(len(weighed))
    for k, kind in enumerate(kinds):
        if kind == "none":
            prior[k] = _PRIOR_NONE
        elif kind == "unexplained":
            prior[k] = _PRIOR_UNEXPLAINED
        else:
            share = (1 - _PRIOR_NONE - _PRIOR_UNEXPLAINED) / len(named)
            prior[k] = share / kinds.count(kind)
    alone = np.array([w.log_evidence for w in weighed])
    beside = np.array([w.log_evidence_with_remainder for w in weighed])
    # "none" with a remainder is "unexplained", which is weighed on its own
    splits = np.array(
        [np.isfinite(b) and kind != "none" for b, kind in zip(beside, kinds, strict=True)]
    )
    with np.errstate(divide="ignore"):
        plain = alone + np.where(splits, np.log1p(-_PRIOR_REMAINDER), 0.0)
        extra = np.where(splits, beside + np.log(_PRIOR_REMAINDER), -np.inf)
    log_total = np.logaddexp(plain, extra) + np.log(prior)
    remainder = np.exp(extra - np.logaddexp(plain, extra))
    return np.exp(log_total - special.logsumexp(log_total)), remainder


def kind_of(weighed: Weighed) -> str:
    """Return the kind of a weighed cause, "none" for the null."""
    return "none" if weighed.cause is None else weighed.cause.kind
