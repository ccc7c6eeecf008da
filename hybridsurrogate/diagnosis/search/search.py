"""Every cause compared with "nothing is wrong" and with the others, on the measured rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.diagnosis.search.candidate import (
    MIN_PROBABILITY,
    NAMELESS,
    Candidate,
    prior_odds,
    probabilities,
    shares,
)
from hybridsurrogate.diagnosis.search.context import Fitted, InterruptedSearch, SearchContext
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.inference.evidence.grid import Grid, make_grid, refine, with_cells
from hybridsurrogate.inference.evidence.levenberg_marquardt import (
    best_of_global_starts,
    best_of_many,
    is_followed,
)
from hybridsurrogate.inference.evidence.linearised import Linearised, linearise
from hybridsurrogate.inference.evidence.marginal_likelihood import LocalMode, scan, shortened
from hybridsurrogate.inference.evidence.settings import SETTINGS
from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.model.problem import Problem
from hybridsurrogate.numerics.linear_algebra import NEGLIGIBLE
from hybridsurrogate.scoring.scores import COVERAGE_LEVEL
from hybridsurrogate.types import FloatArray


def best_modes(
    context: SearchContext,
    causes: Sequence[Cause],
    null: Fitted,
    log_prior: FloatArray,
    nearby: Sequence[Fitted | None],
    is_coarse: bool,
) -> tuple[list[Fitted], FloatArray]:
    """Fit every cause: from one start, and from more where that looks promising.

    ``log_prior`` is that of "nothing is wrong" and of every cause. ``nearby`` are the modes of the
    same causes in other rows of the same data, None without one: they stand for that first
    optimisation and, unless ``is_coarse``, for all of it. An `InterruptedSearch` contains the fits
    of the first so many causes.

    Returns
    -------
    fits : list of Fitted
    behind : ndarray
        Log evidence of the causes that are far behind, on the first grid; NaN for the others.
    """
    problem = context.problem
    fits: list[Fitted] = []
    # single rows are others in other rows, and correlated noise has the size of the noise there
    ends = [
        None if cause.is_correlated_noise or cause.concerns == "data" else end
        for cause, end in zip(causes, nearby, strict=True)
    ]
    try:
        for k, cause in enumerate(causes):
            model = problem.model.with_effects((*problem.model.effects, cause))
            grid = make_grid(model)
            if is_followed(cause):
                # with every unknown followed a start is a choice, which other rows must not make
                fits.append(_followed(context, model, grid, null))
            elif (end := ends[k]) is None:
                fits.append(_once(context, model, grid, null))
            else:
                fits.append(_unchanged(model, grid, end, null, len(problem.y)))
        behind, enough = np.full(len(causes), np.nan), -np.inf
        if is_coarse:
            # a first fit may have found a lower mode on too coarse a grid
            behind, enough = _far_behind(context, [null, *fits], log_prior)
        for k in map(int, np.flatnonzero(np.isnan(behind))):
            if causes[k].is_correlated_noise or is_followed(causes[k]):
                continue
            # where those in other rows ended is nearly it, on a grid that is fine already
            if is_coarse or ends[k] is None:
                fits[k] = context.converge(fits[k], enough - log_prior[1 + k])
    except KeyboardInterrupt as stop:
        raise InterruptedSearch(fits) from stop
    return fits, behind


def _followed(context: SearchContext, model: MeasuredModel, grid: Grid, null: Fitted) -> Fitted:
    """Fit a cause whose unknowns are all followed, from many starts."""
    X, y, emulator = context.problem.X, context.problem.y, context.emulator
    plain, floor = grid.followed(), NEGLIGIBLE * null.sigma
    z, sigma = best_of_many(model, X, y, emulator, grid, null.mode.z, floor)
    mode = context.climb(model, plain, [z], sigma)
    return context.converge(Fitted(model, plain, mode, sigma))


def _unchanged(
    model: MeasuredModel, grid: Grid, other: Fitted, null: Fitted, n_rows: int
) -> Fitted:
    """Return the fit to other rows as one to these, on the grid refined there, not optimised.

    Its nodes have the prior of these rows, which may span less. Causes that were accepted are fixed
    where they are in these rows.
    """
    grid = with_cells(grid, other.grid.edges, other.grid.mass_under(model, other.model))
    if not np.isfinite(other.mode.objective):
        return Fitted(model, grid, other.mode, other.sigma)
    z, accepted = other.mode.z.copy(), slice(model.n_parameters, len(null.mode.z))
    z[accepted] = null.mode.z[accepted]
    mode = LocalMode(z, n_rows * other.sigma**2, 0.0, 0)
    return Fitted(model, grid, mode, other.sigma)


def _once(context: SearchContext, model: MeasuredModel, grid: Grid, null: Fitted) -> Fitted:
    """Climb once, on the first grid."""
    start, sigma = grid.neutral.copy(), null.sigma
    start[: len(null.mode.z)] = null.mode.z
    args = model, context.problem.X, context.problem.y, context.emulator
    grid = shortened(*args, grid, start, sigma, context.largest_size)
    if model.effects[-1].is_correlated_noise:
        # left free it would take all the noise there is: it has the size of the noise
        size = sigma * context.problem.unit_noise
        mode = context.optimise(model, grid, start, sigma, size=size)
        return Fitted(model, grid, mode, sigma)
    mode = context.optimise(model, grid, start, sigma)
    better = best_of_global_starts(*args, grid, null.mode.z, mode.z, NEGLIGIBLE * null.sigma)
    if better is not None:
        mode = context.optimise(model, grid, better, sigma)
    for _ in range(SETTINGS.probing_rounds):
        before, sigma = sigma, context.noise_of(mode, sigma)
        if not sigma < SETTINGS.refit_noise_ratio * before:
            break
        # kept at the priors by the noise of a poor fit, an optimisation ends short of a good one
        mode = context.optimise(model, grid, mode.z, sigma)
    return Fitted(model, grid, mode, sigma)


def _far_behind(
    context: SearchContext, fits: Sequence[Fitted], log_prior: FloatArray
) -> tuple[FloatArray, float]:
    """Return the log evidence of causes that are far behind; NaN for the others, failed or not.

    And the log evidence from which a cause is not, with its prior odds.

    The first of the fits is that of "nothing is wrong". The stronger the data, the more a grid
    misses between its nodes: what a finer one reaches counts, too.
    """
    sizes = context.sizes(fits)
    scans = [context.evidence_of_nodes(fit, sizes) for fit in fits]
    reached = np.array([np.logaddexp.reduce(nodes) for nodes in scans])
    # a curve of any shape reaches high at once: what has a name is compared with its like; what
    # could not be followed at all gets its other starting points, too
    of_any_shape = [any(e.kind == "unexplained" for e in fit.model.effects[-1:]) for fit in fits]
    weight = np.where(np.isfinite(reached), reached + log_prior, -np.inf)
    enough = float(np.max(weight[~np.array(of_any_shape)], initial=-np.inf)) - SETTINGS.max_behind
    behind = weight < enough
    for k in map(int, np.flatnonzero(behind & np.isfinite(reached))):
        if len(fits[k].grid.nodes):
            missed = _between_nodes(context, fits[k], scans[k], sizes)
            # what gains so much without an optimisation may gain as much again by one
            behind[k] = weight[k] + missed < enough and missed < SETTINGS.max_behind
    return np.where(behind & np.isfinite(reached), reached, np.nan)[1:], enough


def _between_nodes(
    context: SearchContext, fit: Fitted, nodes: FloatArray, sizes: FloatArray
) -> float:
    """Return how many nats more a finer grid around the best nodes reaches, not optimised."""
    density = nodes - fit.grid.log_weight
    coarse = float(density.max())
    for _ in range(SETTINGS.probing_rounds):
        index = np.argsort(-density)[: SETTINGS.probed_nodes]
        best = fit.grid.at(index)
        finer = refine(fit.model, best, density[index] + best.log_weight)
        if finer is best:
            break
        fit = fit._replace(grid=finer)
        density = context.evidence_of_nodes(fit, sizes) - finer.log_weight
    return max(float(density.max()) - coarse, 0.0)


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
    probability: FloatArray = field(init=False)
    remainder: FloatArray = field(init=False)
    correlated: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        # they follow from the evidence, also of one that `replace` gave other candidates
        names = ("probability", "remainder", "correlated")
        vars(self).update(zip(names, probabilities(self.candidates), strict=True))

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
        ordered = sorted(self.kind_shares.items(), key=lambda item: -item[1])
        mass = np.cumsum([share for _, share in ordered])
        enough = int(np.searchsorted(mass, COVERAGE_LEVEL)) + 1
        return [kind for kind, _ in ordered[:enough]]

    def over(self, model: MeasuredModel, causes: Sequence[Cause]) -> Search | None:
        """Return it with candidates for the causes of other rows, in their order.

        Other rows may put a parameter at the end of its prior: a cause that was not compared here
        has the fit of "nothing is wrong". None where other causes are given.
        """

        def form(cause: Cause) -> tuple[str, ...]:
            # other rows may lack an experiment, which has a separate number
            return (cause.name, cause.variant, *cause.parameters)

        if [*map(form, self.problem.model.effects)] != [*map(form, model.effects)]:
            return None
        none = self.candidates[0]
        known = {form(w.cause): w for w in self.candidates[1:] if w.cause is not None}
        same = [known.get(form(c), Candidate(c, none.fit, -np.inf)) for c in causes]
        return replace(self, candidates=[none, *same])


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
        The search over the same causes in other rows of the same data (`Search.over`): only what
        is promising there is compared, from where it ended there. All are, where it lacks a cause
        of these rows.

    Raises
    ------
    InterruptedSearch
        On an interrupt: it contains the search over the causes that were fitted by then.
    """
    null = context.best_null() if accepted is None else context.nothing_further(accepted.fit)
    compared = np.arange(len(causes))
    ends: list[Fitted | None] = [None] * len(causes)
    if nearby is not None:
        none = nearby.candidates[0].fit
        ends = [None if w.fit is none else w.fit for w in nearby.candidates[1:]]
        if None not in ends:  # else these rows are too unlike all of them
            compared = _within_reach(nearby, causes)
    some = [causes[int(k)] for k in compared]
    log_prior = np.log(prior_odds([None, *causes]))[[0, *(1 + compared)]]
    fits: Sequence[Fitted] = []
    is_sample = nearby is not None and len(nearby.problem.y) < len(context.problem.y)
    try:
        near = [ends[k] for k in compared]
        is_coarse = is_sample or nearby is None
        fits, behind = best_modes(context, some, null, log_prior, near, is_coarse)
    except KeyboardInterrupt as stop:
        kept = [null, *(stop.kept if isinstance(stop, InterruptedSearch) else fits)]
        unknown = np.full(len(kept), np.nan)
        raise InterruptedSearch(_compare(context, some, kept, unknown)) from stop
    every, known = [end or null for end in ends], np.full(1 + len(causes), -np.inf)
    for k, fit in zip(compared, fits, strict=True):
        every[k] = fit
    known[0], known[1 + compared] = np.nan, behind
    result = _compare(context, causes, [null, *every], known)
    if nearby is None:
        return result
    return _estimated(result, nearby) if is_sample else _climbed(result)


