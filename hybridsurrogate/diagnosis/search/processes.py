"""Causes given what none of them explains: a curve of any shape, noise that is shared.

Of several outputs, a cause in one leaves less noise there. Fixed at what "nothing is wrong" needs,
the noise of that output would hide it; so each cause has the ratios that are most probable with it.
To first order what integrating over them would add is the same for all.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from hybridsurrogate.diagnosis.search.candidate import MIN_PROBABILITY, Candidate, prior_of
from hybridsurrogate.diagnosis.search.context import Fitted
from hybridsurrogate.diagnosis.search.search import Search, measured_and_other, predict_locally
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.effects.noise.noise import OutputNoise
from hybridsurrogate.inference.evidence.grid import make_grid
from hybridsurrogate.inference.evidence.linearised import Linearised
from hybridsurrogate.inference.evidence.marginal_likelihood import scan, scan_with_process
from hybridsurrogate.inference.evidence.settings import SETTINGS
from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.model.posterior import Posterior
from hybridsurrogate.model.problem import Problem
from hybridsurrogate.numerics.linear_algebra import NEGLIGIBLE
from hybridsurrogate.types import FloatArray


def at_noise_of(problem: Problem, posterior: Posterior) -> Problem:
    """Return the problem with the ratios of noise that a posterior has, at their medians."""
    free = next((k for k, e in enumerate(posterior.model.effects) if _is_noise(e)), None)
    if free is None:
        return problem
    draws = posterior.estimates(free)
    ratios = (1.0, *(float(np.median(values)) for values in draws.values()))
    return replace(problem, model=_with_ratios(problem.model, ratios))


def at_best_noise(result: Search, with_remainder: bool) -> Search:
    """Return the search with each cause at separate ratios of noise; a single output has none.

    Parameters
    ----------
    result : Search
        With all causes at the same ratios.
    with_remainder : bool
        Also compare the winners given a smooth remainder.
    """
    problem = result.problem
    if not problem.likelihood.gaussian or not any(map(_is_noise, problem.model.effects)):
        return result
    fits = [_best(result, w) for w in result.candidates]
    sizes = result.context.sizes(fits)
    candidates = []
    for w, fit in zip(result.candidates, fits, strict=True):
        evidence = result.context.evidence(fit, sizes) + _noise_of(fit.model).log_prior()
        candidates.append(Candidate(w.cause, fit, evidence))
    found = replace(result, sizes=sizes, candidates=candidates)
    return with_processes(found, with_remainder)


def _best(result: Search, w: Candidate) -> Fitted:
    """Return the fit of a cause with separate ratios of noise."""
    if not np.isfinite(w.fit.mode.objective):
        return w.fit
    # of expectation and maximisation
    for _ in range(SETTINGS.alternation_rounds):
        ratios, sigma = _updated(result, w)
        model, grid, mode, _ = w.fit
        model = _with_ratios(model, ratios)
        w = w._replace(fit=result.context.converge(Fitted(model, grid, mode, sigma)))
    return w.fit


def _updated(result: Search, w: Candidate) -> tuple[tuple[float, ...], float]:
    """Return the ratios and the noise of the first output that a fit suggests.

    One step of expectation and maximisation: mean squares of the residuals, the uncertainty of the
    fit included.
    """
    problem = result.problem
    assert problem.stacking is not None
    mean, variance = predict_locally(result, w, problem.X)
    noise = measured_and_other(result, w, problem.X[:0])[0].noise
    squares = (problem.y - mean) ** 2 + np.maximum(variance - (w.fit.sigma * noise) ** 2, 0.0)
    # a cause may change the noise within an output
    rows = dict(zip(w.fit.model.columns, problem.X.T, strict=False))
    squares = squares / (noise / _noise_of(w.fit.model).noise(rows, {})) ** 2
    which = problem.X[:, problem.stacking.at]
    outputs = range(len(problem.stacking.names))
    each = np.sqrt([np.mean(squares[which == k]) for k in outputs])
    each = np.maximum(each, NEGLIGIBLE * problem.scale)
    return tuple((each / each[0]).tolist()), float(each[0])


def _is_noise(cause: Cause) -> bool:
    return isinstance(cause, OutputNoise)


def _noise_of(model: MeasuredModel) -> OutputNoise:
    return next(effect for effect in model.effects if isinstance(effect, OutputNoise))


def _with_ratios(model: MeasuredModel, ratios: tuple[float, ...]) -> MeasuredModel:
    return model.with_effects(
        [e.filled(ratios=ratios) if _is_noise(e) else e for e in model.effects]
    )


def with_processes(
    result: Search, with_remainder: bool = True, nearby: Search | None = None
) -> Search:
    """Return the search with its winners also compared given what none of them explains.

    That is noise that neighbouring rows share and, where it is asked for, a smooth discrepancy of
    unknown shape. Of a search ``nearby``, in other rows, those causes that such noise mattered to.
    """
    return _given_noise(_given_curve(result) if with_remainder else result, nearby)


def _given_curve(result: Search) -> Search:
    """Compare the winners given a smooth discrepancy of unknown shape."""
    quick = result.probability
    process, bases = _process(result, lambda w: w.kind == "unexplained")
    if process is None:
        return result
    named = [k for k, w in enumerate(result.candidates) if w.has_name]
    best = max(named, key=lambda k: quick[k], default=None)
    out = []
    for k, (w, probability) in enumerate(zip(result.candidates, quick, strict=True)):
        # the best named cause always has its chance: data usually contain more than one fault
        if w is process or (probability < MIN_PROBABILITY and w.cause is not None and k != best):
            out.append(w)
        elif w.cause is None:
            out.append(w._replace(log_evidence_with_remainder=process.log_evidence))
        else:
            out.append(w._replace(log_evidence_with_remainder=_with_process(result, w, bases)))
    return replace(result, candidates=out)


def _given_noise(result: Search, nearby: Search | None) -> Search:
    """Compare the causes that explain most, given noise that neighbouring rows share.

    Such noise is no alternative to what a simulation lacks: both may be present, and alone it
    imitates a jump or a wave. "None" given such noise is a separate cause.
    """
    process, bases = _process(result, lambda w: w.cause is not None and w.cause.is_correlated_noise)
    if process is None:
        return result
    value = np.log(prior_of(result.candidates)) + [w.log_evidence for w in result.candidates]
    able = [
        k
        for k, w in enumerate(result.candidates)
        if w.cause is not None and w.cause.changes_output and w.has_name and not w.is_estimate
        if nearby is None or nearby.probability[k] * nearby.correlated[k] > MIN_PROBABILITY
    ]
    out = list(result.candidates)
    for k in sorted(able, key=lambda k: -value[k])[: SETTINGS.max_compared]:
        evidence = _with_process(result, out[k], bases)
        out[k] = out[k]._replace(log_evidence_with_noise=evidence)
    return replace(result, candidates=out)


def _process(
    result: Search, belongs: Callable[[Candidate], bool]
) -> tuple[Candidate | None, FloatArray]:
    """Return the best of some processes and its columns of unit size at each length, (L, n, q).

    Of several outputs that in the one which needs it most; None where none was compared.
    """
    processes = [w for w in result.candidates if belongs(w)]
    process = max(processes, key=lambda w: w.log_evidence, default=None)
    if process is None:
        return None, np.empty((0, 0, 0))
    model = process.fit.model
    lengths = make_grid(model)
    values = np.repeat(model.values(np.zeros((1, model.n_unknowns))), len(lengths.points), axis=0)
    values[:, lengths.nodes] = lengths.points
    own = [owner == len(model.effects) - 1 for owner, _ in model.column_names]
    bases = model.added(result.problem.X, values)[:, :, own]
    rms = np.sqrt(np.mean(np.sum(bases**2, axis=2), axis=1))
    return process, bases / rms[:, None, None]


def _with_process(result: Search, w: Candidate, bases: FloatArray) -> float:
    """Return the log evidence of a cause given a process of unknown length and size."""
    problem, noise, sizes = result.problem, result.context.noise, result.sizes
    grid, sigma = w.fit.grid, w.fit.sigma
    parts = result.context.linearise(w.fit)
    nodes = scan(parts, problem.y[None], sigma, noise, sizes)[0]
    # zero but for causes that were placed together, whose evidence is not that of the last one
    beyond_last = w.log_evidence - float(np.logaddexp.reduce(nodes))
    best_first = np.argsort(-nodes)
    likely = best_first[nodes[best_first] > nodes.max() - 10.0]
    parts = parts.at(likely)
    if w.cause is not None and w.cause.is_process and len(grid.nodes) == 1:
        parts = _of_neighbours(parts, grid.points[likely, 0], nodes[likely])
    beyond_node = 0.0
    if parts.noise is not None and len(parts.noise) > 1:
        # every node would need a factorisation: that of the best one gives what a curve adds
        parts = replace(parts.at(np.array([0])), log_weight=np.zeros(1))
        plain = scan(parts, problem.y[None], sigma, noise, sizes)[0]
        beyond_node = float(np.logaddexp.reduce(nodes)) - float(plain[0])
    terms = scan_with_process(parts, problem.y, sigma, noise, sizes, bases, sizes[::2])
    added = float(np.logaddexp.reduce(terms, axis=None)) - np.log(len(bases) * len(sizes[::2]))
    return added + beyond_node + beyond_last


def _of_neighbours(parts: Linearised, places: FloatArray, nodes: FloatArray) -> Linearised:
    """Return the model at few nodes, each with the prior mass of a group of neighbours.

    The columns of a process are many, and change slowly with its length.
    """
    if len(places) <= SETTINGS.grouped_lengths:
        return parts
    density, chosen, weight = nodes - parts.log_weight, [], []
    for group in np.array_split(np.argsort(places), SETTINGS.grouped_lengths):
        mass = np.logaddexp.reduce(parts.log_weight[group])
        mean = np.logaddexp.reduce(nodes[group]) - mass
        chosen.append(group[np.argmin(np.abs(density[group] - mean))])
        weight.append(mass)
    return replace(parts.at(np.array(chosen)), log_weight=np.array(weight))
