"""Step 2 by moves: one Markov chain for each coefficient draw, all moved at once.

For a measured world without a grid or a closed form. Chains start from a shared pool, drawn with
weights by each chain's density. They move by differences between chains of the other half
(differential evolution, Ter Braak 2006, Statistics and Computing 16:239). The halves take turns, so
each update leaves the product of all conditional posteriors invariant.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hybridsurrogate.inference.sampling.modes import PairLogDensity
from hybridsurrogate.inference.sampling.settings import SETTINGS
from hybridsurrogate.types import FloatArray


class Effort(NamedTuple):
    """How many moves each chain makes, and how many starts it chooses from besides its own."""

    steps: int = SETTINGS.evolution_steps
    pool: int = SETTINGS.population


# from places near the answer; from draws of it
FROM_NEAR, FROM_DRAWS = Effort(), Effort(30, 0)


@dataclass(frozen=True)
class Moved:
    """Where the chains ended.

    Attributes
    ----------
    points : ndarray of shape (S, d)
    accepted : float
        Median over chains of the number of accepted moves.
    """

    points: FloatArray
    accepted: float


def moved_draws(
    log_density: PairLogDensity,
    start: FloatArray,
    random_state: np.random.RandomState,
    effort: Effort = FROM_NEAR,
) -> Moved:
    """Draw from the conditional density of each chain.

    Parameters
    ----------
    log_density : callable
    start : ndarray of shape (S, d)
        Draws near the answer, one for each chain; some of them also make the shared pool.
    random_state : RandomState
    effort : Effort

    Returns
    -------
    Moved
    """
    S = len(start)
    points, value = _best_of_pool(log_density, start, random_state, effort.pool)
    accepted = np.zeros(S)
    halves = np.array_split(random_state.permutation(S), 2)
    for step in range(effort.steps):
        for mine, other in (halves, halves[::-1]):
            trial = points[mine] + differences(points[other], len(mine), random_state, step)
            new = log_density(trial, mine)
            with np.errstate(invalid="ignore"):  # both may be minus infinity
                take = np.log(random_state.uniform(size=len(mine))) < new - value[mine]
            points[mine[take]], value[mine[take]] = trial[take], new[take]
            accepted[mine[take]] += 1
    return Moved(points, float(np.median(accepted)))


def _best_of_pool(
    log_density: PairLogDensity, start: FloatArray, random_state: np.random.RandomState, n: int
) -> tuple[FloatArray, FloatArray]:
    """Return for each chain its own start or one of a pool of n, by their densities."""
    S = len(start)
    chains = np.arange(S)
    pool = start[random_state.choice(S, min(n, S), replace=False)]
    value = np.stack(
        [log_density(start, chains)]
        + [log_density(np.tile(member, (S, 1)), chains) for member in pool]
    )
    if n == 0:
        return start.copy(), value[0]
    # Gumbel's trick: the maximum of log weight + Gumbel noise is a draw by weight
    noisy = value + random_state.gumbel(size=value.shape)
    pick = np.where(np.isfinite(value), noisy, -np.inf).argmax(axis=0)
    points = np.where((pick == 0)[:, None], start, pool[np.maximum(pick - 1, 0)])
    return points, value[pick, chains]


def differences(
    others: FloatArray, n: int, random_state: np.random.RandomState, step: int
) -> FloatArray:
    """Return n moves: scaled differences of two other chains, every tenth step of full length."""
    d = others.shape[1]
    first = random_state.randint(len(others), size=n)
    second = random_state.randint(len(others), size=n)
    size = 1.0 if step % 10 == 9 else 2.38 / np.sqrt(2 * d)
    if step % 10 != 9:
        size = size * SETTINGS.smallest_move ** random_state.uniform(size=(n, 1))
    # a subset of the dimensions at a time: in many dimensions single ones move farther
    kept = random_state.uniform(size=(n, d)) < random_state.choice([0.3, 1.0], size=(n, 1))
    jitter = 1e-6 * random_state.standard_normal((n, d))
    return size * kept * (others[first] - others[second]) + jitter
