"""Where all causes are linearised: rows, parameters and noise of data without a cause."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hybridsurrogate.diagnosis.search.context import Fitted, SearchContext
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.inference.evidence.linearised import Linearised
from hybridsurrogate.types import FloatArray


class Place(NamedTuple):
    """Rows in which nothing is wrong, to first order around their fit.

    Attributes
    ----------
    context : SearchContext
    null : Fitted
        "Nothing is wrong" at its best.
    parts : Linearised
        Of it.
    noise : ndarray of shape (n,)
        Standard deviation of each row, on the scale of eta.
    causes : tuple of Cause
        All that a search compares with each other, but for outliers, which have no closed form, and
        what looks only at unusual rows (`Cause.is_screened`).
    """

    context: SearchContext
    null: Fitted
    parts: Linearised
    noise: FloatArray
    causes: tuple[Cause, ...]

    @classmethod
    def of(
        cls,
        context: SearchContext,
        null: Fitted,
        causes: Sequence[Cause],
        noise: FloatArray | None = None,
    ) -> Place:
        """Return the place of a fit; ``noise`` (n,) None: as large as that of the fit."""
        parts = context.linearise(null)
        if noise is None:
            factor = np.ones(1) if parts.noise is None else parts.noise[0]
            noise = np.broadcast_to(null.sigma * factor, parts.mean[0].shape)
        compared = tuple(c for c in causes if not (c.is_screened or "outliers" in c.acts_on))
        return cls(context, null, parts, noise, compared)

    @property
    def output(self) -> FloatArray:
        """The rows without noise, (n,), at the fit."""
        return output_of(self.parts, self.null.mode.z[self.null.grid.fixed])[0]

    def left_of(self, curves: FloatArray) -> FloatArray:
        """Return what the parameters cannot follow of curves (k, n), in noise sd, (k, n)."""
        whitened = self.parts.G[0] / self.noise[:, None]
        # directions that move no row, by the rule of `numpy.linalg.matrix_rank`
        basis, size, _ = np.linalg.svd(whitened, full_matrices=False)
        least = len(whitened) * np.finfo(float).eps * np.max(size, initial=0.0)
        basis = basis[:, size > least]
        scaled = curves / self.noise
        return np.asarray(scaled - (scaled @ basis) @ basis.T)

    def responses(
        self, curves: FloatArray, factors: FloatArray, random: np.random.RandomState
    ) -> FloatArray:
        """Draw measured rows (k, n) with curves added and the noise times factors, both (k, n).

        What an emulator leaves open is drawn, too.
        """
        U, point = self.parts.U, self.context.problem.working_point
        eta = self.output + curves + random.standard_normal((len(curves), U.shape[1])) @ U.T
        if point is not None:
            return point.replicates(eta, random)
        return eta + self.noise * factors * random.standard_normal(eta.shape)


def output_of(parts: Linearised, z: FloatArray) -> FloatArray:
    """Return the rows without noise (M, n) at fixed directions z (d,), all sizes neutral."""
    return np.asarray(parts.mean + parts.G[:, :, : len(z)] @ z)
