"""The density of standardised residuals of which some are outliers, tabulated for many of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from hybridsurrogate.likelihoods.contaminated import log_shape, precision_at
from hybridsurrogate.types import FloatArray

# nodes of log(1 + |z|), up to where numbers end
_N_NODES, _FARTHEST = 3000, 1e6
# below so many residuals a table costs more than it saves
_WORTH = 20_000
_DZ = 1e-4


@dataclass(frozen=True)
class Shape:
    """Log density, precision and curvature of standardised residuals (..., T, n) at T shares.

    Attributes
    ----------
    share : ndarray of shape (T, 1)
    table : ndarray of shape (3, T, n_nodes) or None
        None: everything is computed as it is.
    """

    share: FloatArray
    table: FloatArray | None = None

    @property
    def n_shares(self) -> int:
        """Number of shares, T."""
        return len(self.share)

    def log_density(self, z: FloatArray) -> FloatArray:
        """Return the log density."""
        return log_shape(z, self.share) if self.table is None else _read(self.table[0], z)

    def precision(self, z: FloatArray) -> FloatArray:
        """Return the mean precision given the residual."""
        return precision_at(z, self.share) if self.table is None else _read(self.table[1], z)

    def curvature(self, z: FloatArray) -> FloatArray:
        """Return minus the second derivative of the log density."""
        return _curvature(z, self.share) if self.table is None else _read(self.table[2], z)


def shape_of(share: FloatArray, n_residuals: int) -> Shape:
    """Return the shape at shares (T,), by a table where it is read often enough."""
    if n_residuals * len(share) < _WORTH:
        return Shape(share[:, None])
    return Shape(share[:, None], _tabulated(tuple(float(value) for value in share)))


def _curvature(z: FloatArray, share: FloatArray) -> FloatArray:
    upper, lower = ((z + d) * precision_at(z + d, share) for d in (_DZ, -_DZ))
    return (upper - lower) / (2 * _DZ)


@lru_cache(maxsize=16)
def _tabulated(shares: tuple[float, ...]) -> FloatArray:
    z = np.expm1(np.linspace(0, np.log1p(_FARTHEST), _N_NODES))
    share = np.array(shares)[:, None]
    return np.stack([log_shape(z, share), precision_at(z, share), _curvature(z, share)])


def _read(table: FloatArray, z: FloatArray) -> FloatArray:
    """Interpolate the rows of a table (T, n_nodes) at z (..., T, n)."""
    position = np.log1p(np.abs(z)) * ((_N_NODES - 1) / np.log1p(_FARTHEST))
    index = np.minimum(position, _N_NODES - 2).astype(np.intp)
    position -= index
    index = index + (np.arange(len(table)) * _N_NODES)[:, None]
    flat = table.ravel()
    low = flat[index]
    return low + position * (flat[index + 1] - low)
