"""Mixtures of Student-t proposals around Gaussians, and how draws reshape them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import special

from hybridsurrogate.inference.sampling.modes import Gaussian
from hybridsurrogate.inference.sampling.settings import SETTINGS
from hybridsurrogate.types import FloatArray

# indices of points
Cell = NDArray[np.intp]

DEGREES_OF_FREEDOM = 5.0
PROPOSAL_SCALE = 1.1


def student_draws(
    approximation: Gaussian, n: int, random_state: np.random.RandomState
) -> FloatArray:
    """Draw n points from the Student-t proposal around a Gaussian approximation."""
    drawn = standard_student_draws((n, len(approximation.mean)), random_state)
    return approximation.mean + PROPOSAL_SCALE * drawn @ approximation.factor.T


def standard_student_draws(
    shape: tuple[int, ...], random_state: np.random.RandomState
) -> FloatArray:
    """Draw standard Student-t variables; the last axis of the shape holds those of one point."""
    normal = random_state.standard_normal(shape)
    chi2 = random_state.chisquare(DEGREES_OF_FREEDOM, size=(*shape[:-1], 1)) / DEGREES_OF_FREEDOM
    return normal / np.sqrt(chi2)


def student_log_density(approximations: Sequence[Gaussian], x: FloatArray) -> FloatArray:
    """Return the log densities (K, J) of the proposals around K Gaussians at points (J, d)."""
    factors = PROPOSAL_SCALE * np.array([g.factor for g in approximations])
    means = np.array([g.mean for g in approximations])
    scaled = np.linalg.inv(factors) @ (x[None] - means[:, None]).transpose(0, 2, 1)
    log_det = np.log(np.diagonal(factors, axis1=1, axis2=2)).sum(axis=1)
    squares = np.einsum("kdj,kdj->kj", scaled, scaled)
    return standard_student(squares, x.shape[1]) - log_det[:, None]


def standard_student(squares: FloatArray, d: int) -> FloatArray:
    """Return the log density of d standard Student-t variables at a squared distance from 0."""
    nu = DEGREES_OF_FREEDOM
    return (
        special.gammaln((nu + d) / 2)
        - special.gammaln(nu / 2)
        - 0.5 * d * np.log(nu * np.pi)
        - 0.5 * (nu + d) * np.log1p(squares / nu)
    )


def mixture_points(
    components: list[Gaussian], n: int, random_state: np.random.RandomState
) -> FloatArray:
    """Draw n points from a mixture of Student-t proposals.

    Components weigh as much as their masses, but at least a twentieth (of many: half of an equal
    share), so that a small mode far away gets enough points to estimate its mass.
    """
    cumulative = np.concatenate([[0.0], np.cumsum(_shares(components))])
    counts = np.diff(np.round(n * cumulative).astype(int))
    return np.concatenate(
        [student_draws(g, k, random_state) for g, k in zip(components, counts, strict=True)]
    )


def mixture_log_density(components: list[Gaussian], points: FloatArray) -> FloatArray:
    """Return the log density of that mixture at points (J, d)."""
    terms = np.log(_shares(components))[:, None] + student_log_density(components, points)
    out: FloatArray = np.logaddexp.reduce(terms, axis=0)
    return out


def _shares(components: list[Gaussian]) -> FloatArray:
    mass = np.array([g.log_mass for g in components])
    least = min(SETTINGS.least_proposed, 0.5 / len(components))
    share = np.maximum(np.exp(mass - np.logaddexp.reduce(mass)), least)
    return share / share.sum()


def cells_of(modes: Sequence[Gaussian], points: FloatArray) -> list[Cell]:
    """Return which points (J, d) are nearest to which mode; all are one cell without modes."""
    if len(modes) < 2:
        return [np.arange(len(points))]
    nearest = student_log_density(modes, points).argmax(axis=0)
    return [np.flatnonzero(nearest == k) for k in range(len(modes))]


def balanced(
    log_weight: FloatArray, cells: list[Cell], doubtful: NDArray[np.bool_], d: int
) -> FloatArray:
    """Return weights (J,) by which proposals are shaped, cell by cell.

    A cell with a bad tail gets a fair share: how much lies there is not known yet, and more points
    are how it comes to be. The weights of too few effective points are evened out by a power.
    """
    out = np.exp(log_weight - special.logsumexp(log_weight))
    for cell, doubted in zip(cells, doubtful, strict=True):
        if np.isfinite(log_weight[cell]).any():
            fair = 0.5 / len(cells) if doubted and len(cells) > 1 else 0.0
            share = max(out[cell].sum(), fair)
            out[cell] = share * _evened(log_weight[cell], SETTINGS.shaping * d)
    return out / out.sum()


def _evened(log_weight: FloatArray, least: float) -> FloatArray:
    """Return normalised weights to the largest power up to one with so many effective points."""
    low, high = 0.0, 2.0
    for _ in range(SETTINGS.proposal_halvings):
        power = 0.5 * (low + high)
        weight: FloatArray = special.softmax(power * log_weight)
        if 1 / np.sum(weight**2) < least:
            high = power
        elif power == 1.0:
            break
        else:
            low = power
    return weight


def matched(points: FloatArray, weight: FloatArray, components: list[Gaussian]) -> list[Gaussian]:
    """Return each component moved to the moments of the points that it is responsible for."""
    share = _responsible(points, weight, components)
    mass = share.sum(axis=1)
    moved = [
        moment_match(points, own / m, g) if m > SETTINGS.least_share else g
        for own, m, g in zip(share, mass, components, strict=True)
    ]
    return [
        replace(g, log_mass=float(np.log(max(m, SETTINGS.least_share))))
        for g, m in zip(moved, mass, strict=True)
    ]


def slices(points: FloatArray, weight: FloatArray, components: list[Gaussian]) -> list[Gaussian]:
    """Return proposals along each component: slices of its points across their longest axis."""
    out = []
    for own, g in zip(_responsible(points, weight, components), components, strict=True):
        if own.sum() <= SETTINGS.least_share:
            continue
        axis = np.linalg.eigh(g.factor @ g.factor.T)[1][:, -1]
        order = np.argsort(points @ axis)
        part = np.minimum(
            SETTINGS.slices * np.cumsum(own[order]) / own.sum(), SETTINGS.slices - 1
        ).astype(int)
        for k in range(SETTINGS.slices):
            inside = order[part == k]
            m = own[inside].sum()
            if m > SETTINGS.least_share:
                one = moment_match(points[inside], own[inside] / m, g)
                out.append(replace(one, log_mass=float(np.log(m))))
    return out


def _responsible(points: FloatArray, weight: FloatArray, components: list[Gaussian]) -> FloatArray:
    """Share the weights of points (J,) among components, (K, J)."""
    mass = np.array([g.log_mass for g in components])
    log_terms = mass[:, None] + student_log_density(components, points)
    return weight * np.exp(log_terms - np.logaddexp.reduce(log_terms, axis=0))


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
