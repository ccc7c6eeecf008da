"""The most probable causes, placed together and scored by the nonlinear model.

A cause that was placed alone also explains what it can of another cause, and stands a little off
its place. Fixed there it biases the other: a period that is five per cent off leaves a wave.

The evidence is that of the model which an estimator fits, integrated by importance sampling; sizes
have the prior of the search. Of the rest the screening's evidence stands, relative to that of the
most probable cause.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hybridsurrogate.diagnosis.search.candidate import Candidate, prior_of
from hybridsurrogate.diagnosis.search.context import Fitted, expanded
from hybridsurrogate.diagnosis.search.processes import with_processes
from hybridsurrogate.diagnosis.search.search import Search, predict_locally, search
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.effects.wrapped import Sized
from hybridsurrogate.inference.evidence.grid import Grid, make_grid, with_cells
from hybridsurrogate.inference.evidence.levenberg_marquardt import is_followed
from hybridsurrogate.inference.evidence.settings import SETTINGS
from hybridsurrogate.inference.posterior_sampler import evidence_around
from hybridsurrogate.inference.procedure import make_target
from hybridsurrogate.model.observation import MeasuredModel, WorkingPoint
from hybridsurrogate.model.problem import Problem
from hybridsurrogate.priors import to_normal
from hybridsurrogate.types import FloatArray


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
    able = sorted(able, key=lambda k: -evidence[k])[: SETTINGS.max_compared]
    if first.cause is None or not movable(first.cause) or not able:
        return conditional
    candidates = list(conditional.candidates)
    elsewhere = np.array([w.log_evidence for w in nearby.candidates]) if nearby else evidence
    for k in able:
        if all(w[k] > max(w[able]) - SETTINGS.max_behind for w in (elsewhere, evidence)):
            candidates[k] = _together(result, first, conditional, candidates[k])
    return replace(conditional, candidates=candidates)


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
    for _ in range(SETTINGS.alternation_rounds):
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
        if alone < reached:
            break
        fit, reached = back, alone
    return best if np.isfinite(best.log_evidence) else second


def _turned(result: Search, fit: Fitted, cells: Grid) -> Fitted:
    """Return the last but one cause placed anew, the last one fixed at its fit."""
    *before, one, other = fit.model.effects
    turned, order = fit.model.reordered((*before, other, one))
    starts = [z[order] for z in result.context.places_of(fit)]
    context, grid = result.context, with_cells(make_grid(turned), cells.edges, cells.log_weight)
    mode = context.climb(turned, grid, starts, fit.sigma)
    return context.converge(Fitted(turned, grid, mode, fit.sigma))


# places of one cause from which its modes are sought, and shares of the size's prior
_N_STARTS, _SIZE_SHARES = 4, (-0.5, 0.5, 1.3)


def _screened_at_best(result: Search, causes: Sequence[Cause], point: WorkingPoint) -> Search:
    """Return the search repeated with rows expanded at the best cause, where something is wrong."""
    best = result.candidates[int(np.argmax(result.probability))]
    if best.cause is None:
        return result
    problem = result.problem
    sigma = best.fit.sigma if problem.likelihood.scales_noise else point.sigma
    point = replace(point, eta=predict_locally(result, best, problem.X)[0], sigma=sigma)
    again = result.context.at(expanded(problem, point))
    return with_processes(search(again, causes), bool(np.any(result.remainder)))


def scored(result: Search, causes: Sequence[Cause] | None = None) -> Search:
    """Return the search with its best causes scored by the likelihood of the measured rows.

    The search stays as it is where rows are normal (the closed form agrees there with importance
    sampling to 0.1 nats); where an emulator of single runs stands for the simulation, its
    covariance is one of all rows, and the screening's evidence stands. An emulator of curves leaves
    open a few coefficients, which the inner Laplace approximation integrates.

    Parameters
    ----------
    result : Search
    causes : sequence of Cause or None
        Those of a search whose rows are expanded where nothing is wrong: it is repeated first, with
        rows expanded at its best cause.
    """
    point = result.problem.working_point
    if point is None or result.problem.model.basis.with_features is None:
        return result
    if causes is not None:
        result = _screened_at_best(result, causes, point)
    screened = np.array([w.log_evidence for w in result.candidates])
    weight = screened + np.log(prior_of(result.candidates))
    order = np.argsort(-weight)[: SETTINGS.max_compared]
    least = weight[order[0]] - SETTINGS.max_behind
    probable = {0, *(int(k) for k in order if weight[k] > least)}
    exact = {k: _log_evidence(result, result.candidates[k]) for k in sorted(probable)}
    exact = {k: value for k, value in exact.items() if np.isfinite(value)}
    if 0 not in exact:
        return result
    nearest = max(exact, key=lambda k: weight[k])
    moved = {k: value - screened[k] for k, value in exact.items()}
    out = [w.moved(moved.get(k, moved[nearest])) for k, w in enumerate(result.candidates)]
    return replace(result, candidates=out)


def _log_evidence(result: Search, w: Candidate) -> float:
    """Return the log evidence of one cause, NaN where it cannot be had."""
    problem = result.problem
    model, starts = _sized(result, w)
    point = problem.working_point
    assert point is not None
    basis = model.basis.with_features
    assert basis is not None
    exact = Problem(
        replace(model, basis=basis, has_row_noise=False, reference=None),
        problem.X[:, :-1],
        problem.likelihood.working(problem.observed),
        problem.weights,
        problem.observed,
        problem.likelihood,
        None,
        None,
        problem.noise_prior,
        problem.scale,
    )
    sigma = w.fit.sigma if problem.likelihood.scales_noise else point.sigma
    u = np.column_stack([starts, np.full(len(starts), np.log(sigma))])
    # a fixed stream: the search is reproducible
    return evidence_around(make_target(exact, 0.0, 1.0), u, np.random.RandomState(0))


def _sized(result: Search, w: Candidate) -> tuple[MeasuredModel, FloatArray]:
    """Return the model with its last cause's size unknown, and starting points z (k, n)."""
    problem, (model, grid, mode, _) = result.problem, w.fit
    z = mode.z
    if w.cause is None:
        return model, z[None]
    parts = result.context.linearise(w.fit)
    starts = z[None]
    if len(grid.nodes):
        log_evidence = result.context.evidence_of_nodes(w.fit, result.sizes)
        best = np.argsort(-(log_evidence - grid.log_weight))[:_N_STARTS]
        starts = np.repeat(z[None], len(best), axis=0)
        priors = [model.priors[k] for k in grid.nodes]
        starts[:, grid.nodes] = to_normal(priors, grid.points[best])
    if not len(grid.sizes) and not w.cause.coefficients:
        return model, starts
    slopes = tuple(parts.H_rms[min(mode.node, len(parts.H_rms) - 1), : len(grid.sizes)].tolist())
    low, high = float(result.sizes[0]), float(result.sizes[-1])
    rows = dict(zip(model.columns, problem.X.T, strict=False))
    cause = Sized(w.cause, low, high, rows, slopes)
    points = []
    for share in _SIZE_SHARES:
        size = float(np.exp(np.interp(share, [-3, 3], np.log([low, high]))))
        place = starts.copy()
        moved = place[:, grid.sizes] - grid.neutral[grid.sizes]
        place[:, grid.sizes] = moved / np.minimum(size / np.array(slopes), 1.0)
        points.append(np.column_stack([place, np.full(len(place), share)]))
    return model.with_effects((*model.effects[:-1], cause)), np.concatenate(points)
