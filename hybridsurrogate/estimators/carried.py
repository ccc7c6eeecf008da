"""An estimator fitted to rows from the proposals of its fit to most of them and more."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import clone
from sklearn.utils import check_random_state

from hybridsurrogate.estimators.power_scaled import PowerScaledSurrogate
from hybridsurrogate.inference.sampling.adaptive_importance import Proposals
from hybridsurrogate.inference.warm_start import carried, thinned
from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.priors import to_normal

# proposals for each draw that a fit to other rows keeps: as many as a fit from scratch has
_PROPOSALS_A_DRAW = 3


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
        proposals = thinned(proposals, _PROPOSALS_A_DRAW * n)
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
