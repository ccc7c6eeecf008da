"""Laplace approximation, Student-t proposal, Pareto-smoothed importance draws.

Densities take a batch of points (J, d) and return (J,), so every step below is one call.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import special

from hybridsurrogate.inference.modes import Gaussian, LogDensity
from hybridsurrogate.inference.pareto import KHAT_LIMIT, pareto_smooth
from hybridsurrogate.priors import FloatArray

DEGREES_OF_FREEDOM = 5.0
PROPOSAL_SCALE = 1.1
# a proposal with less of the weight than this stays where it is
_LEAST_SHARE = 1e-3
# of so many weights none exceeds the mean by so much (in nats): they are level
_MANY, _LEVEL = 1000, float(np.log(10.0))
# a component gets at least this share of the points
_LEAST_PROPOSED = 0.05


@dataclass(frozen=True)
class Proposals:
    """Points (J, d) and the log density (J,) that they were drawn from."""

    points: FloatArray
    log_density: FloatArray


@dataclass(frozen=True)
class ImportanceDraws:
    """Resampled draws and how far they can be trusted.

    Attributes
    ----------
    draws : ndarray of shape (n_draws, d)
    khat : float
        Shape of the Pareto tail of the weights; above 0.7 the draws are not trustworthy.
    effective_draws : float
        1 / sum of squared normalised weights.
    log_evidence : float
        Log of the mean weight, an estimate of the log normalising constant.
    proposals : Proposals
        Of the best round.
    """

    draws: FloatArray
    khat: float
    effective_draws: float
    log_evidence: float
    proposals: Proposals


def student_draws(
    approximation: Gaussian, n: int, random_state: np.random.RandomState
) -> FloatArray:
    """Draw n points from the Student-t proposal around a Gaussian approximation."""
    d = len(approximation.mean)
    normal = random_state.standard_normal((n, d))
    chi2 = random_state.chisquare(DEGREES_OF_FREEDOM, size=(n, 1)) / DEGREES_OF_FREEDOM
    return approximation.mean + PROPOSAL_SCALE * (normal / np.sqrt(chi2)) @ approximation.factor.T


def student_log_density(approximations: Sequence[Gaussian], x: FloatArray) -> FloatArray:
    """Return the log densities (K, J) of the proposals around K Gaussians at points (J, d)."""
    factors = PROPOSAL_SCALE * np.array([g.factor for g in approximations])
    means = np.array([g.mean for g in approximations])
    scaled = np.linalg.inv(factors) @ (x[None] - means[:, None]).transpose(0, 2, 1)
    log_det = np.log(np.diagonal(factors, axis1=1, axis2=2)).sum(axis=1)
    squares = np.einsum("kdj,kdj->kj", scaled, scaled)
    return _standard_student(squares, x.shape[1]) - log_det[:, None]


def _standard_student(squares: FloatArray, d: int) -> FloatArray:
    """Return the log density of d standard Student-t variables at a squared distance from 0."""
    nu = DEGREES_OF_FREEDOM
    return (
        special.gammaln((nu + d) / 2)
        - special.gammaln(nu / 2)
        - 0.5 * d * np.log(nu * np.pi)
        - 0.5 * (nu + d) * np.log1p(squares / nu)
    )


def mixture_draws(
    components: list[Gaussian], n: int, random_state: np.random.RandomState
) -> tuple[FloatArray, FloatArray]:
    """Draw n points from a mixture of Student-t proposals; return them and their log density.

    Components weigh as much as their masses, but at least a twentieth (of many: half of an equal
    share), so that a small mode far away gets enough points to be weighed itself.
    """
    mass = np.array([g.log_mass for g in components])
    least = min(_LEAST_PROPOSED, 0.5 / len(components))
    share = np.maximum(np.exp(mass - special.logsumexp(mass)), least)
    share /= share.sum()
    counts = np.diff(np.round(n * np.concatenate([[0.0], np.cumsum(share)])).astype(int))
    points = np.concatenate(
        [student_draws(g, k, random_state) for g, k in zip(components, counts, strict=True)]
    )
    terms = np.log(share)[:, None] + student_log_density(components, points)
    return points, special.logsumexp(terms, axis=0)


def importance_draws(
    log_density: LogDensity,
    components: list[Gaussian],
    n_proposals: int,
    n_draws: int,
    random_state: np.random.RandomState,
    max_rounds: int = 4,
    n_noise: int = 0,
) -> ImportanceDraws:
    """Draw from a density through Student-t proposals with Pareto-smoothed weights.

    The last ``n_noise`` dimensions of the density get proposals that are standard normal or, every
    other one, Student-t: exact where the density is nearly normal, and safe where its tails are
    heavier. Their width is adapted with the rest.

    Where fewer than a tenth of the proposals are effective, each proposal is moved to the weighted
    mean and covariance of its share of the draws, and where only the tail of the weights is bad,
    such proposals are added; the round is then repeated (Cappe, Douc, Guillin, Marin and Robert
    2008, Statistics and Computing 18:447).
    """
    noise_scale, best = 1.0, None
    for round_ in range(max_rounds):
        points, log_proposal = mixture_draws(components, n_proposals, random_state)
        noise, log_noise = _noise_draws(n_proposals, n_noise, noise_scale, random_state)
        log_proposal = log_proposal + log_noise
        extended = np.hstack([points, noise])
        log_weight = log_density(extended) - log_proposal
        smoothed, khat = _smoothed(log_weight)
        weight = np.exp(smoothed - special.logsumexp(smoothed))
        effective = 1 / np.sum(weight**2)
        enough = effective >= 0.1 * n_proposals
        # the last round need not be the best: narrow proposals get few draws to learn from
        merit = (enough, -khat)
        if best is None or merit > best[0]:
            best = merit, extended, log_proposal, log_weight, weight, float(effective)
        if (enough and khat <= KHAT_LIMIT) or round_ == max_rounds - 1:
            break
        matched = _matched(points, weight, components)
        if n_noise:
            spread = np.sqrt(weight @ np.einsum("jk,jk->j", noise, noise) / n_noise)
            noise_scale = float(np.clip(spread, 0.5, 2.0))
        # draws that are many but badly tailed lack a wide proposal rather than a better centre
        components = [*components, *matched] if enough else matched
    assert best is not None
    (_, minus_khat), points, log_proposal, log_weight, weight, effective = best
    index = systematic_resample(weight, n_draws, random_state)
    log_evidence = float(special.logsumexp(log_weight) - np.log(len(log_weight)))
    proposals = Proposals(points, log_proposal)
    return ImportanceDraws(points[index], -minus_khat, effective, log_evidence, proposals)


def _smoothed(log_weight: FloatArray) -> tuple[FloatArray, float]:
    """Return smoothed log weights and k-hat; level weights as they are, with k-hat at most 0.

    A Pareto tail with k = 0.7 stays below ten times its mean in one of a thousand samples of 1000.
    Weights that do are bounded, and the steps of a plateau can look like any tail to the fit.
    """
    log_mean = special.logsumexp(log_weight) - np.log(len(log_weight))
    smoothed, khat = pareto_smooth(log_weight)
    if len(log_weight) >= _MANY and np.max(log_weight) <= log_mean + _LEVEL:
        return log_weight, min(khat, 0.0)
    return smoothed, khat


def _noise_draws(
    n: int, d: int, scale: float, random_state: np.random.RandomState
) -> tuple[FloatArray, FloatArray]:
    """Return n points (n, d) of the half normal, half Student-t mixture, and log densities."""
    if not d:
        return np.empty((n, 0)), np.zeros(n)
    points = random_state.standard_normal((n, d))
    chi2 = random_state.chisquare(DEGREES_OF_FREEDOM, size=(n // 2, 1)) / DEGREES_OF_FREEDOM
    points[: n // 2] /= np.sqrt(chi2)
    squares = np.einsum("jk,jk->j", points, points)
    log_normal = -0.5 * squares - 0.5 * d * np.log(2 * np.pi)
    log_student = _standard_student(squares, d)
    return scale * points, np.logaddexp(log_normal, log_student) - np.log(2) - d * np.log(scale)


def _matched(points: FloatArray, weight: FloatArray, components: list[Gaussian]) -> list[Gaussian]:
    """Return each component moved to the moments of the points that it is responsible for."""
    mass = np.array([g.log_mass for g in components])
    log_terms = mass[:, None] + student_log_density(components, points)
    share = weight * np.exp(log_terms - special.logsumexp(log_terms, axis=0))
    mass = share.sum(axis=1)
    moved = [
        moment_match(points, own / m, g) if m > _LEAST_SHARE else g
        for own, m, g in zip(share, mass, components, strict=True)
    ]
    return [
        replace(g, log_mass=float(np.log(max(m, _LEAST_SHARE))))
        for g, m in zip(moved, mass, strict=True)
    ]


def moment_match(points: FloatArray, weight: FloatArray, fallback: Gaussian) -> Gaussian:
    """Return the Gaussian with the weighted moments of points, kept away from collapse."""
    d = points.shape[1]
    mean = weight @ points
    centred = points - mean
    covariance = (centred * weight[:, None]).T @ centred
    effective = 1 / np.sum(weight**2)
    share = effective / (effective + 2 * d)
    covariance = share * covariance + (1 - share) * fallback.factor @ fallback.factor.T
    covariance += 1e-12 * np.trace(covariance) / d * np.eye(d)
    return Gaussian(mean, np.linalg.cholesky(covariance), fallback.log_mass)


def systematic_resample(
    weight: FloatArray, n: int, random_state: np.random.RandomState
) -> NDArray[np.intp]:
    """Return n indices with the given probabilities, in random order."""
    positions = (np.arange(n) + random_state.uniform()) / n
    cumulative = np.cumsum(weight)
    index = np.searchsorted(cumulative / cumulative[-1], positions)
    return random_state.permutation(np.minimum(index, len(weight) - 1))
