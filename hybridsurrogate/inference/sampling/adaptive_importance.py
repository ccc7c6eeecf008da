"""Laplace approximation, Student-t proposal, Pareto-smoothed importance draws.

Densities take a batch of points (J, d) and return (J,), so every step below is one call.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from hybridsurrogate.inference.sampling.modes import Gaussian, LogDensity
from hybridsurrogate.inference.sampling.proposals import (
    DEGREES_OF_FREEDOM,
    Cell,
    balanced,
    cells_of,
    matched,
    mixture_log_density,
    mixture_points,
    slices,
    standard_student,
)
from hybridsurrogate.inference.sampling.settings import SETTINGS
from hybridsurrogate.numerics.psis import KHAT_LIMIT, level_smooth
from hybridsurrogate.types import FloatArray


@dataclass(frozen=True)
class Proposals:
    """Points (J, d) and the log density (J,) that they were drawn from."""

    points: FloatArray
    log_density: FloatArray


@dataclass(frozen=True)
class ImportanceDraws:
    """Resampled draws and how reliable they are.

    Attributes
    ----------
    draws : ndarray of shape (n_draws, d)
    khat : float
        Shape of the Pareto tail of the weights; above 0.7 the draws are unreliable.
    effective_draws : float
        1 / sum of squared normalised weights.
    log_evidence : float
        Log of the mean weight, an estimate of the log normalising constant.
    log_evidence_error : float
        Its standard error, from the spread of the weights.
    proposals : Proposals
        Of all rounds.
    """

    draws: FloatArray
    khat: float
    effective_draws: float
    log_evidence: float
    log_evidence_error: float
    proposals: Proposals


def importance_draws(
    log_density: LogDensity,
    components: list[Gaussian],
    n_proposals: int,
    n_draws: int,
    random_state: np.random.RandomState,
    max_rounds: int = 6,
    n_noise: int = 0,
    modes: Sequence[Gaussian] = (),
) -> ImportanceDraws:
    """Draw from a density through Student-t proposals with Pareto-smoothed weights.

    The last ``n_noise`` dimensions of the density get proposals that are standard normal or, every
    other one, Student-t: exact where the density is nearly normal, and safe where its tails are
    heavier. Their width is adapted with the rest.

    Where fewer than a tenth of the proposals are effective, or the tail of the weights is bad, the
    next round has proposals at the weighted mean and covariance of each one's share of the draws
    (Cappe, Douc, Guillin, Marin and Robert 2008, Statistics and Computing 18:447), and of slices
    of it along its longest axis, which follow a bend. The draws of all rounds get their weights
    from the mixture of all proposals, so that none is lost (Cornuet, Marin, Mira and Robert 2012,
    Scandinavian Journal of Statistics 39:798).

    Where there are several ``modes``, the weights near each of them have a separate k-hat, and the
    largest counts: good draws at one mode do not show the mass of another.
    """
    rounds: list[_Round] = []
    scale, target = 1.0, np.empty(0)
    mixed: FloatArray = np.empty(0)
    # with coefficients among the unknowns each value is optimised: what can be trusted is enough
    good = KHAT_LIMIT if n_noise else SETTINGS.good_khat
    for round_ in range(max_rounds):
        rounds.append(_drawn(components, scale, n_proposals, n_noise, random_state))
        target = np.append(target, log_density(rounds[-1].points))
        points = np.concatenate([one.points for one in rounds])
        shaped = points[:, : points.shape[1] - n_noise]
        mixed = _mixed(mixed, rounds, points, n_noise)
        log_proposal = mixed - np.log(len(rounds))
        log_weight = target - log_proposal
        cells = cells_of(modes, shaped)
        smoothed, khats = _smoothed_by_cell(log_weight, cells)
        khat = max(khats)
        weight = np.exp(smoothed - special.logsumexp(smoothed))
        effective = float(1 / np.sum(weight**2))
        enough = effective >= 0.1 * n_proposals
        if (enough and khat <= good) or round_ == max_rounds - 1:
            break
        shaping = balanced(smoothed, cells, np.asarray(khats) > good, shaped.shape[1])
        components = matched(shaped, shaping, components)
        if len(components) <= SETTINGS.most_sliced:
            components = [*components, *slices(shaped, shaping, components)]
        if n_noise:
            noise = points[:, -n_noise:]
            spread = np.sqrt(weight @ np.einsum("jk,jk->j", noise, noise) / n_noise)
            scale = float(np.clip(spread, 0.5, 2.0))
    index = systematic_resample(weight, n_draws, random_state)
    proposals = Proposals(points, log_proposal)
    return ImportanceDraws(points[index], khat, effective, *log_mean(log_weight), proposals)


def log_mean(log_weight: FloatArray) -> tuple[float, float]:
    """Return the log of the mean weight and its standard error, by the spread of the weights."""
    value = float(special.logsumexp(log_weight) - np.log(len(log_weight)))
    relative = np.exp(log_weight - value)
    return value, float(np.std(relative) / np.sqrt(len(relative)))


class _Round(NamedTuple):
    """Points (J, d + n_noise) of one round, and what they were drawn from."""

    points: FloatArray
    components: list[Gaussian]
    scale: float


def _drawn(
    components: list[Gaussian],
    scale: float,
    n: int,
    n_noise: int,
    random_state: np.random.RandomState,
) -> _Round:
    points = mixture_points(components, n, random_state)
    noise = _noise_points(n, n_noise, scale, random_state)
    return _Round(np.hstack([points, noise]), components, scale)


def _mixed(
    before: FloatArray, rounds: Sequence[_Round], points: FloatArray, n_noise: int
) -> FloatArray:
    """Return the log of the summed densities of all rounds (J,), those of the last one added.

    ``before`` holds it for the points and the densities of the rounds before.
    """
    old, new = points[: len(before)], points[len(before) :]
    added = np.logaddexp(before, _round_log_density(rounds[-1], old, n_noise))
    terms = [_round_log_density(one, new, n_noise) for one in rounds]
    return np.concatenate([added, special.logsumexp(terms, axis=0)])


def _round_log_density(one: _Round, points: FloatArray, n_noise: int) -> FloatArray:
    d = points.shape[1] - n_noise
    squares = np.einsum("jk,jk->j", points[:, d:], points[:, d:])
    shaped = mixture_log_density(one.components, points[:, :d])
    return shaped + _noise_log_density(squares, n_noise, one.scale)


def _smoothed_by_cell(log_weight: FloatArray, cells: list[Cell]) -> tuple[FloatArray, list[float]]:
    """Return log weights, smoothed in each cell, and the k-hat of each."""
    out = log_weight.copy()
    khats = []
    for cell in cells:
        khats.append(np.inf)
        if np.count_nonzero(np.isfinite(log_weight[cell])) >= SETTINGS.fewest_near:
            out[cell], khats[-1] = level_smooth(log_weight[cell])
    return out, khats


def _noise_points(n: int, d: int, scale: float, random_state: np.random.RandomState) -> FloatArray:
    """Return n points (n, d), half of them normal and half Student-t."""
    if not d:
        return np.empty((n, 0))
    points = random_state.standard_normal((n, d))
    chi2 = random_state.chisquare(DEGREES_OF_FREEDOM, size=(n // 2, 1)) / DEGREES_OF_FREEDOM
    points[: n // 2] /= np.sqrt(chi2)
    return scale * points


def _noise_log_density(squares: FloatArray, d: int, scale: float) -> FloatArray:
    """Return the log density of such points at squared distances from 0."""
    if not d:
        return np.zeros(len(squares))
    squares = squares / scale**2
    log_normal = -0.5 * squares - 0.5 * d * np.log(2 * np.pi)
    log_student = standard_student(squares, d)
    return np.logaddexp(log_normal, log_student) - np.log(2) - d * np.log(scale)


def systematic_resample(
    weight: FloatArray, n: int, random_state: np.random.RandomState
) -> NDArray[np.intp]:
    """Return n indices with the given probabilities, in random order."""
    positions = (np.arange(n) + random_state.uniform()) / n
    cumulative = np.cumsum(weight)
    index = np.searchsorted(cumulative / cumulative[-1], positions)
    return random_state.permutation(np.minimum(index, len(weight) - 1))
