"""Rows with a likelihood: measured ones, and those of simulation runs."""

from __future__ import annotations

from dataclasses import dataclass

from hybridsurrogate.types import FloatArray


@dataclass(frozen=True)
class ObservedRows:
    """Rows with a likelihood: observed values and the powers of their densities.

    Attributes
    ----------
    y, weights : ndarray of shape (n,)
    """

    y: FloatArray
    weights: FloatArray


@dataclass(frozen=True)
class SimulatedRows(ObservedRows):
    """Simulation runs: inputs (n, n_inputs), parameters (n, n_parameters) and values."""

    X: FloatArray
    omega: FloatArray
