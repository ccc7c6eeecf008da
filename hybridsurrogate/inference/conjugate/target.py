"""What samplers need of a density, and what all posteriors of step 1 hold."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.model.statistics import Statistics
from hybridsurrogate.types import FloatArray, Prior


class Target(ABC):
    """A posterior of u = [z_omega, z_theta, z_hyper, log sigma] with coefficients (c, a).

    Attributes
    ----------
    model : MeasuredModel
        Surrogate, causes and what is unknown of them.
    X, y : ndarray of shape (n, n_columns), (n,)
        Measured rows, y on the scale of eta.
    scale : float
        Spread of the output on the scale of eta.
    is_exact : bool
        Whether the coefficients are integrated out in closed form.
    """

    model: MeasuredModel
    X: FloatArray
    y: FloatArray
    scale: float
    is_exact: bool

    @property
    def n_dimensions(self) -> int:
        """Length of u."""
        return self.model.n_unknowns + self.model.n_hyper + 1

    @property
    def n_noise(self) -> int:
        """Length of the standard normal e that stands for coefficients in points [u, e]."""
        return 0

    @abstractmethod
    def search_density(self, u: FloatArray) -> FloatArray:
        """Return the log density of u (J, d), at least approximately."""

    @abstractmethod
    def extended_log_density(self, points: FloatArray, /) -> FloatArray:
        """Return the exact log density of [u, e] (J, d + n_noise)."""

    @abstractmethod
    def resolved(
        self, points: FloatArray, /, random_state: np.random.RandomState
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return u, c and a of extended points."""

    @abstractmethod
    def joint_log_density(self, w: FloatArray, /) -> FloatArray:
        """Return the exact log density of what an ensemble walks over: u, or [u, v]."""

    @abstractmethod
    def to_ensemble(self, points: FloatArray) -> FloatArray:
        """Return the places over which an ensemble walks of extended points."""

    @abstractmethod
    def from_ensemble(
        self, w: FloatArray, /, random_state: np.random.RandomState
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return u, c and a of places over which an ensemble walked."""


@dataclass(frozen=True)
class PowerScaledPosterior(Target):
    """The posterior of step 1 in its plain coordinates.

    Attributes
    ----------
    model : MeasuredModel
    X, y, weights : ndarray of shape (n, n_columns), (n,), (n,)
        Measured rows, y on the scale of eta, and the powers of their likelihoods relative to
        ``measured_power``.
    simulation_power, measured_power : float
        alpha_S and alpha_R.
    noise_prior : prior of sigma
    scale : float
        Spread of the output on the scale of eta.
    """

    model: MeasuredModel
    X: FloatArray
    y: FloatArray
    weights: FloatArray
    simulation_power: float
    measured_power: float
    noise_prior: Prior
    scale: float

    def with_model(self, model: MeasuredModel) -> Self:
        """Return the same posterior of another model."""
        return replace(self, model=model)

    @abstractmethod
    def run_statistics(self, hyper: FloatArray) -> Statistics | None:
        """Return the statistics of the runs in the features at hyperparameters (n_hyper,)."""
