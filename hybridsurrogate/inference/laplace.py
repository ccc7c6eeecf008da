"""Coefficients by Laplace's approximation, for likelihoods that are not normal.

The coefficients in standard normal coordinates, v, are approximated given the other unknowns u by a
Gaussian at their mode (Rue, Martino and Chopin 2009, Journal of the Royal Statistical Society B
71:319). That marginalises u well enough to propose from, and proposes v given u; the weights of the
pairs (u, v) are exact, so the approximation costs effective draws and never correctness.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.inference.conjugate.target import PowerScaledPosterior
from hybridsurrogate.inference.sampling.settings import SETTINGS
from hybridsurrogate.likelihoods.base import Likelihood
from hybridsurrogate.model.rows.measured_data import ObservedRows, SimulatedRows
from hybridsurrogate.model.statistics import (
    Statistics,
    prior_log_density,
    prior_of_unknowns,
    statistics,
)
from hybridsurrogate.numerics.linear_algebra import (
    LARGE_BLOCK,
    NEGLIGIBLE,
    blocks,
    log_det_of,
    nudged_cholesky,
)
from hybridsurrogate.types import FloatArray


@dataclass(frozen=True)
class PredictorPart:
    """``eta = known + design @ v`` for some rows; a design that all draws share is (n, p).

    ``likelihood`` is that of its rows, for as many draws. ``width`` (J, n) is the standard
    deviation of eta; None: not computed.
    """

    rows: ObservedRows
    known: FloatArray
    design: FloatArray
    noise: FloatArray
    likelihood: Likelihood
    width: FloatArray | None = None

    def eta(self, v: FloatArray) -> FloatArray:
        """Return eta (J, n) for v (J, p)."""
        if self.design.ndim == 2:
            return self.known + v @ self.design.T
        return self.known + (self.design @ v[..., None])[..., 0]

    def log_likelihood(self, sigma: FloatArray, v: FloatArray, smoothed: bool) -> FloatArray:
        """Return the log likelihood (J,) for sigma (J, 1) and v (J, p); see `Design`."""
        log_density_of = self.likelihood.smoothed if smoothed else self.likelihood.log_density
        width = (self.width,) if smoothed else ()
        with np.errstate(over="ignore", invalid="ignore"):
            density = log_density_of(self.rows.y, self.eta(v), sigma * self.noise, *width)
            return density @ self.rows.weights

    def derivatives(self, sigma: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return slope and curvature of the log likelihood in eta, (J, n)."""
        with np.errstate(over="ignore", invalid="ignore"):
            score, curvature = self.likelihood.derivatives(
                self.rows.y, self.eta(v), sigma * self.noise, self.width
            )
        # impossible points have no direction: they stay where they are
        score, curvature = (np.where(np.isfinite(a), a, 0.0) for a in (score, curvature))
        return score * self.rows.weights, curvature * self.rows.weights

    def back(self, score: FloatArray) -> FloatArray:
        """Return the gradient in v, (J, p), from that in eta, (J, n)."""
        if self.design.ndim == 2:
            return score @ self.design
        return (score[:, None, :] @ self.design)[:, 0]

    def gram(self, curvature: FloatArray) -> FloatArray:
        """Return the precision that the rows give v, (J, p, p), from curvatures in eta."""
        if self.design.ndim == 3:
            return np.swapaxes(self.design, 1, 2) @ (self.design * curvature[..., None])
        p = self.design.shape[1]
        upper = np.triu_indices(p)
        products = curvature @ (self.design[:, upper[0]] * self.design[:, upper[1]])
        out = np.empty((len(curvature), p, p))
        out[:, upper[0], upper[1]] = out[:, upper[1], upper[0]] = products
        return out

    def take(self, active: FloatArray) -> PredictorPart:
        """Return the part for some of the draws."""
        return PredictorPart(
            self.rows,
            self.known if len(self.known) == 1 else self.known[active],
            self.design if self.design.ndim == 2 else self.design[active],
            self.noise if len(self.noise) == 1 else self.noise[active],
            self.likelihood.take(active),
            None if self.width is None else self.width[active],
        )

    def widened(self, factor: FloatArray) -> PredictorPart:
        """Return the part with the deviations of eta for precisions ``factor @ factor'``."""
        design = np.broadcast_to(self.design, (len(factor), *self.design.shape[-2:]))
        half = np.linalg.solve(factor, np.swapaxes(design, 1, 2))
        return replace(self, width=np.sqrt(np.sum(half**2, axis=1)))


@dataclass(frozen=True)
class Design:
    """Parts linear in ``v[:, kept]``."""

    parts: list[PredictorPart]
    kept: NDArray[np.intp]

    def log_likelihood(
        self, sigma: FloatArray, v: FloatArray, smoothed: bool = False
    ) -> FloatArray:
        """Return the log likelihood (J,) of all rows, for sigma (J, 1) and v (J, p).

        Smoothed: averaged over the width of eta.
        """
        total = np.zeros(len(v))
        for part in self.parts:
            total += part.log_likelihood(sigma, v[:, self.kept], smoothed)
        return total

    def take(self, active: FloatArray) -> Design:
        """Return the design for some of the draws."""
        if active.all():
            return self
        return Design([part.take(active) for part in self.parts], self.kept)

    def widened(self, factor: FloatArray) -> Design:
        """Return the design with all its parts widened."""
        return Design([part.widened(factor) for part in self.parts], self.kept)


