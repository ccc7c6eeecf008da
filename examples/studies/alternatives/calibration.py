"""The simulation fitted by least squares: where every alternative begins, and its term ends."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from hidden_effects.descent import slopes
from hidden_effects.fits import fit_form, fit_plain
from hidden_effects.forms import Form, plain_form
from hidden_effects.problem import Fit, Problem, pose, predict
from hidden_effects.simulations import Array

from hybridsurrogate.simulation.simulator import Simulator

Curve = Callable[[Array], Array]


class Measurements(NamedTuple):
    """All that a method gets to see of a case."""

    simulator: Simulator
    X: Array
    y: Array


@dataclass(frozen=True)
class Calibrated:
    """The simulation with its parameters at their best.

    ``followed`` is an orthonormal basis, (n, p), of what small changes of the parameters do.
    """

    problem: Problem
    fit: Fit
    output: Array
    residual: Array
    followed: Array

    def predict(self, X: Array) -> Array:
        """Run it at any inputs."""
        return predict(self.problem.simulator, self.fit, X)

    def beside(self, columns: Array) -> Array:
        """Return the part of columns, (..., n, q), that the parameters cannot follow."""
        return columns - self.followed @ (self.followed.T @ columns)


def calibrate(measured: Measurements, seed: int) -> Calibrated:
    """Fit the parameters alone, from many starts inside the support of their priors."""
    problem = pose(*measured, np.random.default_rng(seed))
    fit = fit_plain(problem)
    output = predict(measured.simulator, fit, measured.X)
    moves = slopes(problem, plain_form(), fit.numbers[None])[0]
    # a parameter that nothing depends on here gives no direction
    basis, sizes, _ = np.linalg.svd(moves, full_matrices=False)
    followed = basis[:, sizes > 1e-8 * sizes[0]]
    return Calibrated(problem, fit, output, measured.y - output, followed)


def with_term(calibrated: Calibrated, columns: Curve) -> Curve:
    """Fit the parameters anew, now beside a term that was found: (n, q) with free factors.

    What is found on residuals is what the parameters left of it; together they find their places.
    """

    def repeated(X: Array, shape: Array) -> Array:
        found = columns(X)
        return np.broadcast_to(found, (len(shape), *found.shape))

    form = Form("term", "", 1, np.empty((0, 2)), np.empty((1, 0)), repeated)
    fit = fit_form(calibrated.problem, form, calibrated.fit)
    return lambda X: predict(calibrated.problem.simulator, fit, X)
