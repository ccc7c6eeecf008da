"""Problems of rows of one output, for tests of what follows from them."""

from __future__ import annotations

import numpy as np

from hybridsurrogate.effects.base import Cause
from hybridsurrogate.likelihoods import Likelihood
from hybridsurrogate.model.problem import Problem, plain_problem
from hybridsurrogate.model.rows.measured_data import MeasuredData
from hybridsurrogate.simulation.simulator import SimulationData, Simulator
from hybridsurrogate.surrogates.basis import Surrogate
from hybridsurrogate.types import FloatArray, Prior


def make_problem(
    simulation: SimulationData | Simulator | None,
    surrogate: Surrogate,
    likelihood: Likelihood,
    noise_prior: Prior | None,
    effects: tuple[Cause, ...],
    columns: tuple[str, ...],
    X: FloatArray,
    y: FloatArray,
) -> Problem:
    """Return the problem of rows of one output, as they are."""
    ones, order = np.ones(len(y)), range(len(columns))
    data = MeasuredData(X, y, ones, None, order, columns, simulation, None, None)
    plain = plain_problem(data, surrogate, likelihood, noise_prior)
    return plain.on_rows(X, y, ones).with_effects(effects)
