"""Measured rows of any likelihood as rows that are normal to first order.

Screening needs normal rows. Around the fit without a cause, rows of any likelihood are replaced by
those of one step of Fisher scoring: a working response and a noise of each row, of which the latter
does not depend on what was measured. Measured and replicated data meet the same approximation, so
that a p-value is right whatever it neglects; the most probable causes are scored by the likelihood
(`exact_scores.py`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hybridsurrogate.model.posterior import Posterior
from hybridsurrogate.model.problem import Problem
from hybridsurrogate.model.working_point import WorkingPoint

# noise of data that have none, for a search: well above what it cannot see (`context.FLOOR`)
BLUR = 1e-5


def on_working_rows(problem: Problem, posterior: Posterior) -> Problem:
    """Return the problem as a search sees it: the same where rows are normal and alike.

    Parameters
    ----------
    problem : Problem
        Without effects.
    posterior : Posterior
        Of the estimator without effects.
    """
    if problem.likelihood.gaussian:
        return _with_weights(problem)
    eta, noise = posterior.eta(problem.X)
    eta = np.mean(eta[np.isfinite(eta).all(axis=1)], axis=0)
    factor = problem.model.known_noise(problem.X)
    draws = np.median(noise / factor, axis=1)
    point = WorkingPoint(problem.likelihood, eta, float(np.median(draws)), draws, factor)
    model = replace(problem.model, has_row_noise=True)
    X = np.column_stack([problem.X, np.ones(len(eta))])
    return expanded(replace(problem, model=model, X=X), point)


def _with_weights(problem: Problem) -> Problem:
    """Return a problem whose rows have a variance of sigma^2 over their weight.

    N(y; m, sigma^2)^w is N(y; m, sigma^2 / w) but for a factor, which would make w measurements of
    one: a curve through each row would then leave no noise at all.
    """
    if np.all(problem.weights == 1.0):
        return problem
    model = replace(problem.model, has_row_noise=True)
    return replace(problem, model=model, X=np.column_stack([problem.X, problem.weights**-0.5]))


def expanded(problem: Problem, point: WorkingPoint) -> Problem:
    """Return a problem whose rows carry their noise, expanded at a point."""
    X = problem.X.copy()
    X[:, -1] = point.noise() / np.sqrt(problem.weights)
    return replace(problem, X=X, y=point.response(problem.observed), working_point=point)


def blurred(problem: Problem) -> Problem:
    """Return the problem with a little noise in the output, for data that have none.

    Where residuals are rounding, their tails and their order mean nothing.
    """
    noise = np.random.RandomState(0).standard_normal(len(problem.y))
    return replace(problem, y=problem.y + BLUR * problem.scale * noise)
