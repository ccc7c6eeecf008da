"""Levenberg and Marquardt's descent, from many starts at once."""

from __future__ import annotations

import numpy as np

from .forms import Form
from .problem import Fit, Problem, added_columns, residuals, run_curves
from .simulations import Array

_N_STEPS = 30


def slopes(problem: Problem, form: Form, numbers: Array, at: Array | None = None) -> Array:
    """Differentiate curves, if ``at`` holds them, or else residuals: (S, n, number)."""
    low, high = _box(problem, form)
    step = 1e-6 * (high - low)
    step = np.where(numbers + step > high, -step, step)
    moved = numbers[:, None, :] + step[:, :, None] * np.eye(len(low))
    flat = moved.reshape(-1, len(low))
    if at is None:
        after, before = residuals(problem, form, flat), residuals(problem, form, numbers)
    else:
        after, before = run_curves(problem.simulator, form, problem.X, flat), at
    change = after.reshape(len(numbers), len(low), -1) - before[:, None, :]
    return (change / step[..., None]).transpose(0, 2, 1)


def _box(problem: Problem, form: Form) -> tuple[Array, Array]:
    return (
        np.concatenate([problem.low, form.bounds[:, 0]]),
        np.concatenate([problem.high, form.bounds[:, 1]]),
    )


def descend(problem: Problem, form: Form, starts: Array) -> Fit:
    """Levenberg and Marquardt's descent inside the box, from all starts at once."""
    low, high = _box(problem, form)
    width = high - low
    moves = np.ones(len(low), dtype=bool)
    moves[len(problem.low) :] = form.shape_is_free
    numbers = np.clip(starts, low, high)
    left = residuals(problem, form, numbers)
    rss = (left**2).sum(axis=1)
    damping, idle = np.full(len(numbers), 1e-3), 0
    for _ in range(_N_STEPS):
        jacobian = slopes(problem, form, numbers) * width
        gradient = np.einsum("snv,sn->sv", jacobian, left)
        hessian = jacobian.transpose(0, 2, 1) @ jacobian
        # a number at a bound that would leave the box stays where it is
        stuck = (numbers <= low) & (gradient > 0) | (numbers >= high) & (gradient < 0) | ~moves
        gradient = np.where(stuck, 0.0, gradient)
        hessian[stuck[:, :, None] | stuck[:, None, :]] = 0.0
        diagonal = np.einsum("svv->sv", hessian)
        diagonal += damping[:, None] * diagonal + 1e-12 * rss[:, None] + 1e-300
        diagonal[stuck] = 1.0
        move = -np.linalg.solve(hessian, gradient[..., None])[..., 0]
        trial = np.clip(numbers + width * move, low, high)
        trial_left = residuals(problem, form, trial)
        trial_rss = (trial_left**2).sum(axis=1)
        better = trial_rss < rss
        gain = np.where(better, 1 - trial_rss / np.maximum(rss, 1e-300), 0.0)
        numbers[better], left[better], rss[better] = (
            trial[better],
            trial_left[better],
            trial_rss[better],
        )
        damping = np.clip(np.where(better, damping / 5, damping * 8), 1e-9, 1e9)
        idle = 0 if (gain > 1e-8).any() else idle + 1
        if idle == 4:  # shorter steps, by damping, have been tried from all starts
            break
    best = int(np.argmin(rss))
    numbers = numbers[best]
    return Fit(form, numbers, _coefficients(problem, form, numbers), float(rss[best]))


def _coefficients(problem: Problem, form: Form, numbers: Array) -> Array:
    curves = run_curves(problem.simulator, form, problem.X, numbers[None])
    columns = added_columns(form, problem.X, numbers[None, len(problem.low) :], curves)
    if columns is None:
        return np.empty(0)
    return np.linalg.lstsq(columns[0], problem.y - curves[0], rcond=None)[0]
