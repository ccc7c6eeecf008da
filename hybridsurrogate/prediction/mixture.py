"""Predictions of a mixture of posteriors: moments, densities, draws and central intervals."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from numbers import Integral
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import special
from sklearn.utils import check_scalar

from hybridsurrogate.exceptions import SamplingWarning
from hybridsurrogate.likelihoods import TransformedNormal
from hybridsurrogate.model.posterior import SOME_DRAWS, Posterior
from hybridsurrogate.numerics.linear_algebra import LARGE_BLOCK, SINGULAR, blocks
from hybridsurrogate.types import FloatArray

# draws of y behind the quantiles of a likelihood that is not normal
_N_DRAWS = 20_000
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
        for some in blocks(len(X), _N_DRAWS, LARGE_BLOCK):
            draws = samples(mixture_at, X[some], _N_DRAWS, random, noisy)
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
    # what is recorded at a limit stands for all beyond it
    side = mixture_at(X[:1])[0][1].likelihood.side(y)
    return [
        (((y >= lower) | (side > 0)) & ((y <= upper) | (side < 0))).astype(float)
        for lower, upper in ends
    ]


def _normal_likelihood(mixture: Mixture) -> TransformedNormal | None:
    """Return the likelihood where it is normal in all parts: some may have outliers."""
    normal = [p.likelihood for _, p in mixture if isinstance(p.likelihood, TransformedNormal)]
    return normal[0] if len(normal) == len(mixture) else None


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
    # a bracket this narrow is rounding
    tiny = SINGULAR * (high - low) + 2 * np.spacing(np.maximum(np.abs(low), np.abs(high)))
    mean = _average(parts, lambda centre, _: centre)
    variance = _average(parts, lambda centre, sigma: (centre - mean) ** 2 + sigma**2)
    # the quantile of a normal with the same moments
    middle = np.clip(mean + special.ndtri(probability) * np.sqrt(variance), low, high)
    # rows without a prediction have NaN, and no search
    left = np.flatnonzero(np.isfinite(middle))
    while len(left):
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


# posteriors with their weights: numbers, or arrays (n,) that change with the row
Mixture = list[tuple[Any, Posterior]]
MixtureAt = Callable[..., Mixture]
Draw = Callable[[Posterior, FloatArray, np.random.RandomState], FloatArray]
# of some positive means none carries so large a share, unless their distribution has no mean: of
# 200 log-normal ones with a standard deviation of 1.5 in logarithms in one of twelve cases
_HEAVY = 0.2


def row_blocks(mixture_at: MixtureAt, X: FloatArray) -> list[slice]:
    """Cut rows X (n, n_columns) into blocks, so that memory for all draws of them is bounded."""
    mixture = mixture_at(X[:1])
    cuts = blocks(len(X), sum(posterior.n_draws for _, posterior in mixture), LARGE_BLOCK)
    return mixture[0][1].model.whole(cuts, X)


def moments(mixture: Mixture, X: FloatArray, with_variance: bool) -> list[NDArray[Any]]:
    """Return mean, whether one draw carries it, and perhaps variance of y at rows X: arrays (n,).

    Noise included, by the law of total variance around the mean, so that a large offset costs no
    digits.
    """
    parts = [(weight, p, *p.eta(X)) for weight, p in mixture]
    means = [p.likelihood.mean(eta, sigma) for _, p, eta, sigma in parts]
    mean = np.sum([w * m.mean(axis=0) for (w, *_), m in zip(parts, means, strict=True)], axis=0)
    if not with_variance:
        return [mean, _carried(means)]
    # far outside the data a log-normal variance is infinite for practical purposes
    with np.errstate(over="ignore"):
        variance = np.sum(
            [
                w * (p.likelihood.variance(eta, sigma) + (m - mean) ** 2).mean(axis=0)
                for (w, p, eta, sigma), m in zip(parts, means, strict=True)
            ],
            axis=0,
        )
    return [mean, _carried(means), variance]


def _carried(means: list[FloatArray]) -> NDArray[np.bool_]:
    """Return at which rows one draw is much of a mean: that of an exponential may be infinite."""
    with np.errstate(invalid="ignore"):  # rows without a prediction
        each = [
            (np.min(m, axis=0) >= 0)
            & ((np.max(m, axis=0) > _HEAVY * np.sum(m, axis=0)) | np.isinf(np.max(m, axis=0)))
            for m in means
            if len(m) >= SOME_DRAWS
        ]
    return np.any(each, axis=0) if each else np.zeros(means[0].shape[1], dtype=bool)


def warn_of_carried(carried: NDArray[np.bool_]) -> None:
    """Warn of rows whose mean a single draw carries."""
    if carried.any():
        warnings.warn(
            f"At {carried.sum()} rows a single draw makes up more than {100 * _HEAVY:g} % "
            "of the mean, which may be infinite: another seed gives another mean. predict_interval "
            "does not depend on it; a tighter noise_prior or more rows make it finite.",
            SamplingWarning,
            stacklevel=3,
        )


def samples(
    mixture_at: MixtureAt,
    X: FloatArray,
    n_draws: int | None,
    random: np.random.RandomState,
    draw: Draw,
) -> FloatArray:
    """Return draws (n_draws, n) of the mixture at each row."""
    posteriors, followed = curves(mixture_at(X), n_draws, random)
    values = [draw(posterior, X, random) for posterior in posteriors]
    return np.concatenate(values) if followed is None else np.select(followed, values)


def curves(
    mixture: Mixture, n_draws: int | None, random: np.random.RandomState
) -> tuple[list[Posterior], list[NDArray[np.bool_]] | None]:
    """Return posteriors of n_draws, and which of them each draw follows at each row, (n_draws, n).

    None: their draws come one after the other, n_draws together, and follow their own everywhere.
    Where weights change with the row, one number a draw decides at all rows: it is a curve that
    changes its surrogate where the weight passes that number.
    """
    if all(np.ndim(weight) == 0 for weight, _ in mixture):
        return drawn(mixture, n_draws, random), None
    n = mixture[0][1].n_draws if n_draws is None else n_draws
    check_scalar(n, "n_draws", Integral, min_val=1)
    level = random.uniform(size=(n, 1))
    ends = np.cumsum(np.broadcast_arrays(*(weight for weight, _ in mixture)), axis=0)
    ends[-1] = 1.0
    followed = np.diff([level < end for end in ends], axis=0, prepend=False)
    posteriors = [
        posterior.take(random.choice(posterior.n_draws, n, n > posterior.n_draws))
        for _, posterior in mixture
    ]
    return posteriors, list(followed)


def drawn(
    mixture: Mixture, n_draws: int | None, random_state: np.random.RandomState
) -> list[Posterior]:
    """Return posteriors whose draws together make n_draws of the mixture."""
    n = sum(p.n_draws for _, p in mixture) // len(mixture) if n_draws is None else n_draws
    check_scalar(n, "n_draws", Integral, min_val=1)
    if len(mixture) == 1 and n_draws is None:
        return [mixture[0][1]]
    counts = random_state.multinomial(n, [weight for weight, _ in mixture])
    return [
        posterior.take(random_state.choice(posterior.n_draws, count, count > posterior.n_draws))
        for count, (_, posterior) in zip(counts, mixture, strict=True)
        if count
    ]


def noise_free(posterior: Posterior, X: FloatArray, random: np.random.RandomState) -> FloatArray:
    """Return the mean of y for each draw, (S, n)."""
    return posterior.likelihood.mean(*posterior.eta(X))


def noisy(posterior: Posterior, X: FloatArray, random: np.random.RandomState) -> FloatArray:
    """Return y drawn once for each draw, (S, n)."""
    likelihood, (eta, noise) = posterior.likelihood, posterior.eta(X)
    together = posterior.model.conditional(X, posterior.values, measured=False)
    if together is None:
        return likelihood.sample(eta, noise, random)
    errors = together.correlated(random.standard_normal(eta.shape))
    return likelihood.inverse(eta + noise * errors)


def _bandwidth(eta: FloatArray, noise: FloatArray, y: FloatArray) -> FloatArray:
    """Return the noise (n,) that the density at y needs at least, given draws (S, n); 0: any.

    Where noise is next to nothing, as in a path through repeated values, a finite number of draws
    are spikes with nothing between them. The bandwidth is the distance to the tenth nearest draw,
    and at most that of normal densities (Silverman 1986, Density Estimation, eq. 3.31).
    """
    out = 0.9 * np.std(eta, axis=0) * len(eta) ** -0.2
    # elsewhere all noise is larger already; ordering draws of each row takes a quarter of a score
    at = noise.min(axis=0) < out
    tenth = min(10, len(eta)) - 1
    nearest = np.partition(np.abs(eta[:, at] - y[at]), tenth, axis=0)[tenth]
    out[at] = np.minimum(nearest, out[at])
    return np.where(at, out, 0.0)


def log_density_of(mixture: Mixture, X: FloatArray, y: FloatArray) -> FloatArray:
    """Return the log density of rows under a mixture of posteriors, (n,): -inf where impossible."""
    terms = []
    for weight, posterior in mixture:
        eta, noise = posterior.eta(X)
        if posterior.likelihood.scales_noise:
            noise = np.maximum(noise, _bandwidth(eta, noise, posterior.likelihood.working(y)))
        log_density = posterior.likelihood.log_density(y, eta, noise)
        # where a simulation has no output for a draw, this predicts no y
        log_density = np.where(np.isnan(log_density), -np.inf, log_density)
        with np.errstate(divide="ignore"):  # a weight may be zero at some rows
            log_weight = np.log(weight) - np.log(len(log_density))
        terms.append(special.logsumexp(log_density, axis=0) + log_weight)
    return special.logsumexp(terms, axis=0)
