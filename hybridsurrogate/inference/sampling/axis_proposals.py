"""Proposals for densities that are far from normal: along one unknown, along bent ridges.

A ridge: precise data may determine only a function of two unknowns, as the product of an amplitude
and a gain. Only the priors distinguish them. The others then follow one of them on a curve m(s), a
hundred thousand times as long as it is thick: a Gaussian leaves it after sqrt(thickness /
curvature). With v = (s, others - m(s)), a map of unit Jacobian, it lies along an axis.

Between two measured rows the place of a step changes nothing, so its posterior has plateaus of
unequal height, which no Gaussian around a mode describes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special
from scipy.interpolate import CubicSpline

from hybridsurrogate.inference.conjugate.target import Target
from hybridsurrogate.inference.sampling.modes import (
    STEP_SHARE,
    Gaussian,
    distinct,
    factors,
    optimise_density,
)
from hybridsurrogate.inference.sampling.settings import SETTINGS
from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.numerics.linear_algebra import NEGLIGIBLE, SINGULAR
from hybridsurrogate.priors import Z_LIMIT, to_normal
from hybridsurrogate.types import FloatArray


@dataclass(frozen=True)
class Ridge:
    """The curve on which the others follow one unknown.

    Attributes
    ----------
    position : int
        Of that unknown among all d.
    curve : CubicSpline
        m(s), (d - 1,) at each s between its first and last node.
    approximation : Gaussian
        Of the density in v.
    """

    position: int
    curve: CubicSpline
    approximation: Gaussian

    def is_on(self, u: FloatArray) -> bool:
        """Return whether a point u (d,) is on the curve, within the scatter of the others."""
        v = 2 * u - self.points(u[None])[0]
        return _differs_along(self.approximation, v, self.position)

    def points(self, v: FloatArray) -> FloatArray:
        """Return the points u (J, d) of straight coordinates v (J, d)."""
        u = v.copy()
        s = np.clip(v[:, self.position], self.curve.x[0], self.curve.x[-1])
        u[:, np.arange(v.shape[1]) != self.position] += self.curve(s)
        return u


def elongation(mode: Gaussian) -> float:
    """Return how many times as long as thick a Gaussian is."""
    singular = np.linalg.svd(mode.factor, compute_uv=False)
    return float(singular[0] / singular[-1])


def ridge_through(target: Target, mode: Gaussian) -> Ridge | None:
    """Return the ridge through a mode along the unknown of which least is known; None without one.

    It is followed to both sides at once: the next point is extrapolated, then optimised. Points are
    further apart where extrapolation is good (predictor and corrector with adaptive steps: Allgower
    and Georg 1990, Numerical Continuation Methods, chapter 6).
    """
    covariance = mode.factor @ mode.factor.T
    # of those that are exchanged for others, known far better given these than alone, as what is
    # loose by itself is not; log sigma, the last, is never exchanged
    variance = np.sum(mode.factor**2, axis=1)[:-1]
    exchanged = variance * np.sum(np.linalg.inv(mode.factor) ** 2, axis=0)[:-1]
    position = int(np.argmax(np.where(exchanged > 0.1 * exchanged.max(), variance, 0.0)))
    others = np.arange(len(mode.mean)) != position
    spread = float(np.sqrt(covariance[position, position]))
    slope = covariance[others, position] / covariance[position, position]
    behind, ahead = _followed_ridge(target, mode.mean, position, slope, spread)
    path = [*behind[:0:-1], *ahead]
    if len(path) < 4:
        return None
    s = np.array([node.s for node in path])
    factor = factors(np.array([node.hessian for node in path]))
    # Laplace in the others at each point of the curve
    log_mass = np.array([node.value for node in path])
    log_mass += np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1)
    even = np.linspace(s[0], s[-1], SETTINGS.bins)
    share = special.softmax(CubicSpline(s, log_mass)(even))
    mean = np.zeros(len(mode.mean))
    mean[position] = share @ even
    whole = np.zeros_like(covariance)
    whole[position, position] = np.sqrt(share @ (even - mean[position]) ** 2)
    whole[np.ix_(others, others)] = factor[np.abs(s - mean[position]).argmin()]
    curve = CubicSpline(s, np.array([node.x for node in path]))
    return Ridge(position, curve, Gaussian(mean, whole, 0.0))


class _Node(NamedTuple):
    """A point of a ridge: s, the others x (r,), log density and Hessian (r, r) in the others."""

    s: float
    x: FloatArray
    value: float
    hessian: FloatArray


def _followed_ridge(
    target: Target, mode: FloatArray, position: int, slope: FloatArray, spread: float
) -> tuple[list[_Node], list[_Node]]:
    """Return the points of a ridge from its mode on, to either side."""
    first = _climbed(target, position, mode[[position]], np.delete(mode, position)[None])[0]
    sides, best = ([first], [first]), first.value
    least = min(SETTINGS.ridge_spacing, spread)
    most, spacing = max(least, spread), [-least, least]
    going = [0, 1]
    while going:
        s = np.array([sides[k][-1].s + spacing[k] for k in going])
        guesses = np.array(
            [_extrapolated(sides[k], slope, own) for k, own in zip(going, s, strict=True)]
        )
        found = _climbed(target, position, s, guesses)
        for k, guess, node in zip(tuple(going), guesses, found, strict=True):
            error = _distance(guess, node)
            # where too far was guessed the same is tried from nearer by
            if error > SETTINGS.ridge_missed and abs(spacing[k]) > least:
                spacing[k] = np.sign(spacing[k]) * max(least, 0.5 * abs(spacing[k]))
                continue
            if np.isfinite(node.value):
                sides[k].append(node)
                best = max(best, node.value)
                # of a cubic that is extrapolated twice as far the error is sixteen times as large
                if error < SETTINGS.ridge_missed / 32:
                    spacing[k] = np.sign(spacing[k]) * min(most, 2 * abs(spacing[k]))
                # a mode beyond the end of a prior has no room on that side
                room = max(Z_LIMIT - np.sign(spacing[k]) * node.s, 0.0)
                spacing[k] = np.sign(spacing[k]) * min(abs(spacing[k]), room)
            ended = abs(spacing[k]) < 0.5 * least or node.value < best + np.log(
                SETTINGS.min_mode_share
            )
            if ended or not np.isfinite(node.value):
                going.remove(k)
    return sides


def _distance(guess: FloatArray, node: _Node) -> float:
    """Return how far a guess of a point was off, in standard deviations of the others."""
    if not np.isfinite(node.value):
        return np.inf
    inverse = np.linalg.inv(factors(node.hessian[None])[0])
    return float(np.linalg.norm(inverse @ (node.x - guess)))


def _extrapolated(path: list[_Node], slope: FloatArray, s: float) -> FloatArray:
    """Return the spline through a path beyond its end, at s; the slope beyond the first point."""
    if len(path) == 1:
        return path[0].x + (s - path[0].s) * slope
    known = sorted(path, key=lambda node: node.s)
    out: FloatArray = CubicSpline([node.s for node in known], [node.x for node in known])(s)
    return out


def _climbed(target: Target, position: int, s: FloatArray, others: FloatArray) -> list[_Node]:
    """Return where the others (K, r) end, optimised with one unknown at s (K,)."""
    r = others.shape[1]
    value = target.search_density(np.insert(others, position, s, axis=1))
    finite = np.isfinite(value)
    x, hessian = others.copy(), np.zeros((len(s), r, r))
    held = s[finite]

    def along(points: FloatArray, which: NDArray[np.intp]) -> FloatArray:
        return target.search_density(np.insert(points, position, held[which], axis=1))

    if finite.any():
        x[finite], value[finite], hessian[finite] = optimise_density(
            along, x[finite], value[finite], least_step=target.model.least_step
        )
    value[~finite] = -np.inf
    return [_Node(*one) for one in zip(s.tolist(), x, value.tolist(), hessian, strict=True)]


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
        if not any(
            line.position is not None and _differs_along(line.mode, mode.mean, line.position)
            for line in out
        ):
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
            out.append((position, np.clip(nodes[:, 0], -Z_LIMIT, Z_LIMIT)))
    return out


def _line(
    target: Target,
    mode: Gaussian,
    places: list[tuple[int, FloatArray]],
) -> Line:
    """Return proposals along the unknown in which the density is farthest from normal, if any."""
    worst, chosen = SETTINGS.normality_distance, None
    precision = np.linalg.inv(mode.factor @ mode.factor.T)
    for position, nodes in places:
        # with the others held: how the density falls off where they follow is the mode's affair
        sd = float(precision[position, position] ** -0.5)
        # close around the mode, with the nodes between
        centre = mode.mean[position]
        away = np.geomspace(sd / SETTINGS.bins, 2 * Z_LIMIT, SETTINGS.bins)
        z = np.unique(np.concatenate([centre - away, [centre], centre + away, nodes]))
        z = z[np.abs(z) <= Z_LIMIT]
        edges, log_mass = _cells(z, target.search_density(_along(mode.mean, position, z)))
        share = np.exp(log_mass - special.logsumexp(log_mass))
        normal = np.diff(special.ndtr((edges - mode.mean[position]) / sd))
        distance = 0.5 * float(np.abs(share - normal).sum())
        if distance > worst:
            worst, chosen = distance, (position, edges, log_mass)
    if chosen is None:
        return Line(mode, [mode])
    bins = _bins(target, mode, *chosen)
    mass = special.logsumexp([part.log_mass for part in bins])
    return Line(replace(mode, log_mass=float(mass)), bins, chosen[0])


def _cells(z: FloatArray, value: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return edges (m + 1,) of cells around points of a line and their log masses (m,)."""
    edges = np.concatenate([[z[0]], 0.5 * (z[1:] + z[:-1]), [z[-1]]])
    with np.errstate(divide="ignore"):
        return edges, value + np.log(np.diff(edges))


