"""Sufficient statistics of rows: all that a conditionally Gaussian fit needs of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hybridsurrogate.priors import FloatArray

# a fit can be exact to the last digit (a polynomial fitted to a polynomial): this share of the
# output's spread stands for the rounding of the numbers and keeps sigma away from zero
ROUNDING = 1e-6


@dataclass(frozen=True)
class Statistics:
    """Sufficient statistics of rows ``y = features @ c + noise``: all that a fit needs of them."""

    n: float
    ff: FloatArray
    fy: FloatArray
    yy: float


def statistics(
    features: FloatArray, y: FloatArray, scale: float, weights: FloatArray | None = None
) -> Statistics:
    """Return the sufficient statistics of n rows with features (n, p) and weights (n,)."""
    n = float(len(y))
    if weights is not None:
        n = float(weights.sum())
        features, y = features * np.sqrt(weights)[:, None], y * np.sqrt(weights)
    rounding = n * (ROUNDING * scale) ** 2
    return Statistics(n, features.T @ features, features.T @ y, float(y @ y) + rounding)
