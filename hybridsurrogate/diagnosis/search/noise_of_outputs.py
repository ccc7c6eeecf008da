"""Several outputs in a search: each cause compared with the noise of each output that suits it.

A cause in one output leaves less noise there. Fixed at what "nothing is wrong" needs, the noise of
that output would hide it; so each cause has the ratios that are most probable with it. To first
order what integrating over them would add is the same for all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hybridsurrogate.diagnosis.search.candidate import Candidate
from hybridsurrogate.diagnosis.search.context import FLOOR, Fitted
from hybridsurrogate.diagnosis.search.local_prediction import measured_and_other, predict_locally
from hybridsurrogate.diagnosis.search.processes import with_processes
from hybridsurrogate.diagnosis.search.search import Search
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.effects.noise.output_noise import OutputNoise
from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.model.posterior import Posterior
from hybridsurrogate.model.problem import Problem

# rounds of expectation and maximisation: in six cases the first gained 1.4 to 9 nats for the cause
# of most evidence, the second up to 0.3, further ones less than 0.03
_ROUNDS = 2


def at_noise_of(problem: Problem, posterior: Posterior) -> Problem:
    """Return the problem with the ratios of noise that a posterior has, at their medians."""
    free = next((k for k, e in enumerate(posterior.model.effects) if _is_noise(e)), None)
    if free is None:
        return problem
    draws = posterior.estimates(free)
    ratios = (1.0, *(float(np.median(values)) for values in draws.values()))
    effects = [_at(e, ratios) if _is_noise(e) else e for e in problem.model.effects]
    return replace(problem, model=problem.model.with_effects(effects))


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
    found = replace(result, sizes=sizes).reweighed(candidates)
    return with_processes(found, with_remainder)


def _best(result: Search, w: Candidate) -> Fitted:
    """Return the fit of a cause with separate ratios of noise."""
    if not np.isfinite(w.fit.mode.objective):
        return w.fit
    for _ in range(_ROUNDS):
        ratios, sigma = _updated(result, w)
        model, grid, mode, _ = w.fit
        model = model.with_effects([_at(e, ratios) if _is_noise(e) else e for e in model.effects])
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
    each = np.array(
        [np.sqrt(np.mean(squares[which == k])) for k in range(len(problem.stacking.names))]
    )
    each = np.maximum(each, FLOOR * problem.scale)
    return tuple((each / each[0]).tolist()), float(each[0])


def _is_noise(cause: Cause) -> bool:
    return isinstance(cause, OutputNoise)


def _noise_of(model: MeasuredModel) -> OutputNoise:
    return next(effect for effect in model.effects if isinstance(effect, OutputNoise))


def _at(cause: Cause, ratios: Sequence[float]) -> Cause:
    return cause.filled(ratios=tuple(ratios))
