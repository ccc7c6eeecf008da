"""What follows from a log density alone: expectations and draws of y, by the trapezoid rule."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.integrate import cumulative_trapezoid, trapezoid

from hybridsurrogate.types import FloatArray

_NOTHING = (
    "The density of y is zero around the simulation's output, so nothing can be drawn from it. A "
    "likelihood of whole numbers, or of values far from there, needs its own sample function."
)


def density_on_nodes(
    log_density: Callable[[FloatArray, FloatArray, FloatArray], FloatArray],
    inverse: Callable[[FloatArray], FloatArray],
    eta: FloatArray,
    sigma: FloatArray,
    width: FloatArray | float,
) -> tuple[FloatArray, FloatArray]:
    """Return nodes y (K, ...) for each eta, rising, and the density there.

    The density is scaled so that its integral by the trapezoid rule is one. Nodes are
    ``inverse(eta + width sinh(s))`` with s evenly spaced: the first ones reach a million widths,
    and those that follow lie where all but a millionth of the mass is.

    Parameters
    ----------
    log_density : callable
        Of (y, eta, sigma), element by element.
    inverse : callable
        The noise-free output of eta.
    eta, sigma : ndarray
        Of one shape.
    width : ndarray or float
        A first guess of the scatter on the scale of eta.

    Examples
    --------
    >>> from scipy import stats
    >>> eta, sigma = np.zeros(1), np.ones(1)
    >>> y, density = density_on_nodes(stats.norm.logpdf, lambda x: x, eta, sigma, 1.0)
    >>> trapezoid(y**2 * density, y, axis=0).round(3)
    array([1.])
    """
    share = np.linspace(0, 1, 129).reshape(-1, *(1,) * eta.ndim)
    low, high = np.full(eta.shape, -14.5), np.full(eta.shape, 14.5)
    for _ in range(3):
        at = low + (high - low) * share
        y = inverse(eta + width * np.sinh(at))
        with np.errstate(all="ignore"):
            logs = np.stack([np.asarray(log_density(one, eta, sigma), dtype=float) for one in y])
        logs = np.where(np.isfinite(logs), logs, -np.inf)
        density = np.exp(logs - np.maximum(logs.max(axis=0), np.finfo(float).min))
        below = cumulative_trapezoid(density, y, axis=0, initial=0)
        if not (below[-1] > 0).all():
            raise ValueError(_NOTHING)
        below /= below[-1]
        first = np.argmax(below > 1e-6, axis=0) - 1
        last = np.argmax(below >= 1 - 1e-6, axis=0)
        low, high = (np.take_along_axis(at, k[None], axis=0)[0] for k in (first, last))
    # what is no density, but a probability of whole numbers, is zero between them
    if np.mean(density > 0, axis=0).min() < 0.5:
        raise ValueError(_NOTHING)
    return y, density / trapezoid(density, y, axis=0)


def draw(y: FloatArray, density: FloatArray, uniform: FloatArray) -> FloatArray:
    """Return the quantiles of uniform numbers (...), from nodes and densities (K, ...)."""
    below = cumulative_trapezoid(density, y, axis=0, initial=0)
    after = np.clip((below < uniform).sum(axis=0), 1, len(y) - 1)[None]
    ends = [np.take_along_axis(of, k, axis=0)[0] for of in (below, y) for k in (after - 1, after)]
    share = (uniform - ends[0]) / np.maximum(ends[1] - ends[0], np.finfo(float).tiny)
    return ends[2] + np.clip(share, 0.0, 1.0) * (ends[3] - ends[2])
