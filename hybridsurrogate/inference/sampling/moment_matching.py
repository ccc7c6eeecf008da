"""Draws of one density turned into draws of a neighbouring one."""

from __future__ import annotations

import numpy as np
from scipy import special

from hybridsurrogate.inference.sampling.adaptive_importance import (
    ImportanceDraws,
    Proposals,
    log_mean,
    systematic_resample,
)
from hybridsurrogate.inference.sampling.modes import LogDensity
from hybridsurrogate.inference.sampling.settings import SETTINGS
from hybridsurrogate.numerics.psis import KHAT_LIMIT, pareto_smooth
from hybridsurrogate.types import FloatArray


def matched_draws(
    log_density: LogDensity,
    proposals: Proposals,
    n_draws: int,
    random_state: np.random.RandomState,
    n_noise: int = 0,
) -> ImportanceDraws:
    """Draw from a density through proposals made for another, moved by moment matching.

    Affine maps of the proposals towards the weighted moments, one after the other (mean, scales,
    covariance), each kept where it makes k-hat smaller (Paananen, Piironen, Burkner and Vehtari
    2021, Statistics and Computing 31:16, algorithm 2).

    Parameters
    ----------
    log_density : callable
    proposals : Proposals
    n_draws : int
    random_state : RandomState
    n_noise : int, default=0
        Dimensions at the end that are standard normal in the proposals and stay as they are.

    Returns
    -------
    ImportanceDraws
        Its k-hat shows whether the draws are reliable.
    """
    d = proposals.points.shape[1] - n_noise
    log_weight = log_density(proposals.points) - proposals.log_density
    smoothed, khat = pareto_smooth(log_weight)
    for k in range(SETTINGS.max_transforms):
        weight = np.exp(smoothed - special.logsumexp(smoothed))
        effective = 1 / np.sum(weight**2)
        if khat <= KHAT_LIMIT and effective >= SETTINGS.enough_matched * len(weight):
            break
        moved = _moved(proposals, weight, d, ("mean", "scales", "covariance")[k % 3])
        new_weight = log_density(moved.points) - moved.log_density
        new_smoothed, new_khat = pareto_smooth(new_weight)
        if new_khat < khat:
            proposals, log_weight, smoothed, khat = moved, new_weight, new_smoothed, new_khat
    weight = np.exp(smoothed - special.logsumexp(smoothed))
    index = systematic_resample(weight, n_draws, random_state)
    return ImportanceDraws(
        proposals.points[index],
        khat,
        float(1 / np.sum(weight**2)),
        *log_mean(log_weight),
        proposals,
    )


def _moved(proposals: Proposals, weight: FloatArray, d: int, how: str) -> Proposals:
    """Return proposals mapped so that their plain moments are their weighted ones."""
    points = proposals.points[:, :d]
    plain, target = points.mean(axis=0), weight @ points
    factor: FloatArray = np.eye(d)
    if how != "mean":
        wanted = ((points - target) * weight[:, None]).T @ (points - target)
        present = np.cov(points.T, bias=True).reshape(d, d)
        if how == "scales" or np.linalg.eigvalsh(wanted)[0] < 1e-10 * np.trace(wanted):
            factor = np.diag(np.sqrt(np.diag(wanted) / np.diag(present)))
        else:
            factor = np.linalg.cholesky(wanted) @ np.linalg.inv(np.linalg.cholesky(present))
    out = proposals.points.copy()
    out[:, :d] = target + (points - plain) @ factor.T
    return Proposals(out, proposals.log_density - np.linalg.slogdet(factor)[1])