def _climbed(result: Search) -> Search:
    """Return a search from where causes ended in other rows, the probable ones refined here.

    Linearised where another part of the rows left it, a spread between experiments was 6 nats too
    high.
    """
    out = list(result.candidates)
    for k in map(int, np.flatnonzero(result.probability > MIN_PROBABILITY)):
        cause = out[k].cause
        if cause is None or cause.is_correlated_noise or is_followed(cause):
            continue
        fit = result.context.converge(out[k].fit)
        out[k] = Candidate(cause, fit, result.context.evidence(fit, result.sizes))
    return replace(result, candidates=out)


def _estimated(result: Search, sample: Search) -> Search:
    """Return the search with the evidence that a sample, as so much of it, has for the rest."""
    none, few = result.candidates[0].log_evidence, sample.candidates[0].log_evidence
    share = len(result.problem.y) / len(sample.problem.y)
    out = [
        w._replace(log_evidence=none + share * (of_few.log_evidence - few), is_estimate=True)
        if w.log_evidence == -np.inf
        else w
        for w, of_few in zip(result.candidates, sample.candidates, strict=True)
    ]
    return replace(result, candidates=out)


def _within_reach(nearby: Search, causes: Sequence[Cause]) -> NDArray[np.intp]:
    """Return the causes that may explain some of the rows best, given a search in all of them.

    Processes are always compared: what has no other explanation in few rows is theirs.
    """
    with np.errstate(divide="ignore"):
        log_share = np.log(nearby.probability[1:])
    best = np.max(log_share, initial=-np.inf)
    always = np.array([cause.is_process or cause.is_correlated_noise for cause in causes])
    return np.flatnonzero(always | (log_share > best - SETTINGS.max_behind))


