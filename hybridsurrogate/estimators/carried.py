"""A fit from the proposals that were made for a neighbouring one."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import clone
from sklearn.utils import check_random_state

from hybridsurrogate.estimators.power_scaled import PowerScaledSurrogate
from hybridsurrogate.inference.model.observation import MeasuredModel
from hybridsurrogate.inference.posterior_sampler import FirstStep, of_importance
from hybridsurrogate.inference.procedure import Fit, finish, make_target, powers_used
from hybridsurrogate.inference.sampling.adaptive_importance import Proposals
from hybridsurrogate.inference.sampling.moment_matching import matched_draws
from hybridsurrogate.inference.sampling.psis import KHAT_LIMIT
from hybridsurrogate.priors import FloatArray, to_normal
from hybridsurrogate.problem.problem import Problem

_MIN_EFFECTIVE = 200.0
# proposals for each draw that a fit to other rows keeps: as many as a fit from scratch has
_PROPOSALS_A_DRAW = 3


def carried(
    problem: Problem,
    powers: tuple[float, float | FloatArray],
    proposals: Proposals | None,
    n_draws: int,
    n_proposals: int,
    random_state: np.random.RandomState,
) -> Fit | None:
    """Return the fit of a problem from proposals made for another, None where they do not serve.

    They do not where their k-hat exceeds 0.7 or fewer than 200 effective draws are left, after
    moment matching. Of fewer proposals there are none.

    Parameters
    ----------
    powers : (alpha_S, alpha_R)
    proposals : Proposals or None
        For the same unknowns, at other powers or for other rows; None of an ensemble.
    n_proposals : int
        At most so many of them are used.
    """
    if proposals is None or len(proposals.points) < _MIN_EFFECTIVE:
        return None
    powers = powers_used(problem, powers)
    target = make_target(problem, *powers)
    sampled = matched_draws(
        target.extended_log_density,
        _thinned(proposals, n_proposals),
        n_draws,
        random_state,
        n_noise=target.n_noise,
    )
    if not (sampled.khat <= KHAT_LIMIT and sampled.effective_draws >= _MIN_EFFECTIVE):
        return None
    drawn = target.resolved(sampled.draws, random_state)
    step = FirstStep(*drawn, of_importance(target, sampled, 1), sampled.proposals)
    return finish(problem, powers, step, random_state)


def fitted_near(
    estimator: PowerScaledSurrogate,
    X: ArrayLike,
    y: ArrayLike,
    known: PowerScaledSurrogate,
    sample_weight: ArrayLike | None = None,
) -> PowerScaledSurrogate | None:
    """Return an estimator fitted to rows X, y by the proposals of its fit to most of them and more.

    None where these do not serve. A mode that all rows together exclude gets no proposals, so this
    is for scores of rows left out, not for a model that is kept.

    Parameters
    ----------
    estimator : PowerScaledSurrogate
        Not fitted.
    X, y : array-like of shape (n, n_columns), (n,)
    known : PowerScaledSurrogate
        Fitted, with the same unknowns.
    sample_weight : array-like of shape (n,) or None, default=None
    """
    out = clone(estimator)
    surrogate, likelihood = out._check_parameters()
    data = out._check_fit_data(X, y, likelihood, sample_weight)
    problem = out._problem(surrogate, likelihood, data, data.rows)
    n, whole = int(out.n_draws), known._fitted[1]
    proposals = whole.proposals
    if proposals is not None:
        before = whole.first.model
        # these rows may lack an experiment
        if before.theta_names != problem.model.theta_names:
            return None
        proposals = _thinned(proposals, _PROPOSALS_A_DRAW * n)
        proposals = _under_other_priors(proposals, before, problem.model)
    fit = carried(
        problem,
        out._powers(data.rows.X),
        proposals,
        n,
        _PROPOSALS_A_DRAW * n,
        check_random_state(out.random_state),
    )
    if fit is None:
        return None
    fit.diagnostics.warn()
    return out._keep(data, data.rows, problem, fit)


def _under_other_priors(
    proposals: Proposals, before: MeasuredModel, model: MeasuredModel
) -> Proposals:
    """Return proposals of the same values, as standard normal coordinates under other priors.

    Priors of causes follow the rows, and a period that is known to a ten thousandth of its prior
    would be missed by far. With z' = Phi^-1(F'(v)) at v = F^-1(Phi(z)) the density q'(z') is
    q(z) dz/dz', where dz'/dz = f'(v) phi(z) / (f(v) phi(z')). What the other priors exclude is left
    out.
    """
    z = proposals.points[:, : model.n_unknowns]
    values, log_slope = before.values(z), np.zeros(len(z))
    points = proposals.points.copy()
    for k in np.flatnonzero(np.any(values != model.values(z), axis=0)):
        old, new, v = before.priors[k], model.priors[k], values[:, [k]]
        points[:, [k]] = to_normal([new], v)
        log_slope += new.logpdf(v)[:, 0] - old.logpdf(v)[:, 0]
        log_slope += 0.5 * (points[:, k] ** 2 - z[:, k] ** 2)
    kept = np.isfinite(log_slope)
    return Proposals(points[kept], (proposals.log_density - log_slope)[kept])


def _thinned(proposals: Proposals, n: int) -> Proposals:
    if len(proposals.points) <= n:
        return proposals
    index = np.linspace(0, len(proposals.points) - 1, n).astype(int)
    return Proposals(proposals.points[index], proposals.log_density[index])
