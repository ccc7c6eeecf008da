"""Ridges: thin, bent curves along which a density hardly falls, straightened by a shear.

Precise data may tell two unknowns together, as an amplitude and a gain by their product, and only
the priors tell them apart. The others then follow one of them on a curve m(s), a hundred thousand
times as long as it is thick: a Gaussian leaves it after sqrt(thickness / curvature). With
v = (s, others - m(s)), a map of unit Jacobian, it lies along an axis.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import special
from scipy.interpolate import CubicSpline

from hybridsurrogate.inference.sampling.modes import Gaussian, distinct, factors, optimise
from hybridsurrogate.inference.sampling.settings import SETTINGS
from hybridsurrogate.inference.sampling.target import Target
from hybridsurrogate.priors import FloatArray


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
        """Tell whether a point u (d,) is on the curve, as far as the others scatter around it."""
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

    It is followed from point to point: the next is extrapolated, then optimised.
    """
    covariance = mode.factor @ mode.factor.T
    # log sigma, the last, is never exchanged for another unknown
    position = int(np.argmax(np.diag(covariance)[:-1]))
    others = np.arange(len(mode.mean)) != position
    spacing = min(
        SETTINGS.ridge_spacing,
        SETTINGS.ridge_share * float(np.sqrt(covariance[position, position])),
    )
    slope = covariance[others, position] / covariance[position, position]
    ahead = _followed(target, mode.mean, position, slope, spacing)
    behind = _followed(target, mode.mean, position, slope, -spacing)
    s, x, value, hessian = (
        np.concatenate([b[:0:-1], a]) for b, a in zip(behind, ahead, strict=True)
    )
    if len(s) < 4:
        return None
    factor = factors(hessian)
    # Laplace in the others at each point of the curve
    log_mass = value + np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1)
    share = special.softmax(log_mass)
    mean = np.zeros(len(mode.mean))
    mean[position] = share @ s
    whole = np.zeros_like(covariance)
    whole[position, position] = np.sqrt(share @ (s - mean[position]) ** 2)
    whole[np.ix_(others, others)] = factor[np.abs(s - mean[position]).argmin()]
    return Ridge(position, CubicSpline(s, x), Gaussian(mean, whole))


def _followed(
    target: Target,
    mode: FloatArray,
    position: int,
    slope: FloatArray,
    spacing: float,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return s (K,), others (K, r), log densities and Hessians (K, r, r), the mode's the first."""
    start = np.delete(mode, position)
    s, x = [mode[position]], [start]
    _, value, hessian = _climbed(target, position, s[0], start, SETTINGS.mode_steps)
    values, hessians = [value], [hessian]
    while (
        abs(s[-1] + spacing) < SETTINGS.prior_end and values[-1] > max(values) - SETTINGS.ridge_deep
    ):
        near = x[-SETTINGS.ridge_near :]
        # a polynomial through the last points; its first slope is that of the approximation
        ahead = start + spacing * slope if len(near) == 1 else _extrapolated(near)
        found, value, hessian = _climbed(
            target, position, s[-1] + spacing, ahead, SETTINGS.mode_steps
        )
        if not np.isfinite(value):
            break
        s.append(s[-1] + spacing)
        x.append(found)
        values.append(value)
        hessians.append(hessian)
    return np.array(s), np.array(x), np.array(values), np.array(hessians)


def _extrapolated(x: list[FloatArray]) -> FloatArray:
    """Return the polynomial through evenly spaced points one further: a sum of differences."""
    return sum((np.diff(x, k, axis=0)[-1] for k in range(len(x))), np.zeros_like(x[0]))


def _climbed(
    target: Target, position: int, s: float, others: FloatArray, most: int
) -> tuple[FloatArray, float, FloatArray]:
    """Return where the others end, optimised with one unknown at s, log density and Hessian."""

    def along(points: FloatArray, _: NDArray[np.intp]) -> FloatArray:
        return target.search_density(np.insert(points, position, s, axis=1))

    value = along(others[None], np.zeros(1, dtype=int))
    if not np.isfinite(value[0]):
        return others, -np.inf, np.zeros((len(others), len(others)))
    steps = target.step_share, most, False, target.model.least_step
    x, value, hessian = optimise(along, others[None], value, *steps)
    return x[0], float(value[0]), hessian[0]
