"""Log densities averaged over a normal kernel, which smooths kinks and heavy tails.

A Gaussian approximation of a posterior is best where log density and derivatives are averaged over
the approximation itself (Opper and Archambeau 2009, Neural Computation 21:786).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hybridsurrogate.types import FloatArray

_NODE, _WEIGHT = np.polynomial.hermite_e.hermegauss(9)
_WEIGHT = _WEIGHT / _WEIGHT.sum()


def smoothed_moments(
    log_density: Callable[[FloatArray, FloatArray, FloatArray], FloatArray],
    y: FloatArray,
    eta: FloatArray,
    sigma: FloatArray,
    width: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return value, slope and curvature of the smoothed log density, by Stein's identities.

    With e standard normal and h the width, the slope is ``E[e log p(eta + h e)] / h`` and the
    curvature ``-E[(e^2 - 1) log p(eta + h e)] / h^2``: no derivatives of the density are needed.

    Parameters
    ----------
    log_density : callable
        Of (y, eta, sigma).
    y : ndarray of shape (n,)
    eta : ndarray of shape (J, n)
    sigma : ndarray of shape (J, 1) or (J, n)
    width : ndarray that broadcasts to eta
    """
    middle = log_density(y, eta, sigma)
    value, gradient, curvature = (np.zeros(eta.shape) for _ in range(3))
    with np.errstate(invalid="ignore"):
        for node, weight in zip(_NODE, _WEIGHT, strict=True):
            # differences from the middle: narrow kernels would drown in rounding
            excess = log_density(y, eta + width * node, sigma) - middle
            value += weight * excess
            gradient += weight * node * excess
            curvature -= weight * (node**2 - 1) * excess
        return middle + value, gradient / width, curvature / width**2


def positive(curvature: FloatArray, gradient: FloatArray) -> FloatArray:
    """Return the curvature where it is positive, else a small stand-in that keeps steps short."""
    stand_in = 0.1 * gradient**2 + 1e-12
    with np.errstate(invalid="ignore"):
        return np.where(curvature > 1e-3 * stand_in, curvature, stand_in)
