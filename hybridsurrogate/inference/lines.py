"""Proposals along an unknown in which a density is far from normal: the place of a jump.

Between two measured rows the place of a step changes nothing, so its posterior has plateaus of
unequal height, which no Gaussian around a mode describes.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy import special

from hybridsurrogate.inference.collapsed import CollapsedPosterior
from hybridsurrogate.inference.laplace import LaplacePosterior
from hybridsurrogate.inference.measured import MeasuredModel
from hybridsurrogate.inference.modes import Gaussian, distinct
from hybridsurrogate.priors import FloatArray, to_normal

# points on a line: windows around the mode, each twice as wide as the one before
_WINDOWS, _POINTS = 14, 33
_END = 6.5
# total variation distance to the normal from which on it is a poor proposal
_FAR_FROM_NORMAL = 0.25
_BINS = 40
# a bin with less than this share of the mass is proposed as often as one that has it: what the
# profile sees little of, with the other unknowns held, may have more where they follow
_LEAST_MASS = 1e-3
# share of a bin's width that is its proposal's standard deviation
_BIN_SD = 0.6


class Line(NamedTuple):
    """A mode and what is proposed around it: itself, or narrow Gaussians along one unknown."""

    mode: Gaussian
    proposals: list[Gaussian]
    position: int | None = None


def with_lines(target: CollapsedPosterior | LaplacePosterior, modes: list[Gaussian]) -> list[Line]:
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
            nodes = to_normal([prior], np.asarray(grids[owner][name], dtype=float)[:, None])
            out.append((position, np.clip(nodes[:, 0], -_END, _END)))
    return out


def _line(
    target: CollapsedPosterior | LaplacePosterior,
    mode: Gaussian,
    places: list[tuple[int, FloatArray]],
) -> Line:
    """Return proposals along the unknown in which the density is farthest from normal, if any."""
    worst, out = _FAR_FROM_NORMAL, Line(mode, [mode])
    covariance = mode.factor @ mode.factor.T
    precision = np.linalg.inv(covariance)
    for position, nodes in places:
        # with the others held: how the density falls off where they follow is the mode's affair
        sd = float(precision[position, position] ** -0.5)
        edges, log_mass = _profile(target, mode, position, nodes, sd)
        share = np.exp(log_mass - special.logsumexp(log_mass))
        normal = np.diff(special.ndtr((edges - mode.mean[position]) / sd))
        distance = 0.5 * float(np.abs(share - normal).sum())
        if distance > worst:
            bins = _bins(mode, covariance, position, edges, log_mass)
            mass = special.logsumexp([part.log_mass for part in bins])
            whole = replace(mode, log_mass=float(mass))
            worst, out = distance, Line(whole, bins, position)
    return out


def _profile(
    target: CollapsedPosterior | LaplacePosterior,
    mode: Gaussian,
    position: int,
    nodes: FloatArray,
    sd: float,
) -> tuple[FloatArray, FloatArray]:
    """Return edges (m + 1,) of cells along one unknown and log masses (m,), the others held."""
    offsets = sd * 2.0 ** np.arange(_WINDOWS)[:, None] * np.linspace(-1, 1, _POINTS)
    z = np.concatenate([mode.mean[position] + offsets.ravel(), nodes])
    z = np.unique(z[np.abs(z) <= _END])
    points = np.tile(mode.mean, (len(z), 1))
    points[:, position] = z
    value = target.search_density(points)
    edges = np.concatenate([[z[0]], 0.5 * (z[1:] + z[:-1]), [z[-1]]])
    with np.errstate(divide="ignore"):
        return edges, value + np.log(np.diff(edges))


def _bins(
    mode: Gaussian,
    covariance: FloatArray,
    position: int,
    edges: FloatArray,
    log_mass: FloatArray,
) -> list[Gaussian]:
    """Return proposals along one unknown, which the others do not depend on.

    Bins are closer where there is mass, and close enough elsewhere: a narrow plateau in a wide bin
    would get draws of great weight.
    """
    total = float(special.logsumexp(log_mass))
    cells = np.exp(log_mass - total)
    root = np.sqrt(cells)
    cumulative = np.concatenate([[0.0], np.cumsum(0.5 * cells + 0.5 * root / root.sum())])
    at = np.interp(np.linspace(0, 1, _BINS + 1), cumulative / cumulative[-1], edges)
    mass = np.diff(np.interp(at, edges, np.concatenate([[0.0], np.cumsum(cells)])))
    log_share = np.log(np.maximum(mass, _LEAST_MASS))
    others = np.arange(len(mode.mean)) != position
    slope = covariance[others, position] / covariance[position, position]
    rest = covariance[np.ix_(others, others)] - np.outer(slope, covariance[position, others])
    rest_factor = np.linalg.cholesky(rest + 1e-12 * np.trace(rest) * np.eye(len(rest)))
    log_rest = np.log(np.diagonal(rest_factor)).sum() + 0.5 * len(rest) * np.log(2 * np.pi)
    narrowest = 1e-6 * (at[-1] - at[0])
    out = []
    for (low, high), log_part in zip(pairwise(at), log_share, strict=True):
        mean, factor = mode.mean.copy(), np.zeros_like(mode.factor)
        mean[position] = 0.5 * (low + high)
        factor[position, position] = max(_BIN_SD * (high - low), narrowest)
        factor[np.ix_(others, others)] = rest_factor
        out.append(Gaussian(mean, factor, total + float(log_rest + log_part)))
    return out


def _is_on(line: Line, mode: Gaussian) -> bool:
    """Tell whether a mode differs from that of a line only along it."""
    if line.position is None:
        return False
    mean = mode.mean.copy()
    mean[line.position] = line.mode.mean[line.position]
    return len(distinct([line.mode, replace(mode, mean=mean)])) == 1
