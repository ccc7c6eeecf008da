"""Laplace approximation, Student-t proposal, Pareto-smoothed importance draws.

Densities take a batch of points (J, d) and return (J,), so every step below is one call.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import special

from hybridsurrogate.priors import FloatArray

LogDensity = Callable[[FloatArray], FloatArray]

DEGREES_OF_FREEDOM = 5.0
PROPOSAL_SCALE = 1.1
KHAT_LIMIT = 0.7
# a proposal with less of the weight than this stays where it is
_LEAST_SHARE = 1e-3


@dataclass(frozen=True)
class Gaussian:
    """A Gaussian approximation: mean (d,), lower Cholesky factor of its covariance (d, d)."""

    mean: FloatArray
    factor: FloatArray
    log_mass: float = 0.0


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
        Of the last round.
    """

    draws: FloatArray
    khat: float
    effective_draws: float
    log_evidence: float
    proposals: Proposals


def find_modes(
    log_density: LogDensity, starts: FloatArray, step_share: float = 0.1, max_iter: int = 40
) -> list[Gaussian]:
    """Climb from every start at once by damped Newton steps; return distinct modes, best first.

    Gradient and Hessian are central differences whose steps follow the curvature, all starts and
    all difference points in one call of the density.

    Parameters
    ----------
    log_density : callable
    starts : ndarray of shape (S, d)
    step_share : float
        Length of difference steps in standard deviations; longer ones even out a rough density.

    Returns
    -------
    list of Gaussian
        Laplace approximations with their log masses.
    """
    x = np.array(starts, dtype=float)
    value = log_density(x)
    alive = np.isfinite(value)
    if not alive.any():
        raise ValueError(
            "The log density is minus infinity at every starting point: the priors and the data "
            "contradict each other, or the simulation fails everywhere. Check priors and units."
        )
    x, value = x[alive], value[alive]
    step = np.full(x.shape, 1e-4)
    damping = np.full(len(x), 1e-3)
    active = np.ones(len(x), dtype=bool)
    hessian = np.zeros((*x.shape, x.shape[1]))
    for iteration in range(max_iter):
        if iteration >= 4:  # starts that trail by far will not matter
            active &= value > value.max() - 25.0
        if not active.any():
            break
        gradient, curvature = _differences(log_density, x[active], value[active], step[active])
        hessian[active] = curvature
        move = _newton_move(gradient, curvature, damping[active])
        trial = x[active] + move
        trial_value = log_density(trial)
        better = trial_value > value[active]
        gain = np.where(better, trial_value - value[active], np.inf)
        index = np.flatnonzero(active)
        x[index[better]] = trial[better]
        value[index[better]] = trial_value[better]
        damping[index] = np.clip(np.where(better, 0.1, 8.0) * damping[index], 1e-9, 1e9)
        diagonal = np.abs(np.einsum("jkk->jk", curvature))
        step[index] = step_share * np.clip(1 / np.sqrt(np.maximum(diagonal, 1e-8)), 1e-7, 0.5)
        done = (better & (gain < 1e-3)) | (damping[index] > 1e4)
        active[index[done]] = False
    _, hessian = _differences(log_density, x, value, step)
    return distinct(_approximations(x, value, hessian))


