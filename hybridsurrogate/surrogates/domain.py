"""Where a surrogate lives, and the rows that it is trained on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from hybridsurrogate.types import FloatArray


@dataclass(frozen=True)
class Domain:
    """The ranges on which a surrogate is defined, and the rows that it is trained on.

    Attributes
    ----------
    input_ranges : ndarray of shape (n_inputs, 2)
        Simulated range of each input.
    parameter_ranges : ndarray of shape (n_parameters, 2)
        Simulated range of each parameter, the assumed constants last.
    location, scale : float
        Mean and standard deviation of the outputs on the scale of eta, for default priors.
    simulate : callable or None
        ``simulate(X, omega) -> (n,)`` on the scale of eta; None when there are only runs.
    X, omega : ndarray of shape (n, n_inputs), (n, n_parameters)
        Inputs and parameters of the runs, or of the measured rows where there are no runs.
    eta : ndarray of shape (n,)
        Outputs of these rows on the scale of eta.
    input_names, parameter_names : tuple of str

    Examples
    --------
    >>> domain = Domain(np.array([[0, 4]]), np.array([[5, 15]]), location=0.0, scale=1.0)
    >>> domain.scaled(np.array([[3.0]]), np.array([[5.0]]))
    array([[ 0.5, -1. ]])
    """

    input_ranges: FloatArray
    parameter_ranges: FloatArray
    location: float
    scale: float
    simulate: Callable[[FloatArray, FloatArray], FloatArray] | None = None
    X: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    omega: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    eta: FloatArray = field(default_factory=lambda: np.empty(0))
    input_names: tuple[str, ...] = ()
    parameter_names: tuple[str, ...] = ()

    def scaled(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Map inputs and parameters to [-1, 1], (n, n_inputs + n_parameters).

        Parameters beyond the runs are fixed at the ends, where the runs stop.
        """
        low, high = self.parameter_ranges[:, 0], self.parameter_ranges[:, 1]
        points = np.hstack([X, np.clip(omega, low, high)])
        ranges = np.vstack([self.input_ranges, self.parameter_ranges])
        return (2 * points - ranges.sum(axis=1)) / (ranges[:, 1] - ranges[:, 0])
