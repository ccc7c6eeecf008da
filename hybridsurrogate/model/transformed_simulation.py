"""The simulation on the scale of eta, with a cache of its last runs."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.likelihoods import Likelihood
from hybridsurrogate.numerics.digits import number
from hybridsurrogate.simulation.modification import Modification
from hybridsurrogate.simulation.outputs import OneOutput
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
        # inputs and parameters (1, k) of the first row without an output
        self._failed: tuple[FloatArray, FloatArray] | None = None

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
        inputs = self.simulator.held(X)
        with np.errstate(all="ignore"):
            outputs = self.simulator.cached(inputs, omega)
            if self._failed is None and not np.isfinite(outputs).all():
                row = int(np.argmin(np.isfinite(outputs)))
                self._failed = inputs[row : row + 1].copy(), omega[row : row + 1].copy()
            return self.likelihood.link(outputs)

    def failure(self, X: FloatArray) -> str:
        """Return where the simulation failed, and what it raised; "" if it did not.

        At measured rows in the middle of the priors, or where a run failed first.

        Parameters
        ----------
        X : ndarray of shape (n, n_columns)
            Measured rows, the simulation's inputs first.
        """
        simulator = self.simulator
        if isinstance(simulator.function, OneOutput):
            # it hides what the simulation of all outputs raised, and has a row for each of them
            simulator = simulator.function.simulator
            places = X[:, : len(simulator.input_names)]
            X = X[np.sort(np.unique(places, axis=0, return_index=True)[1])]
        k = len(simulator.input_names)
        inputs = X[:, :k]
        middle = [np.mean(ends) for ends in simulator.parameter_ranges.values()]
        failed, said = _failed(simulator, inputs, np.tile(middle, (len(inputs), 1)))
        if failed.any():
            first = int(np.argmax(failed))
            return (
                f"At the middle of the priors the simulation fails at {int(failed.sum())} of "
                f"{len(inputs)} measured rows, first in row {first + 1} (index {first}): {said}."
            )
        if self._failed is None:
            return ""
        at, omega = self._failed[0][:, :k], self._failed[1]
        names = (*simulator.input_names, *simulator.parameter_ranges)
        values = zip(names, np.hstack([at, omega])[0], strict=False)
        place = ", ".join(f"{name} = {number(value)}" for name, value in values)
        return f"At {place} the simulation fails: {_failed(simulator, at, omega)[1]}."


def _failed(
    simulator: Simulator, X: FloatArray, omega: FloatArray
) -> tuple[NDArray[np.bool_], str]:
    """Return which rows (n,) have no output, and what the first run that raised said."""
    with np.errstate(all="ignore"):
        outputs, said = simulator.tried(X, omega)
    failed = np.asarray(~np.isfinite(outputs.reshape(len(X), -1)).all(axis=1))
    return failed, said or "the output is NaN or infinite"