def _along(point: FloatArray, position: int, z: FloatArray) -> FloatArray:
    """Return a point (d,) with one unknown at each z (m,), shape (m, d)."""
    out = np.tile(point, (len(z), 1))
    out[:, position] = z
    return out


def _bins(
    target: Target,
    mode: Gaussian,
    position: int,
    edges: FloatArray,
    log_mass: FloatArray,
) -> list[Gaussian]:
    """Return proposals along one unknown, each around where the others are most probable there.

    Bins are closer where there is mass and where the density rises or falls, and close enough
    elsewhere: the end of a plateau in a wide bin would get draws of great weight.
    """
    covariance = mode.factor @ mode.factor.T
    others = np.arange(len(mode.mean)) != position
    slope = covariance[others, position] / covariance[position, position]
    rest = covariance[np.ix_(others, others)] - np.outer(slope, covariance[position, others])
    rest_factor = np.linalg.cholesky(rest + SINGULAR * np.trace(rest) * np.eye(len(rest)))
    at = _bin_edges(edges, log_mass)
    middles = _along(mode.mean, position, 0.5 * (at[1:] + at[:-1]))
    means, value, width = _followed(target, middles, others, rest_factor)
    spread = np.maximum(SETTINGS.bin_sd * np.diff(at), NEGLIGIBLE * (at[-1] - at[0]))
    volume = np.log(np.diagonal(rest_factor) * width).sum(axis=1)
    mass = value + np.log(spread / SETTINGS.bin_sd) + volume + 0.5 * len(rest) * np.log(2 * np.pi)
    mass = np.maximum(mass, special.logsumexp(mass) + np.log(SETTINGS.min_mode_share))
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
    r, step = len(rest_factor), STEP_SHARE
    offsets = np.zeros((2 * r, points.shape[1]))
    offsets[:, others] = step * np.concatenate([rest_factor.T, -rest_factor.T])
    value = target.search_density(points)
    curvature = np.ones((len(points), r))
    reach = np.ones(len(points))
    for _ in range(SETTINGS.few_rounds):
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


def _differs_along(mode: Gaussian, mean: FloatArray, position: int) -> bool:
    """Return whether a place differs from a mode only along one unknown, within its scatter."""
    mean = mean.copy()
    mean[position] = mode.mean[position]
    return len(distinct([mode, replace(mode, mean=mean)])) == 1