def _compare(
    context: SearchContext, causes: Sequence[Cause], modes: Sequence[Fitted], known: FloatArray
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
    return Search(context, candidates, sizes)


# two explanations are the same to the measured rows if they are less than so many nats apart, and
# less than this share of how far either is from nothing wrong
_SAME_NATS, _SAME_SHARE = 0.5, 0.02


class Local(NamedTuple):
    """Gaussian posterior of the linear coefficients [g, u, h] of a cause at one node."""

    mean: FloatArray
    covariance: FloatArray


class LinearisedRows(NamedTuple):
    """Rows under one cause at one node.

    ``offset`` (n,), ``design`` (n, d + r + q) with raw columns, the sizes from column ``first`` on,
    ``noise`` (n,) the factor on sigma.
    """

    offset: FloatArray
    design: FloatArray
    first: int
    noise: FloatArray


def measured_and_other(
    result: Search, w: Candidate, X: FloatArray, node: int | None = None
) -> tuple[LinearisedRows, LinearisedRows]:
    """Return the measured rows and rows X; what an emulator leaves open they have in common."""
    n = len(result.problem.X)
    both = np.vstack([result.problem.X, result.problem.with_noise(X)])
    parts = _at_node(result, w, both, w.fit.mode.node if node is None else node)
    H = parts.H[0] * parts.H_rms[0]
    design = np.hstack([parts.G[0], parts.U, H])
    first = design.shape[1] - H.shape[1]
    noise = np.ones(len(both)) if parts.noise is None else parts.noise[0]
    pieces = slice(n), slice(n, None)
    measured, others = (
        LinearisedRows(parts.mean[0][k], design[k], first, noise[k]) for k in pieces
    )
    return measured, others


def _at_node(result: Search, w: Candidate, X: FloatArray, node: int) -> Linearised:
    grid = w.fit.grid
    if len(grid.nodes):
        grid = replace(grid.at(np.array([node])), log_weight=np.zeros(1))
    return linearise(w.fit.model, X, result.context.emulator, grid, w.fit.mode.z)


def local_posterior(result: Search, w: Candidate, rows: LinearisedRows, size: float) -> Local:
    """Return the posterior of a cause's linear coefficients, its size of scale ``size``."""
    design, first = rows.design, rows.first
    H = design[:, first:]
    if w.cause is not None and w.cause.is_process:
        rms = np.full(H.shape[1], np.sqrt(np.mean(np.sum(H**2, axis=1))))
    else:
        rms = np.sqrt(np.mean(H**2, axis=0))
    # what moves no measured row, as beyond the range of the runs, is not learned: any scale does
    own = np.divide(size, rms, out=np.ones_like(rms), where=rms > 0)
    scale = np.concatenate([np.ones(first), own])
    design = design / rows.noise[:, None]
    residual = (result.problem.y - rows.offset) / rows.noise
    precision = design.T @ design / w.fit.sigma**2 + np.diag(scale**-2.0)
    covariance = np.linalg.inv(precision)
    mean = covariance @ design.T @ residual / w.fit.sigma**2
    return Local(mean, covariance)


def size_of(result: Search, w: Candidate, node: int | None = None) -> float:
    """Return the prior scale of a cause's size: the largest, or of a process the likeliest.

    A path in the noise, or the curves of experiments, has a size that the measured rows determine:
    other rows and another experiment deviate as far as they do.
    """
    if w.cause is None or "amplitude" not in w.cause.parameters or not w.cause.is_process:
        return float(result.sizes[-1])
    parts = _at_node(result, w, result.problem.X, w.fit.mode.node if node is None else node)
    args = parts, result.problem.y[None], w.fit.sigma, result.context.noise
    evidence = [float(scan(*args, result.sizes[k : k + 1])[0, 0]) for k in range(len(result.sizes))]
    return float(result.sizes[int(np.argmax(evidence))])


def predict_locally(
    result: Search, w: Candidate, X: FloatArray, node: int | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return mean and variance of a new noisy eta at rows X (n, n_columns) under one cause.

    Given what is not a size, such as a period, at one node of its grid; None: the best one.
    """
    mean, loadings, variance = predict_jointly(result, w, X, node)
    return mean, variance + np.sum(loadings**2, axis=1)


def predict_jointly(
    result: Search, w: Candidate, X: FloatArray, node: int | None = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return new noisy eta at rows X (n, n_columns), which share what is not known of the cause.

    Returns
    -------
    mean : ndarray of shape (n,)
    loadings : ndarray of shape (n, k)
        Loadings times their transpose is the covariance of the noise-free values.
    variance : ndarray of shape (n,)
        Of the noise.
    """
    measured, rows = measured_and_other(result, w, X, node)
    local = local_posterior(result, w, measured, size_of(result, w, node))
    # a root that exists where rounding has left a variance a little below zero, too
    variances, directions = np.linalg.eigh((local.covariance + local.covariance.T) / 2)
    loadings = rows.design @ (directions * np.sqrt(np.maximum(variances, 0.0)))
    return rows.offset + rows.design @ local.mean, loadings, (w.fit.sigma * rows.noise) ** 2


def predicted_rows(result: Search, w: Candidate) -> tuple[FloatArray, FloatArray]:
    """Return mean and variance of the noise of the measured rows under a cause at its best."""
    mean, _, variance = predict_jointly(result, w, result.problem.X)
    return mean, variance


def draw_the_same(result: Search, one: Candidate, other: Candidate) -> bool:
    """Return whether no measurement at these rows could separate two causes.

    Their expected log likelihood ratio, the Kullback-Leibler divergence between the noisy rows that
    either predicts, is less than a half, and small against that from what nothing wrong predicts: a
    trend and a drift of the slope of a line, or noise that grows and an input in error.
    """
    first, second, nothing = (predicted_rows(result, w) for w in (one, other, result.candidates[0]))
    return _divergence(first, second) < min(_SAME_NATS, _SAME_SHARE * _divergence(first, nothing))


def _divergence(one: tuple[FloatArray, FloatArray], other: tuple[FloatArray, FloatArray]) -> float:
    """Return the Kullback-Leibler divergence between independent normal rows."""
    gap, ratio = one[0] - other[0], one[1] / other[1]
    return float(np.sum(ratio - 1 - np.log(ratio) + gap**2 / other[1]) / 2)
