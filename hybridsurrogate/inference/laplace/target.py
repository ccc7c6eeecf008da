"""Step 1 where coefficients are not Gaussian given the rest: counts, heavy tails, own densities.

The coefficients in standard normal coordinates, v, are approximated given the other unknowns u by a
Gaussian at their mode (Rue, Martino and Chopin 2009, Journal of the Royal Statistical Society B
71:319). That marginalises u well enough to propose from, and proposes v given u; the weights of the
pairs (u, v) are exact, so the approximation costs effective draws and never correctness.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from hybridsurrogate.inference.laplace.inner_mode import GaussianFit, gaussian_fit
from hybridsurrogate.inference.laplace.linear_predictor import Design, PredictorPart
from hybridsurrogate.inference.sampling.settings import SETTINGS
from hybridsurrogate.likelihoods.base import Likelihood
from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.model.prior_density import prior_log_density, prior_of_unknowns
from hybridsurrogate.model.rows.observed import ObservedRows, SimulatedRows
from hybridsurrogate.model.statistics import (
    ROUNDING,
    Statistics,
    statistics,
)
from hybridsurrogate.numerics.blocks import LARGE_BLOCK, blocks
from hybridsurrogate.types import FloatArray, Prior

_LOG_2PI = float(np.log(2 * np.pi))


@dataclass(frozen=True)
class LaplacePosterior:
    """Power-scaled posterior of all unknowns under any likelihood.

    Attributes
    ----------
    model : MeasuredModel
    X, y, weights : ndarray of shape (n, n_columns), (n,), (n,)
        Measured rows, y on the scale of eta (for starting points), powers relative to
        ``measured_power``.
    observed : ndarray of shape (n,)
        y as measured.
    likelihood : Likelihood
    runs : SimulatedRows or None
    simulation_power, measured_power : float
    noise_prior : prior of sigma
    scale : float
        Spread of the output on the scale of eta.
    """

    model: MeasuredModel
    X: FloatArray
    y: FloatArray
    weights: FloatArray
    observed: FloatArray
    likelihood: Likelihood
    runs: SimulatedRows | None
    simulation_power: float
    measured_power: float
    noise_prior: Prior
    scale: float

    @property
    def n_dimensions(self) -> int:
        """Length of u."""
        return self.model.n_unknowns + self.model.n_hyper + 1

    is_exact = False
    # each value of the approximation is optimised, and is as rough as that is exact
    step_share = 0.5

    def with_model(self, model: MeasuredModel) -> LaplacePosterior:
        """Return the same posterior of another model."""
        return replace(self, model=model)

    def run_statistics(self, hyper: FloatArray) -> Statistics | None:
        """Return the statistics of the runs in the features at hyperparameters (n_hyper,)."""
        runs, basis = self.runs, self.model.basis.given(hyper)
        if runs is None or not len(basis.coefficient_mean):
            return None
        eta = self.likelihood.working_runs(runs.y) - basis.known(runs.X, runs.omega)
        return statistics(basis.features(runs.X, runs.omega), eta, self.scale, runs.weights)

    @property
    def n_coefficients(self) -> int:
        """Length of v: coefficients of the surrogate, then of the causes."""
        return len(self.model.basis.coefficient_mean) + len(self.model.column_sd)

    # --------------------------------------------------------------------- the exact density

    def joint_log_density(self, w: FloatArray) -> FloatArray:
        """Return the log density of all unknowns w = [u, v], (J, d + p): (J,)."""
        d = self.n_dimensions
        pieces = []
        for block in self._blocks(w):
            u, v = block[:, :d], block[:, d:]
            of_rows = self._design(u, truncated=False).log_likelihood(np.exp(u[:, -1:]), v)
            pieces.append(self._prior(u) + prior_log_density(v) + of_rows)
        out = np.concatenate(pieces)
        return np.where(np.isfinite(out), out, -np.inf)

    def _prior(self, u: FloatArray) -> FloatArray:
        """Return the log prior of u (J, d); every row is known but for its rounding."""
        prior = prior_of_unknowns(u, self.noise_prior)
        if not self.likelihood.scales_noise:
            return prior
        # else a surrogate that meets all rows exactly would have no noise at all, and no draws
        power = self.measured_power * float(self.weights.sum())
        if self.runs is not None:
            power += self.simulation_power * float(np.sum(self.runs.weights))
        return prior - 0.5 * power * (ROUNDING * self.scale / np.exp(u[:, -1])) ** 2

    def _design(self, u: FloatArray, truncated: bool) -> Design:
        """Return what is linear in v, for the runs and for the measured rows."""
        model = self.model
        values = model.values(u[:, :-1])
        hyper = values[:, model.n_unknowns :]
        factor = model.basis.factor(hyper) if model.n_hyper else None
        kept = np.arange(self.n_coefficients)
        if factor is not None and truncated:
            size = np.sqrt(np.sum(factor**2, axis=1))
            large = (size > SETTINGS.direction_share * size.max(axis=1, keepdims=True)).any(axis=0)
            factor = factor[:, :, large]
            kept = kept[np.concatenate([large, np.ones(len(model.column_sd), dtype=bool)])]
        parts = []
        if self.runs is not None and self.simulation_power:
            parts.append(self._run_part(hyper, factor))
        if self.measured_power:
            parts.append(self._measured_part(values, factor))
        return Design(parts, kept)

    def _run_part(self, hyper: FloatArray, factor: FloatArray | None) -> PredictorPart:
        assert self.runs is not None
        basis, runs = self.model.basis, self.runs
        features = self._run_features
        if basis.known_depends_on_hyper:
            J, n = len(hyper), len(runs.y)
            known = basis.known(
                np.tile(runs.X, (J, 1)), np.tile(runs.omega, (J, 1)), np.repeat(hyper, n, axis=0)
            ).reshape(J, n)
        else:
            known = basis.known(runs.X, runs.omega)[None]
        known = known + features @ basis.coefficient_mean
        whitened = features * basis.coefficient_sd if factor is None else features @ factor
        padding = [(0, 0)] * (whitened.ndim - 1) + [(0, len(self.model.column_sd))]
        rows = ObservedRows(runs.y, self.simulation_power * runs.weights)
        return PredictorPart(
            rows, known, np.pad(whitened, padding), np.ones((1, 1)), self.likelihood.of_runs
        )

    @cached_property
    def _run_features(self) -> FloatArray:
        assert self.runs is not None
        return self.model.basis.features(self.runs.X, self.runs.omega)

    def _measured_part(self, values: FloatArray, factor: FloatArray | None) -> PredictorPart:
        basis = self.model.basis
        parts = self.model.parts(self.X, values)
        known = parts.known + parts.features @ basis.coefficient_mean
        features = parts.features
        whitened = features * basis.coefficient_sd if factor is None else features @ factor
        columns = parts.columns * self.model.column_sd
        design = np.concatenate([whitened, columns], axis=2)
        rows = ObservedRows(self.observed, self.measured_power * self.weights)
        likelihood = self.model.likelihood_of(self.likelihood, values)
        return PredictorPart(rows, known, design, parts.noise, likelihood)

    def _blocks(self, u: FloatArray) -> list[FloatArray]:
        n = len(self.y) + (len(self.runs.y) if self.runs else 0)
        width = self.n_coefficients + 2
        cuts = blocks(max(len(u), 1), n * width + width**2, LARGE_BLOCK)
        return [u[some] for some in cuts]

    # ------------------------------------------------------------------ the approximation

    def search_density(self, u: FloatArray) -> FloatArray:
        """Return the Laplace approximation of the log density of u (J, d), v integrated out."""
        pieces = []
        for block in self._blocks(u):
            fit = self._fit(block, width_rounds=0)
            log_joint = self._prior(block) + fit.height
            pieces.append(log_joint - fit.log_det + 0.5 * fit.mode.shape[1] * _LOG_2PI)
        out = np.concatenate(pieces)
        return np.where(np.isfinite(out), out, -np.inf)

    def extended_log_density(self, points: FloatArray) -> FloatArray:
        """Return the exact log density of [u, e], (J, d + p), with v as in `to_ensemble`.

        With e standard normal it is proportional to the proposal where the approximation is exact.
        """
        d = self.n_dimensions
        pieces = []
        for block in self._blocks(points):
            u = block[:, :d]
            fit = self._fit(u)
            v = fit.draw(block[:, d:])
            of_rows = fit.design.log_likelihood(np.exp(u[:, -1:]), v)
            prior = self._prior(u) + prior_log_density(v)
            pieces.append(prior + of_rows - fit.log_det)
        out = np.concatenate(pieces)
        return np.where(np.isfinite(out), out, -np.inf)

    def resolved(
        self, points: FloatArray, random_state: np.random.RandomState
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return u, c and a of points [u, e] of `extended_log_density`."""
        return self.from_ensemble(self.to_ensemble(points), random_state)

    @property
    def n_noise(self) -> int:
        """Length of e."""
        return self.n_coefficients

    def to_ensemble(self, points: FloatArray) -> FloatArray:
        """Return [u, v] for points [u, e]."""
        d = self.n_dimensions
        v = [self._fit(block[:, :d]).draw(block[:, d:]) for block in self._blocks(points)]
        return np.hstack([points[:, :d], np.concatenate(v)])

    def from_ensemble(
        self, w: FloatArray, random_state: np.random.RandomState
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return u (J, d) and coefficients c (J, p) and a (J, q) of places w = [u, v]."""
        model = self.model
        d, p = self.n_dimensions, len(model.basis.coefficient_mean)
        v = w[:, d:]
        hyper = model.values(w[:, : d - 1])[:, model.n_unknowns :]
        factor = model.basis.factor(hyper) if model.n_hyper else None
        if factor is None:
            c = v[:, :p] * model.basis.coefficient_sd
        else:
            c = (factor @ v[:, :p, None])[..., 0]
        return w[:, :d], model.basis.coefficient_mean + c, v[:, p:] * model.column_sd

    def _fit(self, u: FloatArray, width_rounds: int = SETTINGS.width_rounds) -> GaussianFit:
        design = self._design(u, truncated=True)
        return gaussian_fit(design, np.exp(u[:, -1:]), width_rounds)
