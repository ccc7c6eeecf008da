"""A smooth process as a sum of few waves: the Hilbert-space basis of a Gaussian process.

Solin and Sarkka 2020, Statistics and Computing 30:419, equations 56 and 20: sines that are zero at
a boundary, with independent coefficients whose variances are the spectral density of a
squared-exponential kernel. Cosines need no room beyond the range.
"""

from __future__ import annotations

import numpy as np

from hybridsurrogate.types import FloatArray

# half the width on which the waves live, for inputs scaled to [-1, 1]
BOUNDARY = 1.5


def waves(scaled: FloatArray, n: int) -> FloatArray:
    """Return n waves at places (m,) of an input scaled to [-1, 1], (m, n).

    Beyond the boundary, where the waves would come back, they stay at its edge.
    """
    root = np.pi * np.arange(1, n + 1) / (2 * BOUNDARY)
    scaled = np.clip(scaled, -BOUNDARY, BOUNDARY)
    return np.asarray(np.sin(root * (scaled[:, None] + BOUNDARY)) / np.sqrt(BOUNDARY))


def heights(length_scale: FloatArray, n: int) -> FloatArray:
    """Return the standard deviations of n coefficients for length scales (J,), (J, n)."""
    root = np.pi * np.arange(1, n + 1) / (2 * BOUNDARY)
    length = np.reshape(length_scale, (-1, 1))
    return np.asarray(np.sqrt(np.sqrt(2 * np.pi) * length * np.exp(-0.5 * (length * root) ** 2)))


def cosines(scaled: FloatArray, n: int) -> FloatArray:
    """Return n cosines at places (m,) of an input scaled to [-1, 1], (m, n).

    They are orthonormal there, of mean zero and flat at the ends, and stay beyond as at the ends.
    """
    root = np.pi / 2 * np.arange(1, n + 1)
    return np.asarray(np.cos(root * (np.clip(scaled, -1, 1)[:, None] + 1)))
