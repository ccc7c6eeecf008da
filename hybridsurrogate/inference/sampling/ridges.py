"""Ridges: thin, bent curves along which a density hardly falls, straightened by a shear.

Precise data may determine only a function of two unknowns, as the product of an amplitude and a
gain. Only the priors distinguish them. The others then follow one of them on a curve m(s), a
hundred thousand times as long as it is thick: a Gaussian leaves it after
sqrt(thickness / curvature). With v = (s, others - m(s)), a map of unit Jacobian, it lies along an
axis.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special
from scipy.interpolate import CubicSpline

from hybridsurrogate.inference.sampling.modes import Gaussian, distinct, factors, optimise_density
from hybridsurrogate.inference.sampling.settings import SETTINGS
from hybridsurrogate.inference.sampling.target import Target
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
        v[self.position] = self.approximation.mean[self.position]
        return len(distinct([self.approximation, replace(self.approximation, mean=v)])) == 1

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
    position = _on_ridge(mode.factor)
    others = np.arange(len(mode.mean)) != position
    spread = float(np.sqrt(covariance[position, position]))
    slope = covariance[others, position] / covariance[position, position]
    behind, ahead = _followed(target, mode.mean, position, slope, spread)
    path = [*behind[:0:-1], *ahead]
    if len(path) < 4:
        return None
    s = np.array([node.s for node in path])
    factor = factors(np.array([node.hessian for node in path]))
    # Laplace in the others at each point of the curve
    log_mass = np.array([node.value for node in path])
    log_mass += np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1)
    even = np.linspace(s[0], s[-1], SETTINGS.even_points)
    share = special.softmax(CubicSpline(s, log_mass)(even))
    mean = np.zeros(len(mode.mean))
    mean[position] = share @ even
    whole = np.zeros_like(covariance)
    whole[position, position] = np.sqrt(share @ (even - mean[position]) ** 2)
    whole[np.ix_(others, others)] = factor[np.abs(s - mean[position]).argmin()]
    curve = CubicSpline(s, np.array([node.x for node in path]))
    return Ridge(position, curve, Gaussian(mean, whole))


def _on_ridge(factor: FloatArray) -> int:
    """Return the unknown of which least is known, of those that are exchanged for others.

    These are known far better given the others than alone, as what is loose by itself is not.
    """
    # log sigma, the last, is never exchanged for another unknown
    variance = np.sum(factor**2, axis=1)[:-1]
    precision = np.sum(np.linalg.inv(factor) ** 2, axis=0)[:-1]
    exchanged = variance * precision
    return int(np.argmax(np.where(exchanged > 0.1 * exchanged.max(), variance, 0.0)))


class _Node(NamedTuple):
    """A point of a ridge: s, the others x (r,), log density and Hessian (r, r) in the others."""

    s: float
    x: FloatArray
    value: float
    hessian: FloatArray


def _followed(
    target: Target, mode: FloatArray, position: int, slope: FloatArray, spread: float
) -> tuple[list[_Node], list[_Node]]:
    """Return the points of a ridge from its mode on, to either side."""
    first = _climbed(target, position, mode[[position]], np.delete(mode, position)[None])[0]
    sides, best = ([first], [first]), first.value
    least = min(SETTINGS.ridge_spacing, SETTINGS.ridge_share * spread)
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
                room = max(SETTINGS.prior_end - np.sign(spacing[k]) * node.s, 0.0)
                spacing[k] = np.sign(spacing[k]) * min(abs(spacing[k]), room)
            ended = abs(spacing[k]) < 0.5 * least or node.value < best - SETTINGS.ridge_deep
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
    """Return the polynomial through the last points of a path at s; the slope beyond the first."""
    near = path[-SETTINGS.ridge_near :]
    if len(near) == 1:
        return near[0].x + (s - near[0].s) * slope
    at, out = np.array([node.s for node in near]), np.zeros_like(slope)
    for k, node in enumerate(near):
        # Lagrange
        others = np.delete(at, k)
        out += np.prod((s - others) / (at[k] - others)) * node.x
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
        steps = target.step_share, SETTINGS.mode_steps, False, target.model.least_step
        x[finite], value[finite], hessian[finite] = optimise_density(
            along, x[finite], value[finite], *steps
        )
    value[~finite] = -np.inf
    return [_Node(*one) for one in zip(s.tolist(), x, value.tolist(), hessian, strict=True)]
