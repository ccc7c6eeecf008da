"""Step 1 with the Gaussian coefficients integrated out.

A few unknowns ``u = [z_omega, z_theta, z_hyper, log sigma]`` remain. Given them the coefficients of
surrogate and causes are Gaussian, so their draws are exact and independent (Rasmussen and Williams
2006, section 2.7).

Rows that are fewer than the coefficients enter by their covariance: of each draw j there are
``rows`` (n, p) of the coefficients, ``residual`` (n,) from their prior mean, and one noise
variance. What is known of the coefficients before these rows comes as `FixedRows`, in whose
coordinates they are independent.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from hybridsurrogate.inference.conjugate.factored_rows import (
    FactoredRows,
    posterior_factor,
    whitened,
)
from hybridsurrogate.inference.conjugate.target import PowerScaledPosterior
from hybridsurrogate.model.statistics import Statistics, prior_of_unknowns
from hybridsurrogate.numerics.linear_algebra import (
    BLOCK,
    LARGE_BLOCK,
    NEGLIGIBLE,
    SINGULAR,
    log_det_of,
    nudged_cholesky,
)
from hybridsurrogate.types import FloatArray


@dataclass(frozen=True)
class FixedRows:
    """Rows that do not depend on the unknowns, in coordinates in which they are independent.

    With c = mean + axes @ v the prior of v is standard normal. The rows measure v_k times root of
    ``size_k`` as ``along_k`` with noise variance sigma^2: one spectral decomposition instead of a
    Cholesky factor for every sigma. The axes may be fewer than the coefficients: in the remaining
    directions, which no row informs, the posterior is the prior.
    """

    mean: FloatArray
    sd: FloatArray
    axes: FloatArray
    size: FloatArray
    along: FloatArray
    rest: float
    log_noise: float

    def marginal(self, variance: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """As `CollapsedPosterior._marginal`, for noise variances (J,)."""
        total = variance[:, None] + self.size
        log_det = np.log(total / variance[:, None]).sum(axis=1)
        left = self.rest / variance + (self.along**2 / total).sum(axis=1)
        return log_det, left, np.full(len(variance), self.log_noise)

    def given(self, variance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and sd (J, k) of v for noise variances (J,)."""
        total = variance[:, None] + self.size
        return np.sqrt(self.size) * self.along / total, np.sqrt(variance[:, None] / total)

    def draws(self, variance: FloatArray, noise: FloatArray) -> FloatArray:
        """Return coefficients for noise variances (J,) and standard normal numbers (J, p)."""
        whole = self.axes.shape[0] == self.axes.shape[1]
        projected = noise if whole else noise @ (self.axes / self.sd[:, None])
        centre, sd = self.given(variance)
        v = centre + sd * projected
        if whole:
            return self.mean + v @ self.axes.T
        return self.mean + self.sd * noise + (v - projected) @ self.axes.T


def fixed_rows(gram: FloatArray, mean: FloatArray, sd: FloatArray, log_noise: float) -> FixedRows:
    """Return the rows of a Gram matrix [[G, g], [g', yy]] (p + 1, p + 1)."""
    ff, fy, yy = gram[:-1, :-1], gram[:-1, -1], gram[-1, -1]
    size, vectors = np.linalg.eigh(sd[:, None] * ff * sd)
    axes = sd[:, None] * vectors
    # directions that no row speaks about: their size is rounding
    informed = size > SINGULAR * max(size.max(initial=0.0), 1e-300)
    size = np.where(informed, size, 0.0)
    along = np.where(informed, axes.T @ (fy - ff @ mean), 0.0) / np.sqrt(
        np.where(informed, size, 1.0)
    )
    rest = yy - 2 * mean @ fy + mean @ ff @ mean - along @ along
    return FixedRows(mean, sd, axes, size, along, max(float(rest), 0.0), log_noise)


def few_rows(
    rows: FloatArray, mean: FloatArray, sd: FloatArray, rounding: float, log_noise: float
) -> FixedRows:
    """As `fixed_rows`, from n rows [features, y] that are fewer than the coefficients."""
    left, root, right = np.linalg.svd(rows[:, :-1] * sd, full_matrices=False)
    informed = root > 3e-7 * max(root.max(initial=0.0), 1e-300)
    size = np.where(informed, root**2, 0.0)
    residual = rows[:, -1] - rows[:, :-1] @ mean
    along = np.where(informed, left.T @ residual, 0.0)
    rest = float(residual @ residual - along @ along) + rounding
    return FixedRows(mean, sd, sd[:, None] * right.T, size, along, max(rest, 0.0), log_noise)


