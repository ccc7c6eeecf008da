"""A fit from the proposals that were made for a neighbouring one."""

from __future__ import annotations

import numpy as np

from hybridsurrogate.inference.posterior_sampler import FirstStep, of_importance
from hybridsurrogate.inference.procedure import Fit, finish, make_target, powers_used
from hybridsurrogate.inference.sampling.adaptive_importance import Proposals
from hybridsurrogate.inference.sampling.moment_matching import matched_draws
from hybridsurrogate.model.posterior import MIN_EFFECTIVE
from hybridsurrogate.model.problem import Problem
from hybridsurrogate.numerics.psis import KHAT_LIMIT
from hybridsurrogate.numerics.threads import one_blas_thread
from hybridsurrogate.types import FloatArray


def carried_step(
    problem: Problem,
    powers: tuple[float, float | FloatArray],
    proposals: Proposals | None,
    n_draws: int,
    n_proposals: int,
    random_state: np.random.RandomState,
) -> FirstStep | None:
    """Return step 1 of a problem from proposals made for another, None where they do not serve.

    They do not where, after moment matching, their k-hat exceeds 0.7 or so few effective draws
    are left that they are doubtful.

    Parameters
    ----------
    powers : (alpha_S, alpha_R)
    proposals : Proposals or None
        For the same unknowns, at other powers or for other rows; None of an ensemble.
    n_proposals : int
        At most so many of them are used.
    """
    if proposals is None or len(proposals.points) < MIN_EFFECTIVE:
        return None
    powers = powers_used(problem, powers)
    target = make_target(problem, *powers)
    sampled = matched_draws(
        target.extended_log_density,
        thinned(proposals, n_proposals),
        n_draws,
        random_state,
        n_noise=target.n_noise,
    )
    if not (sampled.khat <= KHAT_LIMIT and sampled.effective_draws >= MIN_EFFECTIVE):
        return None
    drawn = target.resolved(sampled.draws, random_state)
    return FirstStep(*drawn, of_importance(target, sampled, 1), sampled.proposals)


def carried(
    problem: Problem,
    powers: tuple[float, float | FloatArray],
    proposals: Proposals | None,
    n_draws: int,
    n_proposals: int,
    random_state: np.random.RandomState,
) -> Fit | None:
    """Return the fit of a problem whose step 1 is `carried_step`, None where that is."""
    with one_blas_thread():
        step = carried_step(problem, powers, proposals, n_draws, n_proposals, random_state)
        if step is None:
            return None
        return finish(problem, powers_used(problem, powers), step, random_state)


def thinned(proposals: Proposals, n: int) -> Proposals:
    """Return at most n proposals, spread evenly over all."""
    if len(proposals.points) <= n:
        return proposals
    index = np.linspace(0, len(proposals.points) - 1, n).astype(int)
    return Proposals(proposals.points[index], proposals.log_density[index])
