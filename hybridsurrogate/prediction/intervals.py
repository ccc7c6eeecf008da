"""Central intervals of a mixture of posteriors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy import special

from hybridsurrogate.likelihoods import TransformedNormal
from hybridsurrogate.prediction.mixture import Mixture, MixtureAt, noisy, row_blocks, samples
from hybridsurrogate.priors import FloatArray

# draws of y behind the quantiles of a likelihood that is not normal
_N_DRAWS = 20_000
# rows at a time, so that memory stays bounded
_N_ROWS = 500
# Newton steps as small, in units of what holds all draws, are the last; and steps at most
_TINY, _MOST_STEPS = 1e-9, 60

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
        quantiles.append([_quantile(parts, probability) for probability in (tail, 1 - tail)])
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


def _quantile(parts: Normals, probability: float) -> FloatArray:
    """Return the quantile (n,) on the scale of eta, by Newton steps that bisection safeguards."""
    reach = 9 * np.concatenate([sigma for _, _, sigma in parts]).max(axis=0)
    low = np.concatenate([eta for _, eta, _ in parts]).min(axis=0) - reach
    high = np.concatenate([eta for _, eta, _ in parts]).max(axis=0) + reach
    tiny = _TINY * (high - low)
    mean = _average(parts, lambda centre, _: centre)
    variance = _average(parts, lambda centre, sigma: (centre - mean) ** 2 + sigma**2)
    # the quantile of a normal with the same moments
    middle = np.clip(mean + special.ndtri(probability) * np.sqrt(variance), low, high)
    for _ in range(_MOST_STEPS):
        off = _below(parts, middle) - probability
        low, high = np.where(off < 0, middle, low), np.where(off < 0, high, middle)
        with np.errstate(divide="ignore", invalid="ignore"):
            step = middle - off / _density(parts, middle)
        inside = (low < step) & (step < high)
        moved = np.where(inside, step, 0.5 * (low + high))
        settled = np.abs(moved - middle) <= tiny
        middle = moved
        if settled.all():
            break
    return middle


def _density(parts: Normals, eta: FloatArray) -> FloatArray:
    """Return the density of a mixture of normals at eta (n,)."""
    heights = _average(parts, lambda c, sigma: np.exp(-0.5 * ((eta - c) / sigma) ** 2) / sigma)
    return heights / np.sqrt(2 * np.pi)


def _below(parts: Normals, eta: FloatArray) -> FloatArray:
    """Return the probability of a mixture of normals below eta (n,)."""
    return _average(parts, lambda centre, sigma: special.ndtr((eta - centre) / sigma))


def _average(parts: Normals, value: Callable[[FloatArray, FloatArray], FloatArray]) -> FloatArray:
    """Return the average (n,) over draws of a function of centres and standard deviations."""
    terms = [weight * value(centre, sigma).mean(axis=0) for weight, centre, sigma in parts]
    return np.sum(terms, axis=0)
