"""What samplers ask of a density: one protocol, whatever integrates the coefficients out."""

# ruff: noqa: D102 - the docstring of the class tells its attributes
from __future__ import annotations

from typing import Protocol

import numpy as np

from hybridsurrogate.inference.conjugate.sufficient_statistics import Statistics
from hybridsurrogate.inference.model.observation import MeasuredModel
from hybridsurrogate.priors import FloatArray, Prior


class Target(Protocol):
    """A posterior of u = [z_omega, z_theta, z_hyper, log sigma] with coefficients (c, a).

    Attributes
    ----------
    model : MeasuredModel
    X, y : ndarray of shape (n, n_columns), (n,)
        Measured rows, y on the scale of eta.
    simulation_power : float
    noise_prior : prior of sigma
    scale : float
        Spread of the output on the scale of eta.
    is_exact : bool
        Whether the coefficients are integrated out in closed form.
    step_share : float
        Share of a standard deviation that a difference of the search density needs.
    n_dimensions, n_noise : int
        Length of u, and of the standard normal noise e that stands for coefficients in extended
        points [u, e].
    """

    @property
    def model(self) -> MeasuredModel: ...
    @property
    def X(self) -> FloatArray: ...
    @property
    def y(self) -> FloatArray: ...
    @property
    def simulation_power(self) -> float: ...
    @property
    def noise_prior(self) -> Prior: ...
    @property
    def scale(self) -> float: ...
    @property
    def is_exact(self) -> bool: ...
    @property
    def step_share(self) -> float: ...
    @property
    def n_dimensions(self) -> int: ...
    @property
    def n_noise(self) -> int: ...

    def with_model(self, model: MeasuredModel) -> Target:
        """Return the same posterior of another model."""

    def run_statistics(self, hyper: FloatArray) -> Statistics | None:
        """Return the statistics of the runs in the features at hyperparameters (n_hyper,)."""

    def search_density(self, u: FloatArray) -> FloatArray:
        """Return the log density of u (J, d), at least approximately."""

    def extended_log_density(self, points: FloatArray) -> FloatArray:
        """Return the exact log density of [u, e] (J, d + n_noise)."""

    def resolved(
        self, points: FloatArray, random_state: np.random.RandomState
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return u, c and a of extended points."""

    def joint_log_density(self, w: FloatArray) -> FloatArray:
        """Return the exact log density of what an ensemble walks over: u, or [u, v]."""

    def walked(self, points: FloatArray) -> FloatArray:
        """Return the places over which an ensemble walks of extended points."""

    def unwalked(
        self, w: FloatArray, random_state: np.random.RandomState
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return u, c and a of places over which an ensemble walked."""
