"""Proposals along an unknown in which a density is far from normal: the place of a jump.

Between two measured rows the place of a step changes nothing, so its posterior has plateaus of
unequal height, which no Gaussian around a mode describes.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from hybridsurrogate.inference.sampling.modes import Gaussian, distinct
from hybridsurrogate.inference.sampling.settings import SETTINGS
from hybridsurrogate.inference.sampling.target import Target
from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.priors import to_normal
from hybridsurrogate.types import FloatArray


class Line(NamedTuple):
    """A mode and what is proposed around it: itself, or narrow Gaussians along one unknown."""

    mode: Gaussian
    proposals: list[Gaussian]
    position: int | None = None


def with_lines(target: Target, modes: list[Gaussian]) -> list[Line]:
    """Return the proposals around each mode; modes on the line of a better one go.

    Parameters
    ----------
    target : posterior
    modes : list of Gaussian
        The largest mass first.
    """
    out: list[Line] = []
    places = enumerated(target.model)
    for mode in modes:
        if not any(_is_on(line, mode) for line in out):
            out.append(_line(target, mode, places))
    return out


def enumerated(model: MeasuredModel) -> list[tuple[int, FloatArray]]:
    """Return the position in z and the nodes, as z, of each unknown that causes enumerate."""
    grids = [effect.grid() for effect in model.effects]
    out = []
    for position, (owner, name) in enumerate(model.theta_names, start=model.n_parameters):
        if name in grids[owner]:
            prior = model.priors[position]
            nodes = np.asarray(grids[owner][name], dtype=float)
            nodes = nodes.reshape(len(nodes), -1).mean(axis=1, keepdims=True)
            nodes = to_normal([prior], nodes)
            out.append((position, np.clip(nodes[:, 0], -SETTINGS.prior_end, SETTINGS.prior_end)))
    return out


def _line(
    target: Target,
    mode: Gaussian,
    places: list[tuple[int, FloatArray]],
) -> Line:
    """Return proposals along the unknown in which the density is farthest from normal, if any."""
    worst, chosen = SETTINGS.far_from_normal, None
    precision = np.linalg.inv(mode.factor @ mode.factor.T)
    for position, nodes in places:
        # with the others held: how the density falls off where they follow is the mode's affair
        sd = float(precision[position, position] ** -0.5)
        z = _points_around(mode.mean[position], sd, nodes)
        value = target.search_density(_between(mode.mean[None], position, z))
        edges, log_mass = _cells(z, value)
        share = np.exp(log_mass - special.logsumexp(log_mass))
        normal = np.diff(special.ndtr((edges - mode.mean[position]) / sd))
        distance = 0.5 * float(np.abs(share - normal).sum())
        if distance > worst:
            worst, chosen = distance, (position, nodes, z)
    if chosen is None:
        return Line(mode, [mode])
    bins = _bins(target, mode, *chosen)
    mass = special.logsumexp([part.log_mass for part in bins])
    return Line(replace(mode, log_mass=float(mass)), bins, chosen[0])


def _points_around(centre: float, sd: float, nodes: FloatArray) -> FloatArray:
    """Return points on a line, close around the centre, with the nodes between them."""
    offsets = (
        sd
        * 2.0 ** np.arange(SETTINGS.windows)[:, None]
        * np.linspace(-1, 1, SETTINGS.window_points)
    )
    z = np.concatenate([centre + offsets.ravel(), nodes])
    return np.unique(z[np.abs(z) <= SETTINGS.prior_end])


def _cells(z: FloatArray, value: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return edges (m + 1,) of cells around points of a line and their log masses (m,)."""
    edges = np.concatenate([[z[0]], 0.5 * (z[1:] + z[:-1]), [z[-1]]])
    with np.errstate(divide="ignore"):
        return edges, value + np.log(np.diff(edges))


