"""How often the best of all tests finds noise that is not what was assumed.

No test with a given rate of false alarms finds it more often than the ratio of the two densities,
with the simulation, the form and all its numbers known (Neyman and Pearson 1933, Philosophical
Transactions of the Royal Society A 231:289). Against it stands noise that is the same in all rows,
normal, independent and as large on average: a diagnosis does not know how large noise is.
"""

from __future__ import annotations

import numpy as np
from scipy import special, stats

from . import noises
from .cases import Case, along, make_case
from .simulations import Array

_NORMAL = stats.norm()


def best_power(form: str, size: float, n_rows: int, rate: float = 0.05, n_cases: int = 10) -> float:
    """Return the largest probability with which a form of noise of a size can be detected.

    Parameters
    ----------
    form : str
        "noise" or one of ``noises.FORMS``.
    size, n_rows
        As for `make_case`.
    rate : float
        Of false alarms.
    n_cases : int
        Cases to average over, 1000 draws of the noise in each.
    """
    found = []
    for seed in range(n_cases):
        case = make_case(form, size, seed, n_rows)
        rng = np.random.default_rng(seed)
        hidden = drawn(form, size, case, 1000, rng)
        usual = np.sqrt(np.mean(hidden**2)) * rng.standard_normal((4000, n_rows))
        limit = np.quantile(log_ratio(form, size, case, usual), 1 - rate)
        found.append(np.mean(log_ratio(form, size, case, hidden) > limit))
    return float(np.mean(found))


def drawn(form: str, size: float, case: Case, n: int, rng: np.random.Generator) -> Array:
    """Return n draws of noise for the rows of a case, its numbers those of the case."""
    if form == "noise: tails":
        mu = case.truth["mu"]
        return np.array([noises.outliers(size, case.X[:, 0], mu, rng)[0] for _ in range(n)])
    noise = rng.standard_normal((n, len(case.y)))
    if form == "noise: autocorrelation":
        return noise @ np.linalg.cholesky(correlation(case)).T
    return shape(form, size, case) * noise


def log_ratio(form: str, size: float, case: Case, noise: Array) -> Array:
    """Return the log density (R,) of noise (R, n) under a form, less that of usual noise.

    Usual noise is as large on average as that of the form.
    """
    if form == "noise: tails":
        n, factor = noise.shape[1], 1 + 2 * size
        n_far = max(3, round(n / 10))
        wide = _NORMAL.logpdf(noise / factor) - np.log(factor) - _NORMAL.logpdf(noise)
        sd = np.sqrt(1 + (factor**2 - 1) * n_far / n)
        plain = _NORMAL.logpdf(noise) - _NORMAL.logpdf(noise / sd) + np.log(sd)
        return plain.sum(axis=1) + _log_mean_product(wide, n_far)
    usual = _NORMAL.logpdf(noise).sum(axis=1)
    if form == "noise: autocorrelation":
        return stats.multivariate_normal(cov=correlation(case)).logpdf(noise) - usual
    sd = shape(form, size, case)
    return (_NORMAL.logpdf(noise / sd) - np.log(sd)).sum(axis=1) - usual


def shape(form: str, size: float, case: Case) -> Array:
    """Return the standard deviation of each row, in units of its root mean square."""
    if "row_sd" in case.truth:
        return np.asarray(case.truth["row_sd"])
    if form == "noise":
        column = case.simulator.input_names.index(case.truth["target"])
        return along(case.X[:, column], case.truth["ratio"])
    height = np.abs(case.truth["mu"])
    sd = 1 + size * (height - height.min()) / np.ptp(height)
    return sd / np.sqrt(np.mean(sd**2))


def correlation(case: Case) -> Array:
    """Return the correlation matrix of autocorrelated noise, (n, n)."""
    x, share = case.X[:, 0], case.truth["share"]
    distance = np.abs(x[:, None] - x)
    return share * np.exp(-distance / case.truth["length"]) + (1 - share) * np.eye(len(x))


def _log_mean_product(log_factors: Array, k: int) -> Array:
    """Return the log of the mean, over all choices of k of n rows, of the product of factors."""
    sums = np.full((len(log_factors), k + 1), -np.inf)
    sums[:, 0] = 0.0
    for column in log_factors.T:
        sums[:, 1:] = np.logaddexp(sums[:, 1:], sums[:, :-1] + column[:, None])
    n = log_factors.shape[1]
    return sums[:, k] - (
        special.gammaln(n + 1) - special.gammaln(k + 1) - special.gammaln(n - k + 1)
    )
