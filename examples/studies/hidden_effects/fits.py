"""Least-squares fits of the explanations, and their price."""

from __future__ import annotations

import numpy as np

from hybridsurrogate.simulation.simulator import Simulator

from .descent import descend
from .forms import Form, forms, plain_form
from .problem import Fit, Problem, pose, residuals
from .simulations import Array
from .starts import N_STARTS, linearised_starts, spread_starts


def fit_kind(
    simulator: Simulator, X: Array, y: Array, kind: str, rng: np.random.Generator
) -> list[Fit]:
    """Fit one kind ("none" too), once for each possible target, the best first."""
    problem = pose(simulator, X, y, rng)
    plain = fit_plain(problem)
    if kind == "none":
        return [plain]
    fits = [fit_form(problem, form, plain) for form in forms(simulator, X) if form.kind == kind]
    return sorted(fits, key=lambda fit: fit.rss)


def fit_plain(problem: Problem) -> Fit:
    form = plain_form()
    rss = (residuals(problem, form, problem.spread) ** 2).sum(axis=1)
    return descend(problem, form, problem.spread[np.argsort(rss)[:N_STARTS]])


def fit_form(problem: Problem, form: Form, plain: Fit) -> Fit:
    linear = form.rewrite is None
    starts = (linearised_starts if linear else spread_starts)(problem, form, plain)
    return descend(problem, form, starts)


def bic(fit: Fit, n: int) -> float:
    """BIC of a least-squares fit; the noise counts as a fitted number."""
    p = len(fit.numbers) - len(fit.form.bounds)
    return n * np.log(max(fit.rss, 1e-300) / n) + (p + fit.form.n_numbers + 1) * np.log(n)
