"""Where a descent starts."""

from __future__ import annotations

import numpy as np

from .descent import slopes
from .forms import Form, plain_form
from .problem import Fit, Problem, added_columns, residuals, run_curves
from .simulations import Array

N_STARTS = 16
_N_CENTRES = 24


def spread_starts(problem: Problem, form: Form, plain: Fit) -> Array:
    """Starts for a form that changes the simulation's own inputs: tried all over the box."""
    p = len(problem.low)
    around = np.column_stack([np.tile(plain.numbers, (len(form.starts), 1)), form.starts])
    n_each = 3
    anywhere = np.column_stack(
        [
            np.repeat(problem.spread, n_each, axis=0),
            form.starts[np.arange(n_each * len(problem.spread)) * 4 % len(form.starts)],
        ]
    )
    found = []
    for points, n_best in ((around, 4), (anywhere, N_STARTS - 4)):
        rss = (residuals(problem, form, points) ** 2).sum(axis=1)
        found.append(points[np.argsort(rss)[:n_best]])
    return np.concatenate(found).reshape(-1, p + len(form.bounds))


def linearised_starts(problem: Problem, form: Form, plain: Fit) -> Array:
    """Starts for a form with columns: every shape, the parameters free to first order.

    A wrong shape often looks right until the parameters may move with it, so they move already
    here: around the plain fit and around parameter values all over the priors.
    """
    centres = np.concatenate([plain.numbers[None], problem.spread[:_N_CENTRES]])
    curves = run_curves(problem.simulator, plain_form(), problem.X, centres)
    jacobians = slopes(problem, plain_form(), centres, curves)
    found = []
    for i, (centre, curve, jacobian) in enumerate(zip(centres, curves, jacobians, strict=True)):
        rest = problem.y - curve
        columns = added_columns(form, problem.X, form.starts, curve[None])
        basis = np.linalg.qr(jacobian)[0]
        outside = columns - basis @ (basis.T @ columns)
        gram = outside.transpose(0, 2, 1) @ outside
        # a curve that the parameters follow entirely leaves nothing to divide by
        scale = np.einsum("snq,snq->s", columns, columns)
        gram += 1e-9 * scale[:, None, None] * np.eye(gram.shape[-1])
        against = outside.transpose(0, 2, 1) @ (rest - basis @ (basis.T @ rest))
        coefficients = np.linalg.solve(gram, against[..., None])[..., 0]
        explained = np.einsum("sq,sq->s", coefficients, against)
        n_best = N_STARTS if i == 0 else 2
        for s in np.argsort(-explained)[:n_best]:
            left = rest - columns[s] @ coefficients[s]
            move = np.linalg.lstsq(jacobian, left, rcond=1e-8)[0]
            omega = np.clip(centre + move, problem.low, problem.high)
            found.append(np.concatenate([omega, form.starts[s]]))
    points = np.array(found)
    rss = (residuals(problem, form, points) ** 2).sum(axis=1)
    order = np.argsort(rss)
    # not all starts with one shape: the best of each shape first
    shapes = points[order, len(problem.low) :].round(12)
    first = np.unique(shapes, axis=0, return_index=True)[1]
    others = np.setdiff1d(np.arange(len(order)), first)
    return points[order[np.concatenate([np.sort(first), others])[:N_STARTS]]]
