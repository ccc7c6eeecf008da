"""An explanation put to measurements: what it leaves of them, and what it predicts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import qmc

from hybridsurrogate.simulation.simulator import Simulator

from .forms import Form
from .simulations import Array


@dataclass(frozen=True)
class Fit:
    """A fitted form: ``numbers`` are the parameters, then the shape numbers."""

    form: Form
    numbers: Array
    coefficients: Array
    rss: float


@dataclass(frozen=True)
class Problem:
    simulator: Simulator
    X: Array
    y: Array
    low: Array  # of the parameters
    high: Array
    spread: Array  # (s, p) parameter values all over the priors' support


def pose(simulator: Simulator, X: Array, y: Array, rng: np.random.Generator) -> Problem:
    ranges = [simulator.parameter_ranges[name] for name in simulator.parameter_names]
    low, high = np.array(ranges).T
    spread = low + (high - low) * qmc.Sobol(len(low), rng=rng).random(64)
    return Problem(simulator, X, y, low, high, spread)


def run_curves(simulator: Simulator, form: Form, X: Array, numbers: Array) -> Array:
    """Run the simulation for S sets of numbers, all in one call: (S, n)."""
    p = len(simulator.parameter_names)
    constants = [simulator.assumed[name].value for name in simulator.assumed_names]
    omega = np.empty((len(numbers), len(X), p + len(constants)))
    omega[..., :p] = numbers[:, None, :p]
    omega[..., p:] = constants
    if form.rewrite is not None:
        omega = form.rewrite(X, omega, numbers[:, p:])
    inputs = np.tile(X[:, : len(simulator.input_names)], (len(numbers), 1))
    values = simulator(inputs, omega.reshape(-1, omega.shape[-1]))
    return values.reshape(len(numbers), len(X))


def added_columns(form: Form, X: Array, shape: Array, curves: Array) -> Array | None:
    if form.kind == "gain":
        return curves[..., None]
    return None if form.columns is None else form.columns(X, shape)


def residuals(problem: Problem, form: Form, numbers: Array) -> Array:
    """Return what is left of y, (S, n), the coefficients being at their best for each set."""
    curves = run_curves(problem.simulator, form, problem.X, numbers)
    columns = added_columns(form, problem.X, numbers[:, len(problem.low) :], curves)
    rest = problem.y - curves
    if columns is None:
        return rest
    q = np.linalg.qr(columns)[0]
    return rest - np.einsum("snq,sq->sn", q, np.einsum("snq,sn->sq", q, rest))


def predict(simulator: Simulator, fit: Fit, X: Array) -> Array:
    """Predict with a fitted explanation at any inputs, beyond the measured ones too."""
    numbers = fit.numbers[None]
    curves = run_curves(simulator, fit.form, X, numbers)
    columns = added_columns(fit.form, X, numbers[:, len(simulator.parameter_names) :], curves)
    return curves[0] if columns is None else curves[0] + columns[0] @ fit.coefficients
