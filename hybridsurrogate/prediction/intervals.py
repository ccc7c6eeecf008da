"""Central intervals of a mixture of posteriors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import special

from hybridsurrogate.likelihoods import TransformedNormal
from hybridsurrogate.numerics.blocks import blocks
from hybridsurrogate.prediction.mixture import Mixture, MixtureAt, noisy, row_blocks, samples
from hybridsurrogate.types import FloatArray

# draws of y behind the quantiles of a likelihood that is not normal
_N_DRAWS = 20_000
# rows at a time, so that memory stays bounded
_N_ROWS = 500
# brackets as narrow, in units of what holds all draws, end a search; and steps at most
_TINY, _MOST_STEPS = 1e-9, 60
# a step of a share h of the narrowest sd leaves an error of about h^3 of it: the next is needless
_LAST_STEP = 1e-3

# on the scale of eta: weight, centres (S, n) and standard deviations (S, n)
Normals = list[tuple[Any, FloatArray, FloatArray]]


def central_interval(
    mixture_at: MixtureAt, X: FloatArray, level: float
) -> tuple[FloatArray, FloatArray]:
    """Return the ends of an interval for a new y at each row, two arrays (n,)."""
    likelihood = _normal_likelihood(mixture_at(X[:1]))
    tail = (1 - level) / 2
    if likelihood is None:
        random = np.random.RandomState(0)
        ends = []
        for k in range(0, len(X), _N_ROWS):
            draws = samples(mixture_at, X[k : k + _N_ROWS], _N_DRAWS, random, noisy)
            ends.append(np.quantile(draws, [tail, 1 - tail], axis=0, method="inverted_cdf"))
        lower, upper = np.concatenate(ends, axis=1)
        return lower, upper
    quantiles: list[list[FloatArray]] = []
    for some in row_blocks(mixture_at, X):
        parts = _normals(mixture_at(X[some]), X[some])
        n_draws = sum(len(centre) for _, centre, _ in parts)
        for few in blocks(some.stop - some.start, n_draws):
            # copied into one piece: rows of draws that lie far apart are slow to read again
            piece = [(w, c.copy(), s.copy()) for w, c, s in _at_rows(parts, few)]
            quantiles.append([_quantile(piece, probability) for probability in (tail, 1 - tail)])
    lower, upper = np.concatenate(quantiles, axis=1)
    return likelihood.inverse(lower), likelihood.inverse(upper)


def inside_intervals(
    mixture_at: MixtureAt, X: FloatArray, y: FloatArray, levels: Sequence[float]
) -> list[FloatArray]:
    """Return whether each row lies in the central interval of each level, as 0 and 1."""
    likelihood = _normal_likelihood(mixture_at(X[:1]))
    if likelihood is not None:
        # one look at the distribution function instead of many for each quantile
        below = [
            _below(_normals(mixture_at(X[some]), X[some]), likelihood.working(y[some]))
            for some in row_blocks(mixture_at, X)
        ]
        off = np.abs(np.concatenate(below) - 0.5)
        return [(off <= level / 2).astype(float) for level in levels]
    ends = [central_interval(mixture_at, X, level) for level in levels]
    return [((y >= lower) & (y <= upper)).astype(float) for lower, upper in ends]


def _normal_likelihood(mixture: Mixture) -> TransformedNormal | None:
    """Return the likelihood where it is normal in all parts: some may have outliers."""
    likelihoods = [posterior.likelihood for _, posterior in mixture]
    first = likelihoods[0]
    everywhere = all(isinstance(each, TransformedNormal) for each in likelihoods)
    return first if isinstance(first, TransformedNormal) and everywhere else None


def _normals(mixture: Mixture, X: FloatArray) -> Normals:
    return [(weight, *posterior.eta(X)) for weight, posterior in mixture]


def _at_rows(parts: Normals, rows: slice | NDArray[np.intp]) -> Normals:
    return [
        (weight[rows] if np.ndim(weight) else weight, centre[:, rows], sigma[:, rows])
        for weight, centre, sigma in parts
    ]


def _quantile(parts: Normals, probability: float) -> FloatArray:
    """Return the quantile (n,) on the scale of eta, by Halley steps that bisection safeguards.

    With F, f and f' of the mixture a step is -r / (1 - r f' / (2 f)), r = (F - probability) / f.
    """
    narrowest = np.min([sigma.min(axis=0) for _, _, sigma in parts], axis=0)
    reach = 9 * np.max([sigma.max(axis=0) for _, _, sigma in parts], axis=0)
    low = np.min([centre.min(axis=0) for _, centre, _ in parts], axis=0) - reach
    high = np.max([centre.max(axis=0) for _, centre, _ in parts], axis=0) + reach
    tiny = _TINY * (high - low)
    mean = _average(parts, lambda centre, _: centre)
    variance = _average(parts, lambda centre, sigma: (centre - mean) ** 2 + sigma**2)
    # the quantile of a normal with the same moments
    middle = np.clip(mean + special.ndtri(probability) * np.sqrt(variance), low, high)
    # rows without a prediction have NaN, and no search
    left = np.flatnonzero(np.isfinite(middle))
    for _ in range(_MOST_STEPS):
        if not len(left):
            break
        at = middle[left]
        some = parts if len(left) == len(middle) else _at_rows(parts, left)
        below, density, slope = _distribution(some, at)
        off = below - probability
        low[left] = np.where(off < 0, at, low[left])
        high[left] = np.where(off < 0, high[left], at)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            newton = off / density
            curved = 0.5 * newton * slope / density
            moved = at - newton / (1 - curved)
        # in a far tail steps are short, and hundreds of them: there bisection is faster
        inside = (np.abs(curved) < 0.5) & (low[left] < moved) & (moved < high[left])
        moved = np.where(inside, moved, 0.5 * (low[left] + high[left]))
        small = inside & (np.abs(moved - at) <= np.maximum(_LAST_STEP * narrowest, tiny)[left])
        middle[left] = np.where(off == 0, at, moved)
        left = left[~(small | (off == 0) | (high[left] - low[left] <= tiny[left]))]
    return middle


def _distribution(parts: Normals, eta: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return distribution function, density and its slope of a mixture of normals at eta (n,)."""
    total = np.zeros((3, len(eta)))
    for weight, centre, sigma in parts:
        scaled = (eta - centre) / sigma
        heights = np.exp(-0.5 * scaled**2) / sigma
        slopes = -np.einsum("sn,sn->n", heights, scaled / sigma) / len(centre)
        total += weight * np.stack(
            [
                special.ndtr(scaled).mean(axis=0),
                heights.mean(axis=0) / np.sqrt(2 * np.pi),
                slopes / np.sqrt(2 * np.pi),
            ]
        )
    below, density, slope = total
    return below, density, slope


def _below(parts: Normals, eta: FloatArray) -> FloatArray:
    """Return the probability of a mixture of normals below eta (n,)."""
    return _average(parts, lambda centre, sigma: special.ndtr((eta - centre) / sigma))


def _average(parts: Normals, value: Callable[[FloatArray, FloatArray], FloatArray]) -> FloatArray:
    """Return the average (n,) over draws of a function of centres and standard deviations."""
    terms = [weight * value(centre, sigma).mean(axis=0) for weight, centre, sigma in parts]
    return np.sum(terms, axis=0)
