"""Frozen scipy.stats priors, and the map between them and standard normal space.

Samplers and optimisers work on ``z`` with ``value = ppf(Phi(z))``: whatever the prior is, ``z`` is
standard normal, so no Jacobian is needed and a bounded parameter has no walls.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special, stats

from hybridsurrogate.arguments import as_real, check_mapping, described
from hybridsurrogate.types import FloatArray, Prior

# Phi(8) is the last step before 1 in double precision
Z_LIMIT = 8.0
# nodes of what is tabulated once and interpolated
N_TABLE = 2001
_STEP = 2 * Z_LIMIT / (N_TABLE - 1)


def truncated_normal(mean: float, sd: float, low: float, high: float) -> Prior:
    """Return a normal prior cut off at two bounds, in the units of the parameter.

    Parameters
    ----------
    mean, sd : float
        Mean and standard deviation before truncation.
    low, high : float
        Bounds of the support.

    Returns
    -------
    scipy.stats frozen distribution

    Raises
    ------
    ValueError
        For NaN; if ``sd`` is not positive, ``low`` is not below ``high``, or both lie more than
        8 ``sd`` to one side of ``mean``.
    TypeError
        For an argument that is not a number.

    Examples
    --------
    >>> import hybridsurrogate as hs
    >>> [float(end) for end in hs.truncated_normal(2.0, 0.5, 1, 3).support()]
    [1.0, 3.0]
    """
    for name, value in {"mean": mean, "sd": sd}.items():
        as_real(value, name)
    for name, value in {"low": low, "high": high}.items():
        as_real(value, name, finite=False)
    if not sd > 0:
        raise ValueError(f"sd must be positive, got {sd!r}.")
    if not low < high:
        raise ValueError(f"low must be below high, got low={low!r} and high={high!r}.")
    lower, upper = (low - mean) / sd, (high - mean) / sd
    if not max(lower, -upper) <= Z_LIMIT:
        raise ValueError(
            f"A normal({mean}, {sd}) has no mass between {low} and {high}: move the bounds."
        )
    return stats.truncnorm(lower, upper, loc=mean, scale=sd)


@lru_cache(maxsize=1024)
def frozen(family: Any, *shapes: float, loc: float = 0.0, scale: float = 1.0) -> Prior:
    """Return a frozen scipy.stats distribution, the same object for the same numbers.

    scipy takes half a millisecond to make one, and a search over the catalogue needs a hundred.
    """
    if loc == 0 and scale == 1:
        return family(*shapes)
    prior = copy(frozen(family, *shapes))
    prior.kwds = {"loc": loc, "scale": scale}
    return prior


def check_prior(prior: Prior, name: str) -> Prior:
    """Return ``prior`` if it is a frozen continuous distribution, else raise TypeError.

    Raises ValueError where its numbers are such that it has no quantiles.
    """
    words = ("logpdf", "cdf", "ppf", "support")
    unfrozen = isinstance(prior, stats.rv_continuous)
    if unfrozen or not all(callable(getattr(prior, word, None)) for word in words):
        raise TypeError(
            f"The prior of {name!r} must be a frozen scipy.stats distribution such as "
            f"scipy.stats.norm(0, 1) or hybridsurrogate.truncated_normal(0, 1, -2, 2), "
            f"got {described(prior)}."
        )
    # scipy.stats answers numbers that make no distribution, as a scale of -1, by NaN
    with np.errstate(all="ignore"):
        median = float(prior.ppf(0.5))
    if not np.isfinite(median):
        raise ValueError(
            f"The prior of {name!r} has no finite median: check its numbers, such as a scale that "
            "is not positive, or NaN."
        )
    return prior


def check_priors(priors: Mapping[str, Prior] | None, name: str = "parameters") -> dict[str, Prior]:
    """Check a mapping from names to priors and return it as a dict."""
    example = '{"rate": scipy.stats.norm(1, 0.2)}'
    given = check_mapping(priors, name, "prior", example)
    return {str(one): check_prior(prior, str(one)) for one, prior in given.items()}


def prior_range(prior: Prior, tail: float = 1e-3) -> tuple[float, float]:
    """Return the support of a prior, with an infinite end replaced by a quantile."""
    low, high = (float(end) for end in prior.support())
    return (
        low if np.isfinite(low) else float(prior.ppf(tail)),
        high if np.isfinite(high) else float(prior.isf(tail)),
    )


def period_range(prior: Prior, tail: float = 1e-3) -> tuple[float, float]:
    """Return the shortest and the longest period of a prior: its positive support.

    An end at zero or infinity is replaced by a quantile.

    Raises
    ------
    ValueError
        For a prior of which more than ``tail`` is not positive.
    """
    low, high = prior_range(prior, tail)
    low = low if low > 0 else float(prior.ppf(tail))
    if low <= 0:
        raise ValueError(
            f"A period is positive, but its prior begins at {low:g}: use one such as "
            "scipy.stats.loguniform(shortest, longest)."
        )
    return low, high


@lru_cache(maxsize=1024)
def prior_sd(prior: Prior) -> float:
    """Return the standard deviation of a prior, which scipy may have to integrate.

    Half of the central 68 % where tails are too heavy for one.
    """
    with np.errstate(all="ignore"):
        sd = float(prior.std())
    low, high = prior.ppf([0.16, 0.84])
    return sd if np.isfinite(sd) else float(high - low) / 2


def from_normal(priors: Sequence[Prior], z: ArrayLike) -> FloatArray:
    """Map standard normal coordinates to values with the given priors.

    Parameters
    ----------
    priors : sequence of k frozen distributions
    z : array of shape (..., k)

    Returns
    -------
    ndarray of shape (..., k)
    """
    points: FloatArray = np.asarray(z, dtype=float)
    if not len(priors):
        return np.empty_like(points)
    # ppf(Phi(z)) by cubic Hermite interpolation: between -3 and 3 the relative error is about 1e-8
    # or less for a prior over up to six decades, and 2e-7 for a log-uniform one over twelve.
    # scipy's quantile functions cost up to a millisecond a call whatever the size of the array;
    # samplers and searches make thousands of small calls
    cubics, first, low, high = _quantile_tables(tuple(priors))
    position = np.minimum(np.maximum((points + Z_LIMIT) / _STEP, 0.0), N_TABLE - 1.0)
    # NaN marks what failed and stays NaN: it may point anywhere
    left_node = np.fmin(position, N_TABLE - 2.0).astype(np.intp)
    t = position - left_node
    a, b, c, d = cubics[:, left_node + first]
    return np.minimum(np.maximum(((d * t + c) * t + b) * t + a, low), high)


@lru_cache(maxsize=1024)
def _quantile_tables(
    priors: tuple[Prior, ...],
) -> tuple[FloatArray, NDArray[np.intp], FloatArray, FloatArray]:
    """Return the cubics (4, n) of several priors, where each one's begin, and their supports."""
    values, slope = np.empty((2, len(priors), N_TABLE))
    for k, prior in enumerate(priors):
        family, shapes, loc, scale = _family_of(prior) or (prior, (), 0.0, 1.0)
        value, own = _tabulated(family, shapes)
        values[k], slope[k] = loc + scale * value, _STEP * (scale * own)
    low, high = np.transpose([prior.support() for prior in priors]).astype(float)
    rise, left, right = np.diff(values), slope[:, :-1], slope[:, 1:]
    cubics = np.stack(
        [values[:, :-1], left, 3 * rise - 2 * left - right, left + right - 2 * rise]
    ).reshape(4, -1)
    first = (N_TABLE - 1) * np.arange(len(priors))
    return cubics, first, low, high


