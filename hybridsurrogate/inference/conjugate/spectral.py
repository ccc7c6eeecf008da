"""Rows that depend on no unknown: one spectral decomposition serves every noise scale."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

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
    informed = size > 1e-13 * max(size.max(initial=0.0), 1e-300)
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