class _FewRows(NamedTuple):
    """Rows of coefficients that are ``centre + sd * v`` before them, v standard normal.

    In coordinates of `FixedRows`, for J draws: rows (J, n, r) of v, their residuals (J, n), noise
    variance (J,) and covariance (J, n, n), and the log of the noise factors (J,).
    """

    rows: FloatArray
    residual: FloatArray
    variance: FloatArray
    covariance: FloatArray
    log_noise: FloatArray
    centre: FloatArray
    sd: FloatArray


_LOG_2PI = float(np.log(2 * np.pi))


@dataclass(frozen=True)
class CollapsedPosterior(PowerScaledPosterior):
    """Power-scaled posterior of ``u`` with the coefficients (c, a) integrated out.

    Attributes
    ----------
    simulation : Statistics or None
        Sufficient statistics of the simulation runs.
    """

    simulation: Statistics | None

    is_exact = True

    def run_statistics(self, hyper: FloatArray) -> Statistics | None:
        """Return the statistics of the runs in the features at hyperparameters (n_hyper,)."""
        runs, factor = self.simulation, self.model.basis.factor(hyper[None])
        if runs is None or factor is None:
            return runs
        whitened = factor[0].T @ runs.ff @ factor[0]
        return Statistics(runs.n, whitened, factor[0].T @ runs.fy, runs.yy)

    def resolved(
        self, points: FloatArray, random_state: np.random.RandomState
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return u, c and a of points u, the coefficients drawn."""
        return points, *self.draw_coefficients(points, random_state)

    from_ensemble = resolved

    def to_ensemble(self, points: FloatArray) -> FloatArray:
        """Return the points u themselves."""
        return points

    @cached_property
    def _prior(self) -> tuple[FloatArray, FloatArray]:
        """Mean and precision of (c, a)."""
        basis = self.model.basis
        sd = np.concatenate([basis.coefficient_sd, self.model.column_sd])
        mean = np.concatenate([basis.coefficient_mean, np.zeros(len(self.model.column_sd))])
        return mean, sd**-2.0

    def search_density(self, u: FloatArray) -> FloatArray:
        """Return the log density of u (J, d), up to the constants of the prior of z."""
        out = prior_of_unknowns(u, self.noise_prior)
        # far below the rounding of the data, where a square of sigma would underflow
        possible = np.isfinite(out) & (np.exp(u[:, -1]) > SINGULAR * self.scale)
        out[~possible] = -np.inf
        n_simulation = self.simulation.n if self.simulation else 0
        weight = self.simulation_power * n_simulation + self.measured_power * self.weights.sum()
        # where a cause makes the noise of some rows vanish, their squares are infinite
        with np.errstate(over="ignore", invalid="ignore"):
            log_det, rest, log_noise = self._marginal(u[possible])
            out[possible] += (
                -0.5 * weight * (_LOG_2PI + 2 * u[possible, -1])
                - self.measured_power * log_noise
                - 0.5 * log_det
                - 0.5 * rest
            )
        return np.where(np.isfinite(out), out, -np.inf)

    extended_log_density = joint_log_density = search_density

    def _marginal(self, u: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return log |Lambda| / |Lambda0|, the quadratic form that is left, log of the noise."""
        if self._fixed:
            return self._fixed_rows.marginal(np.exp(2 * u[:, -1]))
        of_block = self._marginal_of_few if self._few else self._marginal_of_many
        pieces = [np.stack(of_block(block)) for block in self._blocks(u)]
        log_det, rest, log_noise = np.concatenate(pieces, axis=1)
        return log_det, rest, log_noise

    def _marginal_of_many(self, u: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        log_prior = 0.0 if self.model.n_hyper else float(np.log(self._prior[1]).sum())
        factor, log_noise = self._augmented_factor(u)
        diagonal = np.diagonal(factor, axis1=1, axis2=2)
        log_det = 2 * np.log(diagonal[:, :-1]).sum(axis=1) - log_prior
        return log_det, diagonal[:, -1] ** 2, log_noise

    @property
    def _fixed(self) -> bool:
        """Whether the noise scale is all that the coefficients' posterior depends on."""
        return not self.model.n_hyper and (not self.measured_power or not self.model.n_unknowns)

    @cached_property
    def _fixed_rows(self) -> FixedRows:
        mean, precision = self._prior
        sd = precision**-0.5
        u = np.zeros((1, self.n_dimensions))
        if self._few and not self._runs.any():
            rows, log_noise = self._measured_rows(u)
            rows = np.sqrt(self.measured_power) * rows[0]
            rounding = self.measured_power * self._rounding
            return few_rows(rows, mean, sd, rounding, float(log_noise[0]))
        gram, log_noise = self._gram(u)
        return fixed_rows(gram[0], mean, sd, float(log_noise[0]))

    @property
    def _few(self) -> bool:
        """Whether measured rows count, and are fewer than the coefficients."""
        if self.model.n_hyper or not self.measured_power:
            return False
        return len(self.y) < len(self._prior[0])

    @cached_property
    def _before(self) -> FixedRows:
        """The coefficients before the measured rows: their prior, and the runs' likelihood."""
        mean, precision = self._prior
        return fixed_rows(self._runs, mean, precision**-0.5, 0.0)

    def _few_rows(self, u: FloatArray) -> _FewRows:
        features, log_noise = self._measured_rows(u)
        features *= np.sqrt(self.measured_power)
        features, y = features[..., :-1], features[..., -1]
        variance = np.exp(2 * u[:, -1])
        centre, sd = self._before.given(variance)
        rows = features @ self._before.axes
        residual = y - features @ self._prior[0] - (rows @ centre[..., None])[..., 0]
        rows *= sd[:, None]
        covariance = rows @ np.swapaxes(rows, 1, 2)
        n = np.arange(rows.shape[1])
        covariance[:, n, n] += variance[:, None]
        return _FewRows(rows, residual, variance, covariance, log_noise, centre, sd)

    def _marginal_of_few(self, u: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """As `_marginal`, by the covariance of the rows instead of that of the coefficients."""
        few = self._few_rows(u)
        factor = nudged_cholesky(few.covariance)
        half = np.linalg.solve(factor, few.residual[..., None])[..., 0]
        log_det, rest, _ = self._before.marginal(few.variance)
        log_det = log_det + 2 * log_det_of(factor) - len(self.y) * np.log(few.variance)
        rest = rest + (half**2).sum(axis=1) + self.measured_power * self._rounding / few.variance
        return log_det, rest, few.log_noise

    def _draws_of_few(self, u: FloatArray, random_state: np.random.RandomState) -> FloatArray:
        """Draw the coefficients (J, p) by conditioning draws from before the rows on them."""
        few = self._few_rows(u)
        noise = random_state.standard_normal(few.rows.shape[::2])
        error = random_state.standard_normal(few.residual.shape)
        error = np.sqrt(few.variance)[:, None] * error
        missing = few.residual - (few.rows @ noise[..., None])[..., 0] - error
        solved = np.linalg.solve(few.covariance, missing[..., None])
        v = noise + (np.swapaxes(few.rows, 1, 2) @ solved)[..., 0]
        return self._before.mean + (few.centre + few.sd * v) @ self._before.axes.T

    @property
    def _rounding(self) -> float:
        return float(self.weights.sum() * (NEGLIGIBLE * self.scale) ** 2)

    def _measured_rows(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return [features, columns, y] of the measured rows at sigma = 1, and the log noise."""
        parts = self.model.parts(self.X, self.model.values(u[:, :-1]))
        log_noise = np.zeros(len(u))
        rows = np.concatenate(
            [parts.features, parts.columns, (self.y - parts.known)[..., None]], axis=2
        )
        if parts.noise.shape[1] > 1:
            rows /= parts.noise[..., None]
            log_noise = np.log(parts.noise) @ self.weights
        if (self.weights != 1).any():
            rows *= np.sqrt(self.weights)[:, None]
        return rows, log_noise

    def _blocks(self, u: FloatArray) -> list[FloatArray]:
        """Cut a batch so that the matrices of one piece fit into memory."""
        size, n = len(self._prior[0]) + 1, len(self.y) if self.measured_power else 0
        length = LARGE_BLOCK // (size * n if self._few else size**2)
        if n:
            # rows of products are not formed for each draw
            formed = size if self._few else size - int(np.count_nonzero(self._factored.products))
            length = min(length, BLOCK // max(formed * n, 1))
        length = max(1, length)
        return [u[k : k + length] for k in range(0, max(len(u), 1), length)]

    @cached_property
    def _factored(self) -> FactoredRows:
        return FactoredRows(self.model, self.X, self.y, np.sqrt(self.weights))

    def _gram(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return [[G, g], [g', yy]] of all rows at sigma = 1, and the log noise factors."""
        size = len(self._prior[0])
        out: FloatArray = np.zeros((len(u), size + 1, size + 1))
        log_noise: FloatArray = np.zeros(len(u))
        if self.measured_power:
            if self._factored.products.any():
                out = self._factored.gram(self.model.values(u[:, :-1]))
            else:
                formed, log_noise = self._measured_rows(u)
                np.matmul(np.swapaxes(formed, 1, 2), formed, out=out)
            out[:, -1, -1] += self._rounding
            out *= self.measured_power
        out += self._runs
        return out, log_noise

    @cached_property
    def _runs(self) -> FloatArray:
        """Gram matrix of [features, columns, y] of the runs, which know no columns, powered."""
        size, p = len(self._prior[0]), len(self.model.basis.coefficient_mean)
        out = np.zeros((size + 1, size + 1))
        if self.simulation is not None:
            index = np.r_[:p, size]
            ff, fy, yy = self.simulation.ff, self.simulation.fy, self.simulation.yy
            gram = np.block([[ff, fy[:, None]], [fy, np.array([yy])]])
            out[np.ix_(index, index)] = self.simulation_power * gram
        return out

    def _augmented_factor(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return `posterior_factor` of all rows, and the log noise factors."""
        mean, precision = self._prior
        gram, log_noise = self._gram(u)
        if self.model.n_hyper:
            # the prior mean is zero in every surrogate that has hyperparameters
            gram = whitened(gram, self._whitening(u))
            mean, precision = np.zeros(gram.shape[1] - 1), np.ones(gram.shape[1] - 1)
        return posterior_factor(gram, np.exp(-2 * u[:, -1]), mean, precision), log_noise

    def _whitening(self, u: FloatArray) -> FloatArray:
        """Return T (J, size, r) with ``(c, a) = T v``, v standard normal."""
        hyper = self.model.values(u[:, :-1])[:, self.model.n_unknowns :]
        factor = self.model.basis.factor(hyper, truncated=True)
        assert factor is not None
        q = len(self.model.column_sd)
        if not q:
            return factor
        J, p, r = factor.shape
        out = np.zeros((J, p + q, r + q))
        out[:, :p, :r] = factor
        out[:, p:, r:] = np.diag(self.model.column_sd)
        return out

    def draw_coefficients(
        self, u: FloatArray, random_state: np.random.RandomState
    ) -> tuple[FloatArray, FloatArray]:
        """Draw (c, a) for each u (J, d): arrays of shape (J, p) and (J, q)."""
        p = len(self.model.basis.coefficient_mean)
        if self._few and not self._fixed:
            blocks = self._blocks(u)
            draws = np.concatenate([self._draws_of_few(block, random_state) for block in blocks])
            return draws[:, :p], draws[:, p:]
        noise = random_state.standard_normal((len(u), len(self._prior[0])))
        if not noise.size:
            return noise, noise
        if self._fixed:
            draws = self._fixed_rows.draws(np.exp(2 * u[:, -1]), noise)
            return draws[:, :p], draws[:, p:]
        pieces: list[FloatArray] = []
        for block in self._blocks(u):
            factor, _ = self._augmented_factor(block)
            first = sum(len(piece) for piece in pieces)
            size = factor.shape[1] - 1
            right = factor[:, -1, :-1] + noise[first : first + len(block), :size]
            transposed = np.swapaxes(factor[:, :-1, :-1], 1, 2)
            drawn = np.linalg.solve(transposed, right[..., None])
            if self.model.n_hyper:
                drawn = self._whitening(block) @ drawn
            pieces.append(drawn[..., 0])
        draws = np.concatenate(pieces)
        return draws[:, :p], draws[:, p:]