@lru_cache(maxsize=1024)
def _tabulated(family: Any, shapes: tuple[float, ...]) -> tuple[FloatArray, FloatArray]:
    """Return quantiles at even steps of z, and their slopes."""
    z = np.linspace(-Z_LIMIT, Z_LIMIT, N_TABLE)
    # the upper half from the survival function: Phi(z) loses its digits near 1
    lower, upper = special.ndtr(z[z <= 0]), special.ndtr(-z[z > 0])
    # each quantile once: without a formula for it scipy takes a millisecond or more
    values = np.concatenate([family.ppf(lower, *shapes), family.isf(upper, *shapes)])
    with np.errstate(all="ignore"):
        slopes = np.exp(-0.5 * z**2) / np.sqrt(2 * np.pi) / family.pdf(values, *shapes)
    return values, np.where(np.isfinite(slopes), slopes, np.gradient(values, z))


def _family_of(prior: Prior) -> tuple[Any, tuple[float, ...], float, float] | None:
    """Return a scipy.stats family, its shapes, loc and scale; None for what is not one of them.

    Priors over the same rows differ in loc and scale, and their tables cost a millisecond.
    """
    if not hasattr(prior, "dist"):
        return None
    family = prior.dist
    scipys = getattr(stats, family.name, None)
    # a class of the user's own may have a name of scipy's, and more in it than its shapes
    if scipys is None or family.__class__ is not scipys.__class__:
        return None
    names = [*(scipys.shapes or "").replace(",", " ").split(), "loc", "scale"]
    given = {"loc": 0.0, "scale": 1.0, **dict(zip(names, prior.args, strict=False)), **prior.kwds}
    if not all(np.ndim(value) == 0 for value in given.values()):
        return None
    *shapes, loc, scale = (float(given[name]) for name in names)
    return scipys, tuple(shapes), loc, scale


def to_normal(priors: Sequence[Prior], values: ArrayLike) -> FloatArray:
    """Map values with the given priors to standard normal coordinates, shape (..., k)."""
    points: FloatArray = np.asarray(values, dtype=float)
    out = np.empty_like(points)
    for k, prior in enumerate(priors):
        lower, upper = prior.cdf(points[..., k]), prior.sf(points[..., k])
        z = np.where(lower < 0.5, special.ndtri(lower), -special.ndtri(upper))
        out[..., k] = np.clip(z, -Z_LIMIT, Z_LIMIT)
    return out
