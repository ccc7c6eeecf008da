"""Counts: whether they scatter more than their likelihood allows, and whether runs are rounded."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from hybridsurrogate.diagnosis.checks.caution import Caution
from hybridsurrogate.diagnosis.checks.emulator import EmulatorCheck
from hybridsurrogate.likelihoods import Likelihood
from hybridsurrogate.model.posterior import Posterior
from hybridsurrogate.model.problem import Problem
from hybridsurrogate.types import FloatArray

# a caution is raised in one of a hundred sets without overdispersion
_LEVEL, _N_REPLICATES = 0.01, 999
# pairs that a test needs; rounds of pairing; distances that are no neighbourhood, in medians
_LEAST_PAIRS, _ROUNDS, _TOO_FAR = 8, 3, 3.0
# of one pair: three standard deviations
_LARGEST_SQUARE = 9.0
# Newton steps to the mean of a pair, of which the first two do nearly all
_STEPS, _LONGEST_STEP = 8, 2.0


class Dispersion(NamedTuple):
    """How much counts scatter around the mean of neighbours, in variances that are allowed.

    Attributes
    ----------
    ratio : float
        One where the likelihood is right.
    p_value : float
        How often rows of the likelihood have as large a ratio.
    """

    ratio: float
    p_value: float


def cautions_of_dispersion(problem: Problem, posteriors: Sequence[Posterior]) -> list[Caution]:
    """Return a caution where counts scatter more than a Poisson or binomial likelihood allows.

    Parameters
    ----------
    problem : Problem
        Without effects, and before its rows are expanded.
    posteriors : sequence of Posterior
        Of the estimator without effects, and of others whose mean may be the right one: values
        have to scatter too much around each.
    """
    likelihood = problem.likelihood
    if not likelihood.remedy_of_scatter or not np.all(problem.weights == 1):
        return []
    found = None
    for posterior in posteriors:
        eta = posterior.eta(problem.X)[0]
        eta = np.mean(eta[np.isfinite(eta).all(axis=1)], axis=0)
        found = dispersion_of(likelihood, problem.X, eta, problem.observed)
        if found is None or found.p_value > _LEVEL:
            return []
    if found is None:
        return []
    return [
        Caution(
            "noise",
            f"The measured values scatter {found.ratio:.2g} times as much (in variance) around "
            f"their neighbours as a {likelihood.name} likelihood allows (p = {found.p_value:.3g})."
            " Intervals are too narrow, and noise may be taken for a fault of the simulation: "
            f"{likelihood.remedy_of_scatter}.",
        )
    ]


def cautions_of_rounding(likelihood: Likelihood, check: EmulatorCheck | None) -> list[Caution]:
    """Return a caution where runs may be rounded means, and may hide much.

    Parameters
    ----------
    likelihood : Likelihood
    check : EmulatorCheck or None
        Of an emulator through them.
    """
    if check is None or check.rounding is None or not check.hidden:
        return []
    return [
        Caution(
            "runs",
            "The simulated values are whole numbers, behind which effects of "
            f"{check.hidden:.2g} times the noise may hide. If they are rounded expected values, "
            f"give these as they are: a {likelihood.name} likelihood takes expected values as "
            "runs.",
        )
    ]


def dispersion_of(
    likelihood: Likelihood, X: FloatArray, eta: FloatArray, y: FloatArray
) -> Dispersion | None:
    """Return how much values scatter around the mean of neighbours, None where too few are near.

    Rows are paired with their neighbours. Each pair has the mean of the simulation, with eta
    shifted to match the pair's total, so a smooth error of the mean does not count. For Poisson
    counts that is the index of dispersion of two counts given their sum (Fisher 1950, Biometrics
    6:17). Replicates are drawn around these means.

    Parameters
    ----------
    likelihood : Likelihood
        Without a scale of the noise.
    X : ndarray of shape (n, n_columns)
    eta, y : ndarray of shape (n,)
        What the model predicts, and what was measured.
    """
    first, second = neighbours(X)
    if len(first) < _LEAST_PAIRS:
        return None
    pairs = np.stack([first, second])
    at, values = eta[pairs][:, None], y[pairs][:, None]  # (2, 1, pairs)
    squares, mean = _squares(likelihood, at, values)
    open_ = squares[0] > -np.inf
    if open_.sum() < _LEAST_PAIRS:
        return None
    random = np.random.RandomState(0)  # a fixed stream: the check is reproducible
    center = np.broadcast_to(mean[..., open_], (2, _N_REPLICATES, int(open_.sum())))
    again = likelihood.sample(center, np.ones((1, 1, 1)), random)
    replicates, _ = _squares(likelihood, mean[..., open_], again)
    statistic, drawn = _mean(squares, _LARGEST_SQUARE), _mean(replicates, _LARGEST_SQUARE)
    p_value = (1 + np.sum(drawn >= statistic)) / (1 + _N_REPLICATES)
    ratio = _mean(squares, np.inf)[0] / np.mean(_mean(replicates, np.inf))
    return Dispersion(float(ratio), float(p_value))


def _mean(squares: FloatArray, largest: float) -> FloatArray:
    """Return the mean over pairs that have a square, none above the largest, (R,).

    A pair across a jump counts no more than another.
    """
    has = np.isfinite(squares)
    total = np.sum(np.where(has, np.minimum(squares, largest), 0.0), axis=1)
    return np.asarray(total / np.maximum(has.sum(axis=1), 1))


def neighbours(X: FloatArray) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the rows of pairs of neighbours, each row in one pair at the most.

    Those that are nearest to each other, in columns of unit spread, and then among the rest.
    """
    moving = X[:, np.ptp(X, axis=0) > 0]
    # ties between equal distances are broken, always the same
    jitter = 1e-3 / len(X) * np.random.RandomState(0).standard_normal(moving.shape)
    places = moving / moving.std(axis=0) + jitter if moving.size else np.arange(len(X))[:, None]
    rest = np.arange(len(X))
    first, second, distance = [], [], []
    for _ in range(_ROUNDS):
        if len(rest) < 2:
            break
        apart, nearest = KDTree(places[rest]).query(places[rest], k=2)
        own = np.arange(len(rest))
        other = nearest[:, 1]
        paired = (other[other] == own) & (own < other)
        first.append(rest[own[paired]])
        second.append(rest[other[paired]])
        distance.append(apart[paired, 1])
        rest = np.setdiff1d(rest, np.concatenate([first[-1], second[-1]]))
    a, b, far = (np.concatenate(parts) for parts in (first, second, distance))
    near = far <= _TOO_FAR * np.median(far)
    return a[near], b[near]


def _squares(
    likelihood: Likelihood, eta: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the squared standardised difference of each pair, and eta at the mean of the pair.

    ``eta`` (2, R, p) and ``y`` alike; squares (R, p) are minus infinity where a total is at an end
    of its range, where nothing can scatter.
    """
    sigma = np.ones((1, 1, 1))
    shift = np.zeros(np.broadcast_shapes(eta.shape, y.shape)[1:])
    for _ in range(_STEPS):
        gap = np.sum(y - likelihood.mean(eta + shift, sigma), axis=0)
        step = gap / np.sum(likelihood.variance(eta + shift, sigma), axis=0)
        shift = shift + np.clip(step, -_LONGEST_STEP, _LONGEST_STEP)
    center = eta + shift
    mean, variance = likelihood.mean(center, sigma), likelihood.variance(center, sigma)
    met = np.abs(np.sum(y - mean, axis=0)) < 1e-3 * np.sum(mean, axis=0)
    met &= np.sum(variance, axis=0) > 1e-3
    squares = np.square(y[0] - mean[0]) * np.sum(1 / variance, axis=0)
    return np.where(met, squares, -np.inf), center