def _differences(
    log_density: LogDensity, x: FloatArray, value: FloatArray, step: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return gradients (S, d) and Hessians (S, d, d) by central differences."""
    S, d = x.shape
    unit = np.eye(d)
    pairs = [(i, j) for i in range(d) for j in range(i)]
    offsets = np.array(
        [*unit, *-unit]
        + [unit[i] + unit[j] for i, j in pairs]
        + [-unit[i] - unit[j] for i, j in pairs]
    )
    points = x[:, None, :] + offsets * step[:, None, :]
    values = log_density(points.reshape(-1, d)).reshape(S, -1)
    values = np.where(np.isfinite(values), values, value[:, None] - 1e6)
    plus, minus = values[:, :d], values[:, d : 2 * d]
    gradient = (plus - minus) / (2 * step)
    hessian = np.empty((S, d, d))
    hessian[:, np.arange(d), np.arange(d)] = (plus + minus - 2 * value[:, None]) / step**2
    for k, (i, j) in enumerate(pairs):
        both = values[:, 2 * d + k] + values[:, 2 * d + len(pairs) + k]
        single = plus[:, i] + minus[:, i] + plus[:, j] + minus[:, j]
        mixed = (both - single + 2 * value) / (2 * step[:, i] * step[:, j])
        hessian[:, i, j] = hessian[:, j, i] = mixed
    return gradient, hessian


def _newton_move(gradient: FloatArray, hessian: FloatArray, damping: FloatArray) -> FloatArray:
    """Return the damped Newton step; directions that curve upwards are walked along anyway."""
    eigenvalue, vector = np.linalg.eigh(-hessian)
    size = np.abs(eigenvalue) + damping[:, None] * np.maximum(
        np.abs(eigenvalue).max(axis=1, keepdims=True), 1.0
    )
    along = np.einsum("jki,jk->ji", vector, gradient) / np.maximum(size, 1e-10)
    move = np.einsum("jki,ji->jk", vector, along)
    length = np.linalg.norm(move, axis=1, keepdims=True)
    return move * np.minimum(1.0, 2.0 / np.maximum(length, 1e-300))


def _approximations(x: FloatArray, value: FloatArray, hessian: FloatArray) -> list[Gaussian]:
    # saddles and rounding: no direction is wider than a few of the prior's deviations
    eigenvalue, vector = np.linalg.eigh(-hessian)
    eigenvalue = np.clip(eigenvalue, 0.05, 1e10)
    covariance = (vector / eigenvalue[:, None, :]) @ np.swapaxes(vector, 1, 2)
    factor = np.linalg.cholesky(covariance)
    log_mass = value - 0.5 * np.log(eigenvalue).sum(axis=1) + 0.5 * x.shape[1] * np.log(2 * np.pi)
    order = np.argsort(-value)
    return [Gaussian(x[k].copy(), factor[k], float(log_mass[k])) for k in order]


def distinct(found: list[Gaussian]) -> list[Gaussian]:
    """Return the modes that are not repetitions of an earlier one, the largest mass first."""
    modes: list[Gaussian] = []
    for new in found:
        inside = any(
            np.linalg.norm(np.linalg.solve(mode.factor, new.mean - mode.mean))
            < 3.0 + len(mode.mean)
            for mode in modes
        )
        if not inside:
            modes.append(new)
    modes.sort(key=lambda mode: -mode.log_mass)
    return modes


def student_draws(
    approximation: Gaussian, n: int, random_state: np.random.RandomState
) -> FloatArray:
    """Draw n points from the Student-t proposal around a Gaussian approximation."""
    d = len(approximation.mean)
    normal = random_state.standard_normal((n, d))
    chi2 = random_state.chisquare(DEGREES_OF_FREEDOM, size=(n, 1)) / DEGREES_OF_FREEDOM
    return approximation.mean + PROPOSAL_SCALE * (normal / np.sqrt(chi2)) @ approximation.factor.T


def student_log_density(approximation: Gaussian, x: FloatArray) -> FloatArray:
    """Return the log density of that proposal at points (J, d)."""
    d, nu = len(approximation.mean), DEGREES_OF_FREEDOM
    scaled = np.linalg.solve(PROPOSAL_SCALE * approximation.factor, (x - approximation.mean).T)
    log_det = np.log(np.diagonal(PROPOSAL_SCALE * approximation.factor)).sum()
    return (
        special.gammaln((nu + d) / 2)
        - special.gammaln(nu / 2)
        - 0.5 * d * np.log(nu * np.pi)
        - log_det
        - 0.5 * (nu + d) * np.log1p(np.einsum("dj,dj->j", scaled, scaled) / nu)
    )


def mixture_draws(
    components: list[Gaussian], n: int, random_state: np.random.RandomState
) -> tuple[FloatArray, FloatArray]:
    """Draw n points from a mixture of Student-t proposals; return them and their log density.

    Components weigh as much as their masses, but at least a twentieth, so that a small mode far
    away gets enough points to be weighed itself.
    """
    mass = np.array([g.log_mass for g in components])
    share = np.maximum(np.exp(mass - special.logsumexp(mass)), 0.05)
    share /= share.sum()
    counts = np.diff(np.round(n * np.concatenate([[0.0], np.cumsum(share)])).astype(int))
    points = np.concatenate(
        [student_draws(g, k, random_state) for g, k in zip(components, counts, strict=True)]
    )
    terms = [
        np.log(w) + student_log_density(g, points) for w, g in zip(share, components, strict=True)
    ]
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
    noise_scale = 1.0
    for round_ in range(max_rounds):
        points, log_proposal = mixture_draws(components, n_proposals, random_state)
        noise, log_noise = _noise_draws(n_proposals, n_noise, noise_scale, random_state)
        log_proposal = log_proposal + log_noise
        extended = np.hstack([points, noise])
        log_weight = log_density(extended) - log_proposal
        smoothed, khat = pareto_smooth(log_weight)
        weight = np.exp(smoothed - special.logsumexp(smoothed))
        effective = 1 / np.sum(weight**2)
        enough = effective >= 0.1 * n_proposals
        if (enough and khat <= KHAT_LIMIT) or round_ == max_rounds - 1:
            break
        matched = _matched(points, weight, components)
        if n_noise:
            spread = np.sqrt(weight @ np.einsum("jk,jk->j", noise, noise) / n_noise)
            noise_scale = float(np.clip(spread, 0.5, 2.0))
        # draws that are many but badly tailed lack a wide proposal rather than a better centre
        components = [*components, *matched] if enough else matched
    index = systematic_resample(weight, n_draws, random_state)
    log_evidence = float(special.logsumexp(log_weight) - np.log(len(log_weight)))
    proposals = Proposals(extended, log_proposal)
    return ImportanceDraws(extended[index], khat, float(effective), log_evidence, proposals)


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
    log_student = (
        special.gammaln((DEGREES_OF_FREEDOM + d) / 2)
        - special.gammaln(DEGREES_OF_FREEDOM / 2)
        - 0.5 * d * np.log(DEGREES_OF_FREEDOM * np.pi)
        - 0.5 * (DEGREES_OF_FREEDOM + d) * np.log1p(squares / DEGREES_OF_FREEDOM)
    )
    return scale * points, np.logaddexp(log_normal, log_student) - np.log(2) - d * np.log(scale)


def _matched(points: FloatArray, weight: FloatArray, components: list[Gaussian]) -> list[Gaussian]:
    """Return each component moved to the moments of the points that it is responsible for."""
    log_terms = np.stack([g.log_mass + student_log_density(g, points) for g in components])
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
    shape, scale = pareto_fit(np.maximum(excess, 1e-300))
    if np.isfinite(shape):
        probability = (np.arange(n_tail) + 0.5) / n_tail
        quantile = (
            scale * np.expm1(-shape * np.log1p(-probability)) / shape
            if abs(shape) > 1e-9
            else -scale * np.log1p(-probability)
        )
        out[tail] = np.minimum(np.log(quantile + np.exp(cutoff)), 0.0)
    return out, float(shape)


def pareto_fit(excess: FloatArray) -> tuple[float, float]:
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
    weight = np.exp(profile - special.logsumexp(profile))
    best = float(np.sum(theta * weight))
    k = float(np.log1p(-best * excess).mean())
    return (n * k + 10 * 0.5) / (n + 10), -k / best