def _refined(
    target: Target,
    ridge: FloatArray,
    position: int,
    z: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return points along one unknown and their log densities, close where these change.

    Evenly over the prior too, the other unknowns on the ridge.
    """
    z = np.union1d(z, special.ndtri((np.arange(SETTINGS.even_points) + 0.5) / SETTINGS.even_points))
    value = target.search_density(_between(ridge, position, z))
    for _ in range(SETTINGS.line_halvings):
        with np.errstate(invalid="ignore"):
            steep = np.abs(np.diff(value)) > SETTINGS.steep
        steep &= np.maximum(value[1:], value[:-1]) > value.max() - SETTINGS.line_deep
        middle = 0.5 * (z[1:] + z[:-1])[steep]
        if not len(middle):
            break
        at = np.flatnonzero(steep) + 1
        value = np.insert(value, at, target.search_density(_between(ridge, position, middle)))
        z = np.insert(z, at, middle)
    return z, value


def _between(ridge: FloatArray, position: int, z: FloatArray) -> FloatArray:
    """Return points with one unknown at z, the others interpolated between points of a ridge."""
    at = ridge[:, position]
    others = (np.interp(z, at, ridge[:, k]) for k in range(ridge.shape[1]))
    return np.column_stack([z if k == position else other for k, other in enumerate(others)])


def _bins(
    target: Target,
    mode: Gaussian,
    position: int,
    nodes: FloatArray,
    z: FloatArray,
) -> list[Gaussian]:
    """Return proposals along one unknown, each around where the others are most probable there.

    Bins are closer where there is mass and where the density rises or falls, and close enough
    elsewhere: the end of a plateau in a wide bin would get draws of great weight.
    """
    covariance = mode.factor @ mode.factor.T
    others = np.arange(len(mode.mean)) != position
    slope = covariance[others, position] / covariance[position, position]
    rest = covariance[np.ix_(others, others)] - np.outer(slope, covariance[position, others])
    rest_factor = np.linalg.cholesky(rest + 1e-12 * np.trace(rest) * np.eye(len(rest)))
    start = np.unique(
        np.append(nodes[:: -(-len(nodes) // SETTINGS.followed_nodes)], mode.mean[position])
    )
    straight = _between(mode.mean[None], position, start)
    ridge, _, _ = _followed(target, straight, others, rest_factor)
    at = _bin_edges(*_cells(*_refined(target, ridge, position, z)))
    middles = _between(ridge, position, 0.5 * (at[1:] + at[:-1]))
    means, value, width = _followed(target, middles, others, rest_factor)
    spread = np.maximum(SETTINGS.bin_sd * np.diff(at), 1e-6 * (at[-1] - at[0]))
    volume = np.log(np.diagonal(rest_factor) * width).sum(axis=1)
    mass = value + np.log(spread / SETTINGS.bin_sd) + volume + 0.5 * len(rest) * np.log(2 * np.pi)
    mass = np.maximum(mass, special.logsumexp(mass) + np.log(SETTINGS.bin_least_mass))
    factors = np.zeros((SETTINGS.bins, *mode.factor.shape))
    factors[:, position, position] = spread
    factors[np.ix_(np.arange(SETTINGS.bins), others, others)] = rest_factor * width[:, None, :]
    return [
        Gaussian(mean, factor, float(log_mass))
        for mean, factor, log_mass in zip(means, factors, mass, strict=True)
    ]


def _bin_edges(edges: FloatArray, log_mass: FloatArray) -> FloatArray:
    """Return the edges of bins, shared by mass, its root, changes of the density and the prior."""
    cells = np.exp(log_mass - special.logsumexp(log_mass))
    root, height = np.sqrt(cells), np.sqrt(cells / np.diff(edges))
    rise = np.abs(np.diff(height, prepend=0.0)) + np.abs(np.diff(height, append=0.0))
    share = (cells + root / root.sum() + rise / rise.sum() + np.diff(special.ndtr(edges))) / 4
    cumulative = np.concatenate([[0.0], np.cumsum(share)])
    return np.interp(np.linspace(0, 1, SETTINGS.bins + 1), cumulative / cumulative[-1], edges)


def _followed(
    target: Target,
    points: FloatArray,
    others: NDArray[np.bool_],
    rest_factor: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return points (B, d) moved uphill in the other unknowns, log densities, and widths (B, r).

    Newton steps with a diagonal Hessian in the coordinates in which the others are standard normal
    around the mode; widths are standard deviations in these coordinates.
    """
    r, step = len(rest_factor), target.step_share
    offsets = np.zeros((2 * r, points.shape[1]))
    offsets[:, others] = step * np.concatenate([rest_factor.T, -rest_factor.T])
    value = target.search_density(points)
    curvature = np.ones((len(points), r))
    reach = np.ones(len(points))
    for _ in range(SETTINGS.following_steps):
        around = (points[:, None] + offsets).reshape(-1, points.shape[1])
        plus, minus = np.split(target.search_density(around).reshape(len(points), -1), 2, axis=1)
        with np.errstate(invalid="ignore"):
            slope = (plus - minus) / (2 * step)
            bend = (2 * value[:, None] - plus - minus) / step**2
        known = np.isfinite(slope) & np.isfinite(bend)
        curvature = np.where(known, np.clip(np.abs(bend), 0.2, 25.0), curvature)
        move = np.where(known, slope / curvature, 0.0)
        move *= np.minimum(1.0, 2.0 / np.maximum(np.linalg.norm(move, axis=1), 1e-300))[:, None]
        trial = points.copy()
        trial[:, others] += reach[:, None] * move @ rest_factor.T
        reached = target.search_density(trial)
        better = reached > value
        points, value = np.where(better[:, None], trial, points), np.where(better, reached, value)
        reach = np.where(better, 1.0, 0.3 * reach)
    return points, value, curvature**-0.5


def _is_on(line: Line, mode: Gaussian) -> bool:
    """Return whether a mode differs from that of a line only along it."""
    if line.position is None:
        return False
    mean = mode.mean.copy()
    mean[line.position] = line.mode.mean[line.position]
    return len(distinct([line.mode, replace(mode, mean=mean)])) == 1
