"""Predictions of a mixture of posteriors: moments, densities and draws."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from numbers import Integral
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import special
from sklearn.utils import check_scalar

from hybridsurrogate.exceptions import SamplingWarning
from hybridsurrogate.model.posterior import Posterior
from hybridsurrogate.numerics.blocks import LARGE_BLOCK, blocks
from hybridsurrogate.types import FloatArray

# posteriors with their weights: numbers, or arrays (n,) that change with the row
Mixture = list[tuple[Any, Posterior]]
MixtureAt = Callable[..., Mixture]
Draw = Callable[[Posterior, FloatArray, np.random.RandomState], FloatArray]
# of so many positive means none carries so large a share, unless their distribution has no mean
_MANY, _MOST = 50, 0.2


def row_blocks(mixture_at: MixtureAt, X: FloatArray) -> list[slice]:
    """Cut rows X (n, n_columns) into blocks, so that memory for all draws of them is bounded."""
    draws = sum(posterior.n_draws for _, posterior in mixture_at(X[:1]))
    return blocks(len(X), draws, LARGE_BLOCK)


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
            & ((np.max(m, axis=0) > _MOST * np.sum(m, axis=0)) | np.isinf(np.max(m, axis=0)))
            for m in means
            if len(m) >= _MANY
        ]
    return np.any(each, axis=0) if each else np.zeros(means[0].shape[1], dtype=bool)


def warn_of_carried(carried: NDArray[np.bool_]) -> None:
    """Warn of rows whose mean a single draw carries."""
    if carried.any():
        warnings.warn(
            f"At {carried.sum()} rows a single draw makes up more than {100 * _MOST:g} % of the "
            "mean, which may be infinite: another seed gives another mean. predict_interval does "
            "not depend on it; a tighter noise_prior or more rows make it finite.",
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
    return posterior.likelihood.sample(*posterior.eta(X), random)


def log_density_of(mixture: Mixture, X: FloatArray, y: FloatArray) -> FloatArray:
    """Return the log density of rows under a mixture of posteriors, (n,): -inf where impossible."""
    terms = []
    for weight, posterior in mixture:
        log_density = posterior.likelihood.log_density(y, *posterior.eta(X))
        # where a simulation has no output for a draw, this predicts no y
        log_density = np.where(np.isnan(log_density), -np.inf, log_density)
        with np.errstate(divide="ignore"):  # a weight may be zero at some rows
            log_weight = np.log(weight) - np.log(len(log_density))
        terms.append(special.logsumexp(log_density, axis=0) + log_weight)
    return special.logsumexp(terms, axis=0)
