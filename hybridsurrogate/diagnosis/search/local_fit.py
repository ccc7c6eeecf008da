"""A model at its best fit: optimisations, the noise there, a grid refined where the evidence is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from hybridsurrogate.inference.conjugate.noise_marginal import LogMarginal
from hybridsurrogate.inference.evidence.grid import Grid, best_levels, make_grid, refine
from hybridsurrogate.inference.evidence.linearised import Columns, columns_at_nodes, linearise
from hybridsurrogate.inference.evidence.marginal_likelihood import LocalMode, optimise, scan
from hybridsurrogate.inference.evidence.settings import SETTINGS
from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.model.problem import Problem
from hybridsurrogate.model.statistics import EmulatorPosterior
from hybridsurrogate.types import FloatArray

# noise below this share of the output's scale is rounding
FLOOR = 1e-6
# and that of data which have none, for a search: well above what it cannot see
BLUR = 1e-5


class InterruptedSearch(KeyboardInterrupt):
    """An interrupt on its way out, with what was finished when it came.

    Attributes
    ----------
    kept : Any
        The fits, then the `Search` made of them; None when nothing was finished.
    """

    def __init__(self, kept: Any) -> None:
        super().__init__("the search was interrupted")
        self.kept = kept


class Fitted(NamedTuple):
    """A model at its best fit: the grid of its last cause, the mode and the noise there."""

    model: MeasuredModel
    grid: Grid
    mode: LocalMode
    sigma: float


def blurred(problem: Problem) -> Problem:
    """Return the problem with a little noise in the output, for data that have none.

    Where residuals are rounding, their tails and their order mean nothing.
    """
    noise = np.random.RandomState(0).standard_normal(len(problem.y))
    return replace(problem, y=problem.y + BLUR * problem.scale * noise)


def largest_size(problem: Problem) -> float:
    """Return the largest prior scale of an effect's size, in units of y."""
    return max(SETTINGS.largest_size * problem.scale, problem.reach)


def effect_sizes(problem: Problem, fits: Sequence[Fitted]) -> FloatArray:
    """Return the prior scales of effects' sizes, in units of y, equally probable."""
    smallest = SETTINGS.smallest_size * problem.unit_noise * min(fit.sigma for fit in fits)
    return np.geomspace(smallest, max(largest_size(problem), 2 * smallest), SETTINGS.n_sizes)


def best_null(problem: Problem, emulator: EmulatorPosterior, noise: LogMarginal) -> Fitted:
    """Fit "nothing is wrong" from several starting points."""
    model = problem.model
    grid = make_grid(model)
    d = model.n_unknowns
    # a fixed spread of starts: the search is reproducible
    z = np.vstack([np.zeros(d), np.random.RandomState(0).standard_normal((16 * d, d))])
    output, _, factor = model.simulated(problem.X, model.values(z), emulator.mean)
    with np.errstate(over="ignore", invalid="ignore"):
        squares = np.sum(((problem.y - output) / factor) ** 2, axis=1)
    squares = np.where(np.isfinite(squares), squares, np.inf)
    # a parameter without a slope, such as the place of a jump, is not found by an optimiser
    starts = [z[0], *z[np.argsort(squares)[:2]], *problem.good]
    sigma = 1.0 if problem.noise_is_known else 0.3 * problem.scale
    mode = highest(problem, emulator, model, grid, starts, sigma)
    return settled(problem, emulator, noise, Fitted(model, grid, mode, sigma))


def highest(
    problem: Problem,
    emulator: EmulatorPosterior,
    model: MeasuredModel,
    grid: Grid,
    starts: Sequence[FloatArray],
    sigma: float,
) -> LocalMode:
    """Climb from every start and return the best fit; one at infinity where there is no start."""
    largest = largest_size(problem)
    modes = [
        optimise(model, problem.X, problem.y, emulator, grid, z, sigma, largest) for z in starts
    ]
    nowhere = LocalMode(grid.neutral, np.inf, np.inf, 0)
    return min(modes, key=lambda found: deviance(problem, found, sigma), default=nowhere)


def deviance(problem: Problem, mode: LocalMode, sigma: float) -> float:
    """Return minus twice the log posterior density at a mode, with the noise that suits it best.

    Climbs share the noise of a fit without the cause, ``sigma``. At that much noise a fit to the
    data counts for little against the priors, and the wrong one of two modes would win.
    """
    if not np.isfinite(mode.objective):
        return np.inf
    if problem.noise_is_known:
        return mode.objective
    squares = max(mode.squares, len(problem.y) * (FLOOR * problem.scale) ** 2)
    return float(len(problem.y) * np.log(squares) + mode.objective - mode.squares / sigma**2)


def node_evidence(
    problem: Problem,
    emulator: EmulatorPosterior,
    noise: LogMarginal,
    fit: Fitted,
    sizes: FloatArray,
    columns: Columns | None = None,
) -> FloatArray:
    """Return the log evidence of every node of a fit, (T,)."""
    parts = linearise(fit.model, problem.X, emulator, fit.grid, fit.mode.z, columns)
    return scan(parts, problem.y[None], fit.sigma, noise, sizes)[0]


def settled(
    problem: Problem,
    emulator: EmulatorPosterior,
    noise: LogMarginal,
    fit: Fitted,
    rounds: int = SETTINGS.max_refinements,
) -> Fitted:
    """Climb on with the noise that the fit suggests, and a finer grid where the evidence is."""
    model, grid, mode, sigma = fit
    if not np.isfinite(mode.objective):
        return fit
    largest = largest_size(problem)
    columns = columns_at_nodes(model, problem.X, grid, mode.z)
    levels: FloatArray = np.empty(0)
    fruitless = 0
    for round_ in range(rounds):
        before, sigma = sigma, sigma_of(problem, mode, sigma)
        steady = round_ > 0 and sigma > (1 - SETTINGS.converged_noise) * before
        finer = grid
        if len(grid.nodes):
            here = Fitted(model, grid, mode, sigma)
            nodes = node_evidence(problem, emulator, noise, here, np.array([largest]), columns)
            found = best_levels(grid, nodes)
            # a jump has one level between two rows, however fine the grid
            same = len(found) == len(levels)
            same = same and abs(found[-1] - levels[-1]) < SETTINGS.same_evidence
            levels, fruitless = found, fruitless + 1 if same else 0
            enough = fruitless >= SETTINGS.fruitless_refinements
            finer = grid if enough else refine(model, grid, nodes)
        unchanged = finer is grid
        grid = finer
        if unchanged and steady:
            break
        if not unchanged:
            columns = columns_at_nodes(model, problem.X, grid, mode.z)
        mode = optimise(
            model, problem.X, problem.y, emulator, grid, mode.z, sigma, largest, columns
        )
    return Fitted(model, grid, mode, sigma)


def sigma_of(problem: Problem, mode: LocalMode, sigma: float) -> float:
    """Return the noise that a fit suggests; the one it was made with where it failed."""
    if problem.noise_is_known or not np.isfinite(mode.objective):
        return sigma
    return max(float(np.sqrt(mode.squares / len(problem.y))), FLOOR * problem.scale)
