"""Pareto-smoothed importance weights, and k-hat, which shows whether they are reliable."""

from __future__ import annotations

import numpy as np
from scipy import special

from hybridsurrogate.types import FloatArray

# of Vehtari, Simpson, Gelman, Yao and Gabry (2024, Journal of Machine Learning Research 25:72)
KHAT_LIMIT = 0.7
# of so many weights none exceeds the mean by so much (in nats): they are level
_MANY, _LEVEL = 1000, float(np.log(10.0))


def khat_limit(n_draws: int) -> float:
    """Return the k-hat above which estimates from so many draws are unreliable.

    ``min(1 - 1 / log10(n_draws), 0.7)`` (Vehtari et al. 2024): a heavy tail takes more of them.

    Examples
    --------
    >>> [round(khat_limit(n), 3) for n in (100, 1000, 10_000)]
    [0.5, 0.667, 0.7]
    """
    return float(min(1 - 1 / np.log10(n_draws), KHAT_LIMIT)) if n_draws > 10 else 0.0


def pareto_smooth(log_weight: FloatArray) -> tuple[FloatArray, float]:
    """Smooth the largest importance weights by a generalised Pareto tail.

    Vehtari, Simpson, Gelman, Yao and Gabry (2024, Journal of Machine Learning Research 25(72)).

    Parameters
    ----------
    log_weight : ndarray of shape (J,)

    Returns
    -------
    smoothed : ndarray of shape (J,)
    khat : float
        Shape of the tail; infinity when too few weights are finite.
    """
    n = len(log_weight)
    out = np.where(np.isfinite(log_weight), log_weight, -np.inf)
    out = out - out.max()
    n_tail = int(min(np.ceil(0.2 * n), np.ceil(3 * np.sqrt(n))))
    order = np.argsort(out)
    tail = order[-n_tail:]
    cutoff = out[order[-n_tail - 1]]
    if not np.isfinite(cutoff):
        return out, np.inf
    excess = np.exp(out[tail]) - np.exp(cutoff)
    if excess[-1] <= 1e-12:
        return out, -np.inf
    shape, scale = _pareto_fit(np.maximum(excess, 1e-300))
    if np.isfinite(shape):
        probability = (np.arange(n_tail) + 0.5) / n_tail
        # of a tail this heavy the largest quantiles are no numbers
        power = np.minimum(-shape * np.log1p(-probability), 600.0)
        quantile = (
            scale * np.expm1(power) / shape
            if abs(shape) > 1e-9
            else -scale * np.log1p(-probability)
        )
        out[tail] = np.minimum(np.log(quantile + np.exp(cutoff)), 0.0)
    return out, float(shape)


def level_smooth(log_weight: FloatArray) -> tuple[FloatArray, float]:
    """Return smoothed log weights and k-hat; level weights as they are, with k-hat at most 0.

    A Pareto tail with k = 0.7 stays below ten times its mean in one of a thousand samples of 1000,
    and its largest of n grows as n^k. Weights that stay below have no such tail, though the steps
    of a plateau can look like any to the fit: k-hat is at most 0.7.
    """
    known = np.where(np.isfinite(log_weight), log_weight, -np.inf)
    log_mean = special.logsumexp(known) - np.log(len(known))
    smoothed, khat = pareto_smooth(known)
    if len(known) >= _MANY:
        excess = np.max(known) - log_mean - _LEVEL
        if excess <= KHAT_LIMIT * np.log(len(known) / _MANY):
            return known, min(khat, KHAT_LIMIT if excess > 0 else 0.0)
    return smoothed + np.max(known), khat


def _pareto_fit(excess: FloatArray) -> tuple[float, float]:
    """Fit a generalised Pareto distribution to sorted positive values.

    Zhang and Stephens (2009, Technometrics 51:316), with the weak prior on the shape of Vehtari
    et al. (2024): ten observations at 0.5.
    """
    n = len(excess)
    m = 30 + int(np.sqrt(n))
    quartile = excess[int(n / 4 + 0.5) - 1]
    theta = 1 / excess[-1] + (1 - np.sqrt(m / (np.arange(m) + 0.5))) / (3 * quartile)
    shape = np.log1p(-theta[:, None] * excess).mean(axis=1)
    profile = n * (np.log(-theta / shape) - shape - 1)
    weight = np.exp(profile - np.logaddexp.reduce(profile))
    best = float(np.sum(theta * weight))
    k = float(np.log1p(-best * excess).mean())
    return (n * k + 10 * 0.5) / (n + 10), -k / best