@dataclass(frozen=True)
class GaussianFit:
    """Gaussian approximation of v for J draws of all else; v is standard normal a priori.

    Attributes
    ----------
    design : Design
        Which v it is about.
    mode : ndarray of shape (J, r)
    factor : ndarray of shape (J, r, r)
        Cholesky factor of the precision.
    log_det : ndarray of shape (J,)
        Of the factor.
    height : ndarray of shape (J,)
        Log density at the mode, prior and rows.
    """

    design: Design
    mode: FloatArray
    factor: FloatArray
    log_det: FloatArray
    height: FloatArray

    def draw(self, e: FloatArray) -> FloatArray:
        """Return v for standard normal e (J, p); directions that are not kept stay e."""
        kept = self.design.kept
        transposed = np.swapaxes(self.factor, 1, 2)
        out = e.copy()
        out[:, kept] = self.mode + np.linalg.solve(transposed, e[:, kept, None])[..., 0]
        return out


def gaussian_fit(whole: Design, sigma: FloatArray, width_rounds: int) -> GaussianFit:
    """Return the approximation for noise scales sigma (J, 1).

    Where the density is rough, log density and derivatives are averaged over the distribution of
    eta in the approximation itself, in so many rounds. This makes it the variational one (Opper and
    Archambeau 2009, Neural Computation 21:786).
    """
    # inside, v holds the directions that are kept and nothing else
    design = Design(whole.parts, np.arange(len(whole.kept)))
    v: FloatArray = np.zeros((len(sigma), len(whole.kept)))
    if v.shape[1] and any(part.likelihood.rough for part in whole.parts):
        for _ in range(width_rounds):
            v, _ = _climb(design, sigma, v, SETTINGS.few_rounds)
            design = design.widened(nudged_cholesky(_derivatives(design, sigma, v)[1]))
    v, height = _climb(design, sigma, v, SETTINGS.mode_steps)
    factor = nudged_cholesky(_derivatives(design, sigma, v)[1])
    return GaussianFit(whole, v, factor, log_det_of(factor), height)


def _climb(
    design: Design, sigma: FloatArray, v: FloatArray, n_steps: int
) -> tuple[FloatArray, FloatArray]:
    """Climb from v (J, p) by Newton steps, halved where they overshoot; return mode, value."""
    v = v.copy()
    value = _smoothed_density(design, sigma, v)
    active = np.ones(len(v), dtype=bool)
    for _ in range(n_steps if v.shape[1] else 0):
        some = design.take(active)
        step = _newton_step(some, sigma[active], v[active])
        # a full step, a quarter and a sixteenth: the best of them counts
        trials = v[active] + step * np.array([1.0, 0.25, 1 / 16])[:, None, None]
        values = np.stack([_smoothed_density(some, sigma[active], t) for t in trials])
        values = np.where(np.isfinite(values), values, -np.inf)
        best = values.argmax(axis=0)
        index = np.arange(len(best))
        better = values[best, index] > value[active]
        gain = np.zeros(len(best))
        gain[better] = values[best, index][better] - value[active][better]
        climber = np.flatnonzero(active)
        v[climber[better]] = trials[best, index][better]
        value[climber[better]] = values[best, index][better]
        active[climber[~(gain > SETTINGS.mode_gain)]] = False
        if not active.any():
            break
    return v, value


def _smoothed_density(design: Design, sigma: FloatArray, v: FloatArray) -> FloatArray:
    return prior_log_density(v) + design.log_likelihood(sigma, v, smoothed=True)


def _derivatives(design: Design, sigma: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the gradient (J, p) and minus the Hessian (J, p, p) of `_smoothed_density`."""
    gradient, hessian = -v, np.broadcast_to(np.eye(v.shape[1]), (*v.shape, v.shape[1]))
    for part in design.parts:
        score, curvature = part.derivatives(sigma, v)
        gradient = gradient + part.back(score)
        hessian = hessian + part.gram(curvature)
    return gradient, hessian


def _newton_step(design: Design, sigma: FloatArray, v: FloatArray) -> FloatArray:
    gradient, hessian = _derivatives(design, sigma, v)
    # rows far off may count so much that the prior is lost in rounding, and columns are alike
    factor = nudged_cholesky(hessian)
    half = np.linalg.solve(factor, gradient[..., None])
    return np.linalg.solve(np.swapaxes(factor, 1, 2), half)[..., 0]


_LOG_2PI = float(np.log(2 * np.pi))


@dataclass(frozen=True)
class LaplacePosterior(PowerScaledPosterior):
    """Power-scaled posterior of all unknowns under any likelihood.

    Its y are for starting points alone.

    Attributes
    ----------
    observed : ndarray of shape (n,)
        y as measured.
    likelihood : Likelihood
    runs : SimulatedRows or None
    """

    observed: FloatArray
    likelihood: Likelihood
    runs: SimulatedRows | None

    is_exact = False

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
        return prior - 0.5 * power * (NEGLIGIBLE * self.scale / np.exp(u[:, -1])) ** 2

    def _design(self, u: FloatArray, truncated: bool) -> Design:
        """Return what is linear in v, for the runs and for the measured rows."""
        model = self.model
        values = model.values(u[:, :-1])
        hyper = values[:, model.n_unknowns :]
        factor = model.basis.factor(hyper) if model.n_hyper else None
        kept = np.arange(self.n_coefficients)
        if factor is not None and truncated:
            size = np.sqrt(np.sum(factor**2, axis=1))
            large = (size > NEGLIGIBLE * size.max(axis=1, keepdims=True)).any(axis=0)
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

    def _fit(self, u: FloatArray, width_rounds: int = SETTINGS.few_rounds) -> GaussianFit:
        design = self._design(u, truncated=True)
        return gaussian_fit(design, np.exp(u[:, -1:]), width_rounds)
