"""An estimator fitted to rows from the proposals of its fit to most of them and more."""

from __future__ import annotations

import numpy as np

from hybridsurrogate.estimators.power_scaled import FitTask, PowerScaledSurrogate
from hybridsurrogate.inference.sampling.adaptive_importance import Proposals
from hybridsurrogate.inference.warm_start import carried, thinned
from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.priors import to_normal

# proposals for each draw that a fit to other rows keeps: as many as a fit from scratch has
_PROPOSALS_A_DRAW = 3


def fitted_near(task: FitTask, known: PowerScaledSurrogate) -> PowerScaledSurrogate | None:
    """Return an estimator fitted to rows by the proposals of its fit to most of them and more.

    None where these do not serve. A mode that all rows together exclude gets no proposals, so this
    is for scores of rows left out, not for a model that is kept.

    Parameters
    ----------
    task : FitTask
        The rows.
    known : PowerScaledSurrogate
        Fitted, with the same unknowns.
    """
    problem, n, whole = task.problem, int(task.estimator.n_draws), known.inference_
    proposals = whole.proposals
    if proposals is not None:
        before = whole.first.model
        # these rows may lack an experiment
        if before.theta_names != problem.model.theta_names:
            return None
        proposals = thinned(proposals, _PROPOSALS_A_DRAW * n)
        proposals = _under_other_priors(proposals, before, problem.model)
    most = _PROPOSALS_A_DRAW * n
    fit = carried(problem, task.powers, proposals, n, most, task.random_state())
    if fit is None:
        return None
    fit.diagnostics.warn()
    return task.fitted_by(fit)


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
    if model.errors is not None and before.errors is not None:
        # known errors are in units of their median, which follows the rows, too
        at = model.n_unknowns + model.n_hyper
        points[:, at] += np.log(model.errors.unit / before.errors.unit)
    kept = np.isfinite(log_slope)
    return Proposals(points[kept], (proposals.log_density - log_slope)[kept])
