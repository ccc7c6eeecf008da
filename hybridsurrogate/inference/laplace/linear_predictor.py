"""Rows that are linear in the coefficients, for a batch of draws of everything else."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.likelihoods.base import Likelihood
from hybridsurrogate.model.rows.observed import ObservedRows
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
