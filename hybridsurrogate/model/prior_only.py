"""Effects that the measured rows do not inform: their values are drawn from their priors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hybridsurrogate.effects.base import Cause
from hybridsurrogate.effects.context import Context, OfOutput
from hybridsurrogate.effects.in_output import prepared_for
from hybridsurrogate.model.posterior import Posterior
from hybridsurrogate.model.problem import Problem
from hybridsurrogate.types import FloatArray


def with_prior_only(posterior: Posterior, problem: Problem, effects: Sequence[Cause]) -> Posterior:
    """Return a posterior with further effects that nothing was learned about.

    Parameters
    ----------
    posterior : Posterior
    problem : Problem
        That it is the posterior of.
    effects : sequence of Cause
        Not prepared.
    """
    if not effects:
        return posterior
    prepared = [prepared_for(effect, _context(problem)) for effect in effects]
    model = posterior.model
    whole = model.with_effects((*model.effects, *prepared))
    n, known = posterior.n_draws, model.n_unknowns
    # a separate stream: draws of all else stay the same
    random = np.random.RandomState(0)
    theta = [_shuffled(n, random, whole.priors[k].ppf) for k in range(known, len(whole.priors))]
    values = np.column_stack([posterior.values[:, :known], *theta, posterior.values[:, known:]])
    q = len(model.column_sd)
    own = random.standard_normal((n, len(whole.column_sd) - q)) * whole.column_sd[q:]
    coefficients = np.hstack([posterior.effect_coefficients, own])
    return replace(posterior, model=whole, values=values, effect_coefficients=coefficients)


def _shuffled(n: int, random: np.random.RandomState, quantile: object) -> FloatArray:
    """Return n values evenly spread over a distribution, in random order."""
    assert callable(quantile)
    return np.asarray(quantile((random.permutation(n) + 0.5) / n))


def _context(problem: Problem) -> Context:
    model, stacking = problem.model, problem.stacking
    names = () if stacking is None else stacking.names
    scales = () if stacking is None else stacking.scale.tolist()
    return Context(
        dict(zip(model.columns, problem.X.T, strict=False)),
        model.n_inputs,
        dict(model.parameters),
        {},
        problem.scale,
        outputs=names,
        of_outputs=tuple(OfOutput(0.0, 0.0, 1.0, float(scale)) for scale in scales),
    )
