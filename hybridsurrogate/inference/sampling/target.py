"""What samplers need of a density: one protocol, whatever integrates the coefficients out."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.model.statistics import Statistics
from hybridsurrogate.types import FloatArray, Prior


class Target(Protocol):
    """A posterior of u = [z_omega, z_theta, z_hyper, log sigma] with coefficients (c, a)."""

    @property
    def model(self) -> MeasuredModel:
        """Surrogate, causes and what is unknown of them."""

    @property
    def X(self) -> FloatArray:
        """Measured rows (n, n_columns)."""

    @property
    def y(self) -> FloatArray:
        """Measured outputs (n,) on the scale of eta."""

    @property
    def simulation_power(self) -> float:
        """Power of the likelihood of the runs."""

    @property
    def noise_prior(self) -> Prior:
        """Prior of sigma."""

    @property
    def scale(self) -> float:
        """Spread of the output on the scale of eta."""

    @property
    def is_exact(self) -> bool:
        """Whether the coefficients are integrated out in closed form."""

    @property
    def step_share(self) -> float:
        """Share of a standard deviation over which the search density is differenced."""

    @property
    def n_dimensions(self) -> int:
        """Length of u."""

    @property
    def n_noise(self) -> int:
        """Length of the standard normal e that stands for coefficients in points [u, e]."""

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

    def to_ensemble(self, points: FloatArray) -> FloatArray:
        """Return the places over which an ensemble walks of extended points."""

    def from_ensemble(
        self, w: FloatArray, random_state: np.random.RandomState
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return u, c and a of places over which an ensemble walked."""
