"""Step 2 where each draw of the coefficients has a narrow posterior at a different place.

Proposals that all draws share are too few there. Newton steps of all draws at once go from a start
to the mode of each, and importance weights are given to some proposals around it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.inference.conditional.pairwise_squares import (
    MeasuredGiven,
    node_shares,
    one_node_each,
)
from hybridsurrogate.inference.sampling.modes import factors, optimise_density
from hybridsurrogate.inference.sampling.proposals import (
    PROPOSAL_SCALE,
    standard_student,
    standard_student_draws,
)
from hybridsurrogate.inference.sampling.settings import SETTINGS
from hybridsurrogate.model.prior_density import prior_of_unknowns
from hybridsurrogate.model.statistics import ROUNDING
from hybridsurrogate.numerics.blocks import blocks
from hybridsurrogate.numerics.cholesky import log_det_of, nudged_cholesky
from hybridsurrogate.numerics.psis import level_smooth
from hybridsurrogate.types import FloatArray

_IMPOSSIBLE = -1e300


class OwnDraws(NamedTuple):
    """Points u for each coefficient draw, and how well the proposals suit them.

    Attributes
    ----------
    u : ndarray of shape (S, d)
    khat : float
        Median Pareto shape over draws.
    effective : float
        Median number of proposals that share a draw's weight.
    """

    u: FloatArray
    khat: float
    effective: float


def own_draws(
    problem: MeasuredGiven,
    starts: FloatArray,
    random_state: np.random.RandomState,
) -> OwnDraws:
    """Draw u = [z, log sigma] given each coefficient draw.

    Parameters
    ----------
    starts : ndarray of shape (M, S, d)
        M places for each draw, of which the likeliest is taken.
    """

    def log_density(u: FloatArray, which: NDArray[np.intp]) -> FloatArray:
        return log_density_of_pairs(problem, u, which)

    M, S, d = starts.shape
    value = log_density(starts.reshape(-1, d), np.tile(np.arange(S), M)).reshape(M, S)
    first = value.argmax(axis=0), np.arange(S)
    # a start where the simulation fails stays where it is
    value = np.maximum(value[first], _IMPOSSIBLE)
    mode, _, hessian = optimise_density(
        log_density,
        starts[first],
        value,
        SETTINGS.follow_share,
        SETTINGS.follow_steps,
        prune=False,
    )
    factor = PROPOSAL_SCALE * factors(hessian)
    scaled = standard_student_draws((SETTINGS.proposals_each, S, d), random_state)
    points = mode + np.einsum("sij,msj->msi", factor, scaled)
    log_weight = log_density(points.reshape(-1, d), np.tile(np.arange(S), SETTINGS.proposals_each))
    log_weight = log_weight.reshape(SETTINGS.proposals_each, S) - standard_student(
        np.sum(scaled**2, axis=2), d
    )
    share = node_shares(log_weight)
    pick = one_node_each(share, random_state)
    some = np.unique(np.linspace(0, S - 1, min(S, 100)).astype(int))
    khat = float(np.median([level_smooth(log_weight[:, s])[1] for s in some]))
    effective = float(np.median(1 / np.sum(share**2, axis=0)))
    return OwnDraws(points[pick, np.arange(S)], khat, effective)


def log_density_of_pairs(
    problem: MeasuredGiven, u: FloatArray, which: NDArray[np.intp]
) -> FloatArray:
    """Return the log density of points u (K, d), each given one coefficient draw, (K,).

    The causes' coefficients a ~ N(0, diag(sd^2)) are integrated out by Woodbury's identity.
    """
    rows = problem.features_and_rest
    n = len(problem.y if rows is None else rows[1])
    numbers = n * (1 + len(problem.model.column_sd))
    return np.concatenate(
        [_log_density(problem, u[some], problem.c[which[some]]) for some in blocks(len(u), numbers)]
    )


def _log_density(problem: MeasuredGiven, u: FloatArray, c: FloatArray) -> FloatArray:
    model, weights = problem.model, problem.weights
    sigma, values = np.exp(u[:, -1]), model.values(u[:, :-1])
    rows = problem.features_and_rest
    if rows is None:
        output, noise = model.outputs(problem.X, values, c)
        scale = noise * sigma[:, None]
        residual = (problem.y - output) * np.sqrt(weights) / scale
        log_det = np.log(np.broadcast_to(scale, residual.shape)) @ weights
        columns = model.added(problem.X, values) * model.column_sd
        columns = columns * (np.sqrt(weights) / scale)[..., None]
    else:
        of_inputs, rest = rows
        fitted = (problem.parameters_part(values) * c) @ of_inputs.T
        residual = (rest - fitted) / sigma[:, None]
        log_det = u[:, -1] * weights.sum()
        columns = problem.columns(values) / sigma[:, None, None]
    squares = np.sum(residual**2, axis=1)
    if len(model.column_sd):
        transposed = np.swapaxes(columns, 1, 2)
        factor = nudged_cholesky(np.eye(len(model.column_sd)) + transposed @ columns)
        log_det = log_det + log_det_of(factor)
        half = np.linalg.solve(factor, transposed @ residual[..., None])[..., 0]
        squares = np.maximum(squares - np.sum(half**2, axis=1), 0.0)
    squares += weights.sum() * (ROUNDING * problem.scale / sigma) ** 2
    out = prior_of_unknowns(u, problem.noise_prior) - log_det - 0.5 * squares
    return np.where(np.isfinite(out), out, -np.inf)
