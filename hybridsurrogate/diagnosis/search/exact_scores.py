"""The most probable causes, scored by the nonlinear model under its likelihood.

The evidence is that of the model which an estimator fits, integrated by importance sampling; sizes
have the prior of the search. Of the rest the screening's evidence stands, relative to that of the
most probable cause.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hybridsurrogate.diagnosis.search.candidate import Candidate, prior_of
from hybridsurrogate.diagnosis.search.local_prediction import predict_locally
from hybridsurrogate.diagnosis.search.processes import with_processes
from hybridsurrogate.diagnosis.search.search import Search, search
from hybridsurrogate.diagnosis.search.working_rows import expanded
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.effects.sized import Sized
from hybridsurrogate.inference.evidence.settings import SETTINGS
from hybridsurrogate.inference.posterior_sampler import evidence_around
from hybridsurrogate.inference.procedure import make_target
from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.model.problem import Problem
from hybridsurrogate.model.working_point import WorkingPoint
from hybridsurrogate.priors import to_normal
from hybridsurrogate.types import FloatArray

# places of one cause from which its modes are sought, and shares of the size's prior
_PLACES, _SHARES = 4, (-0.5, 0.5, 1.3)


def screened_at_best(result: Search, causes: Sequence[Cause]) -> Search:
    """Return the search repeated with rows expanded at the best cause, where something is wrong.

    Where rows are normal there is nothing to expand. Where an emulator of single runs replaces the
    simulation nothing is scored, so all causes keep the expansion at "nothing is wrong".

    Parameters
    ----------
    result : Search
        With the rows expanded where nothing is wrong.
    causes : sequence of Cause
        Those of the search.
    """
    best = result.candidates[int(np.argmax(result.probability))]
    if not _is_scored(result) or best.cause is None:
        return result
    again = result.context.at(expanded(result.problem, _point_at(result, best)))
    return with_processes(search(again, causes), bool(np.any(result.remainder)))


def scored(result: Search) -> Search:
    """Return the search with its best causes scored by the likelihood of the measured rows.

    The search stays as it is where rows are normal (the closed form agrees there with importance
    sampling to 0.1 nats); where an emulator of single runs stands for the simulation, the
    screening's evidence stands.
    """
    if not _is_scored(result):
        return result
    screened = np.array([w.log_evidence for w in result.candidates])
    weight = screened + np.log(prior_of(result.candidates))
    order = np.argsort(-weight)[: SETTINGS.most_scored]
    probable = {0, *(int(k) for k in order if weight[k] > weight[order[0]] - SETTINGS.within_reach)}
    exact = {k: _log_evidence(result, result.candidates[k]) for k in sorted(probable)}
    exact = {k: value for k, value in exact.items() if np.isfinite(value)}
    if 0 not in exact:
        return result
    nearest = max(exact, key=lambda k: weight[k])
    candidates = []
    for k, w in enumerate(result.candidates):
        like = k if k in exact else nearest
        moved = exact[like] - screened[like]
        candidates.append(
            w._replace(
                log_evidence=w.log_evidence + moved,
                log_evidence_with_remainder=w.log_evidence_with_remainder + moved,
                log_evidence_with_noise=w.log_evidence_with_noise + moved,
            )
        )
    return result.reweighed(candidates)


def _is_scored(result: Search) -> bool:
    """Return whether causes are scored: rows are not normal, the simulation is run, or curves.

    An emulator of curves leaves open a few coefficients, which the inner Laplace approximation
    integrates; one of single runs has a covariance of all rows.
    """
    problem, basis = result.problem, result.problem.model.basis
    return problem.working_point is not None and basis.with_features is not None


def _point_at(result: Search, w: Candidate) -> WorkingPoint:
    """Return the working point at the fit of one cause."""
    point = result.problem.working_point
    assert point is not None
    eta, _ = predict_locally(result, w, result.problem.X)
    sigma = w.fit.sigma if result.problem.likelihood.scales_noise else point.sigma
    return replace(point, eta=eta, sigma=sigma)


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
        best = np.argsort(-(log_evidence - grid.log_weight))[:_PLACES]
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
    for share in _SHARES:
        size = float(np.exp(np.interp(share, [-3, 3], np.log([low, high]))))
        place = starts.copy()
        moved = place[:, grid.sizes] - grid.neutral[grid.sizes]
        place[:, grid.sizes] = moved / np.minimum(size / np.array(slopes), 1.0)
        points.append(np.column_stack([place, np.full(len(place), share)]))
    return model.with_effects((*model.effects[:-1], cause)), np.concatenate(points)
