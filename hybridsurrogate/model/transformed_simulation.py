"""The simulation on the scale of eta, with a cache of its last runs."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from hybridsurrogate.likelihoods import Likelihood
from hybridsurrogate.simulation.modification import Modification
from hybridsurrogate.simulation.simulator import Simulator
from hybridsurrogate.types import FloatArray

# runs kept at a time, and the numbers in the rows of one
_MOST_KEPT, _LARGEST_KEPT = 64, 20_000


class TransformedSimulation:
    """The simulation on the scale of eta; a class so that it can be pickled.

    A search climbs from one place once for every cause, so that a third of its runs are repeats:
    the latest are kept.
    """

    def __init__(self, simulator: Simulator, likelihood: Likelihood):
        self.simulator, self.likelihood = simulator, likelihood
        self._kept = lru_cache(_MOST_KEPT)(self._run_of_bytes)

    def __reduce__(self) -> tuple[Any, ...]:
        return TransformedSimulation, (self.simulator, self.likelihood)

    def modified(self, modifications: Sequence[Modification]) -> TransformedSimulation:
        """Return the simulation with changed dynamics."""
        return TransformedSimulation(self.simulator.modified(modifications), self.likelihood)

    def __call__(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Return the output (n,) for rows of inputs and parameters."""
        if not 0 < X.size + omega.size <= _LARGEST_KEPT:
            return self._run(X, omega)
        return self._kept(X.T.tobytes(), omega.T.tobytes(), len(X)).copy()

    def _run_of_bytes(self, inputs: bytes, parameters: bytes, n: int) -> FloatArray:
        # column by column, as simulations take them
        X, omega = (np.frombuffer(b).reshape(-1, n).T for b in (inputs, parameters))
        return self._run(X, omega)

    def _run(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        # parameters far in the tails may break a simulation: NaN there means impossible
        with np.errstate(all="ignore"):
            return self.likelihood.link(self.simulator.cached(self.simulator.held(X), omega))
