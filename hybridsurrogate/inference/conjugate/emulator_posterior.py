"""The posterior of a surrogate's coefficients given the simulation alone."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hybridsurrogate.inference.conjugate.sufficient_statistics import Statistics
from hybridsurrogate.priors import FloatArray
from hybridsurrogate.surrogates.basis import Basis


class EmulatorPosterior(NamedTuple):
    """Gaussian posterior of the surrogate's coefficients: mean (p,) and factor (p, p) of V."""

    mean: FloatArray
    factor: FloatArray


def emulator_posterior(
    basis: Basis, simulation: Statistics | None, power: float = 1.0
) -> EmulatorPosterior:
    """Return the posterior of the coefficients given the simulation alone, its noise estimated."""
    precision = basis.coefficient_sd**-2.0
    mean = basis.coefficient_mean
    if simulation is None or not power or not simulation.n or not len(mean):
        return EmulatorPosterior(mean, np.diag(basis.coefficient_sd))
    variance = max(simulation.yy / simulation.n, 1e-300)
    for _ in range(8):
        matrix = np.diag(precision) + power * simulation.ff / variance
        right = precision * basis.coefficient_mean + power * simulation.fy / variance
        mean = np.linalg.solve(matrix, right)
        squares = simulation.yy - 2 * mean @ simulation.fy + mean @ simulation.ff @ mean
        used = np.trace(np.linalg.solve(matrix, power * simulation.ff / variance))
        variance = max(squares, 1e-14 * simulation.yy) / max(simulation.n - used, 1.0)
    lower = np.linalg.cholesky(np.diag(precision) + power * simulation.ff / variance)
    return EmulatorPosterior(mean, np.linalg.inv(lower).T)
