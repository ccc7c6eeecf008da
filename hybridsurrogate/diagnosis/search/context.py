"""What a search looks at, and how one model is fitted to it: climbs, noise, a finer grid.

Screening needs normal rows. Around the fit without a cause, rows of any likelihood are replaced by
those of one step of Fisher scoring: a working response and a noise of each row, of which the latter
does not depend on what was measured. Measured and replicated data meet the same approximation, so
that a p-value is right whatever it neglects; the most probable causes are scored by the likelihood
(`exact_scores.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from scipy import special

from hybridsurrogate.effects.base import Nothing
from hybridsurrogate.inference.conjugate.noise_marginal import KnownNoise, LogMarginal, NoiseTable
from hybridsurrogate.inference.evidence.grid import Grid, best_levels, make_grid, refine
from hybridsurrogate.inference.evidence.linearised import (
    Columns,
    Linearised,
    RecentSlopes,
    columns_at_nodes,
    linearise,
)
from hybridsurrogate.inference.evidence.marginal_likelihood import LocalMode, optimise, scan
from hybridsurrogate.inference.evidence.outliers import as_normal_rows
from hybridsurrogate.inference.evidence.settings import SETTINGS
from hybridsurrogate.model.observation import MeasuredModel, WorkingPoint
from hybridsurrogate.model.posterior import Posterior
from hybridsurrogate.model.problem import Problem
from hybridsurrogate.model.statistics import EmulatorPosterior
from hybridsurrogate.numerics.linear_algebra import NEGLIGIBLE
from hybridsurrogate.priors import to_normal
from hybridsurrogate.types import FloatArray

# noise of data that have none, for a search: well above what it cannot see
BLUR = 10 * NEGLIGIBLE


def on_working_rows(problem: Problem, posterior: Posterior) -> Problem:
    """Return the problem as a search sees it: the same where rows are normal and alike.

    Parameters
    ----------
    problem : Problem
        Without effects.
    posterior : Posterior
        Of the estimator without effects.
    """
    if problem.likelihood.gaussian:
        if np.all(problem.weights == 1.0):
            return problem
        # N(y; m, sigma^2)^w is N(y; m, sigma^2 / w) but for a factor, which would make w
        # measurements of one: a curve through each row would then leave no noise at all
        model = replace(problem.model, has_row_noise=True)
        return replace(problem, model=model, X=np.column_stack([problem.X, problem.weights**-0.5]))
    eta, noise = posterior.eta(problem.X)
    eta = np.mean(eta[np.isfinite(eta).all(axis=1)], axis=0)
    factor = problem.model.known_noise(problem.X)
    draws = np.median(noise / factor, axis=1)
    point = WorkingPoint(problem.likelihood, eta, float(np.median(draws)), draws, factor)
    model = replace(problem.model, has_row_noise=True)
    X = np.column_stack([problem.X, np.ones(len(eta))])
    return expanded(replace(problem, model=model, X=X), point)


def expanded(problem: Problem, point: WorkingPoint) -> Problem:
    """Return a problem whose rows carry their noise, expanded at a point."""
    X = problem.X.copy()
    X[:, -1] = point.noise() / np.sqrt(problem.weights)
    return replace(problem, X=X, y=point.response(problem.observed), working_point=point)


def blurred(problem: Problem) -> Problem:
    """Return the problem with a little noise in the output, for data that have none.

    Where residuals are rounding, their tails and their order mean nothing.
    """
    noise = np.random.RandomState(0).standard_normal(len(problem.y))
    return replace(problem, y=problem.y + BLUR * problem.scale * noise)


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

    @property
    def values(self) -> FloatArray:
        """The unknowns at the best fit, (1, n_unknowns)."""
        values = self.model.values(self.mode.z[None])
        if len(self.grid.nodes):
            values[:, self.grid.nodes] = self.grid.points[self.mode.node]
        return values


@dataclass(frozen=True)
class SearchContext:
    """The measured rows that all causes of a search are fitted to.

    The surrogate's coefficients come from the simulation alone (beta = 1), so that a fault of the
    simulation is not absorbed by its emulator; the emulator's uncertainty is part of the
    covariance (Kennedy and O'Hagan 2001, Journal of the Royal Statistical Society B 63:425).

    Attributes
    ----------
    problem : Problem
        Without effects, or with those that an earlier search accepted.
    emulator : EmulatorPosterior
        About the surrogate's coefficients, from the simulation alone.
    noise : LogMarginal
        Sigma integrated out under the problem's prior.
    slopes : RecentSlopes
        Of the simulation at the problem's rows.
    """

    problem: Problem
    emulator: EmulatorPosterior
    noise: LogMarginal
    slopes: RecentSlopes = field(default_factory=RecentSlopes, repr=False, compare=False)

    @classmethod
    def of(cls, problem: Problem, emulator: EmulatorPosterior) -> SearchContext:
        """Return the context of a problem whose noise follows the emulator's mean."""
        problem = replace(problem, model=replace(problem.model, reference=emulator.mean))
        n, errors = len(problem.y), problem.model.errors
        if problem.noise_is_known:
            return cls(problem, emulator, KnownNoise(n, float(problem.possible_sigma(1.0))))
        least = 0.0 if errors is None else errors.least_sigma
        return cls(problem, emulator, NoiseTable(problem.noise_prior, problem.scale, n, least))

    def at(self, problem: Problem) -> SearchContext:
        """Return the context of a problem with the same noise."""
        same = problem.X is self.problem.X
        return replace(self, problem=problem, slopes=self.slopes if same else RecentSlopes())

    @property
    def largest_size(self) -> float:
        """The largest prior scale of an effect's size, in units of y."""
        return max(SETTINGS.largest_size * self.problem.scale, self.problem.reach)

    def sizes(self, fits: Sequence[Fitted]) -> FloatArray:
        """Return the prior scales of effects' sizes, in units of y, equally probable."""
        noise = self.problem.unit_noise * min(fit.sigma for fit in fits)
        smallest = SETTINGS.smallest_size * noise
        return np.geomspace(smallest, max(self.largest_size, 2 * smallest), SETTINGS.n_sizes)

    def linearise(self, fit: Fitted, columns: Columns | None = None) -> Linearised:
        """Return the model around a fit, outliers as normal rows of their scales."""
        model, grid, mode, sigma = fit
        X, y, emulator = self.problem.X, self.problem.y, self.emulator
        parts = linearise(model, X, emulator, grid, mode.z, columns, self.slopes)
        args = model, grid, mode.z, y, sigma, self.largest_size, self._possible
        return as_normal_rows(parts, *args)

    def evidence_of_nodes(
        self, fit: Fitted, sizes: FloatArray, columns: Columns | None = None
    ) -> FloatArray:
        """Return the log evidence of every node of a fit, (T,)."""
        parts = self.linearise(fit, columns)
        return scan(parts, self.problem.y[None], fit.sigma, self.noise, sizes)[0]

    def evidence(self, fit: Fitted, sizes: FloatArray) -> float:
        """Return the log evidence of a fit."""
        return float(np.logaddexp.reduce(self.evidence_of_nodes(fit, sizes)))

    def optimise(
        self,
        model: MeasuredModel,
        grid: Grid,
        z: FloatArray,
        sigma: float,
        columns: Columns | None = None,
        size: float | None = None,
    ) -> LocalMode:
        """Climb from one start; ``size`` None: the effect's size is free."""
        X, y = self.problem.X, self.problem.y
        size = self.largest_size if size is None else size
        args = model, X, y, self.emulator, grid, z, sigma, size, self._possible
        return optimise(*args, columns, self.slopes)

    def _possible(self, sigma: FloatArray) -> FloatArray:
        least = NEGLIGIBLE * self.problem.scale
        return np.asarray(self.problem.possible_sigma(np.maximum(sigma, least)))

    def climb(
        self, model: MeasuredModel, grid: Grid, starts: Sequence[FloatArray], sigma: float
    ) -> LocalMode:
        """Climb from every start and return the best fit; one at infinity without a start."""
        modes = [self.optimise(model, grid, z, sigma) for z in starts]
        nowhere = LocalMode(grid.neutral, np.inf, np.inf, 0)
        return min(modes, key=lambda found: self.deviance(found, sigma), default=nowhere)

    def converge(self, fit: Fitted, enough: float = -np.inf) -> Fitted:
        """Climb on with the noise that the fit suggests, and a finer grid where the evidence is.

        Until at two finer grids in a row the best node gains so little that as much in every round
        would leave it below ``enough``, a log evidence. One alone may be the price of a step up.
        """
        model, grid, mode, sigma = fit
        if not np.isfinite(mode.objective):
            return fit
        size = np.array([self.largest_size])
        columns = columns_at_nodes(model, self.problem.X, grid, mode.z)
        levels: FloatArray = np.empty(0)
        fruitless = slow = 0
        rounds = SETTINGS.max_refinements
        for round_ in range(rounds):
            before, sigma = sigma, self.noise_of(mode, sigma)
            steady = round_ > 0 and sigma > (1 - SETTINGS.converged_noise) * before
            finer = grid
            if len(grid.nodes):
                nodes = self.evidence_of_nodes(Fitted(model, grid, mode, sigma), size, columns)
                found = best_levels(grid, nodes)
                # a jump has one level between two rows, however fine the grid
                same = len(found) == len(levels)
                gain = found[-1] - levels[-1] if len(levels) else np.inf
                same = same and abs(gain) < SETTINGS.converged_gain
                slow = slow + 1 if found[-1] + rounds * gain < enough else 0
                levels, fruitless = found, fruitless + 1 if same else 0
                stops = fruitless >= SETTINGS.fruitless_refinements or slow > 1
                finer = grid if stops else refine(model, grid, nodes)
            unchanged = finer is grid
            grid = finer
            if unchanged and steady:
                break
            if not unchanged:
                columns = columns_at_nodes(model, self.problem.X, grid, mode.z)
            mode = self.optimise(model, grid, mode.z, sigma, columns)
        return Fitted(model, grid, mode, sigma)

    def best_null(self) -> Fitted:
        """Fit "nothing is wrong" from several starting points."""
        problem, model = self.problem, self.problem.model
        if any(effect.grid() or effect.coefficients for effect in model.effects):
            # the places of known effects are fixed at a start, not enumerated, and their sizes have
            # their own priors
            model = model.with_effects((*model.effects, Nothing()))
        grid = make_grid(model)
        d = model.n_unknowns
        # a fixed spread of starts: the search is reproducible
        z = np.vstack([np.zeros(d), np.random.RandomState(0).standard_normal((16 * d, d))])
        output, _, factor = model.simulated(problem.X, model.values(z), self.emulator.mean)
        with np.errstate(over="ignore", invalid="ignore"):
            squares = np.sum(((problem.y - output) / factor) ** 2, axis=1)
        squares = np.where(np.isfinite(squares), squares, np.inf)
        # a parameter without a slope, such as the place of a jump, is not found by an optimiser
        starts = [z[0], *z[np.argsort(squares)[:2]], *problem.good]
        sigma = float(problem.possible_sigma(0.3 * problem.scale))
        return self.converge(Fitted(model, grid, self.climb(model, grid, starts, sigma), sigma))

    def nothing_further(self, accepted: Fitted) -> Fitted:
        """Fit "nothing else is wrong" from the fit of the accepted cause."""
        model = self.problem.model.with_effects((*self.problem.model.effects, Nothing()))
        grid = make_grid(model)
        mode = self.climb(model, grid, self.places_of(accepted), accepted.sigma)
        return Fitted(model, grid, mode, self.noise_of(mode, accepted.sigma))

    def places_of(self, accepted: Fitted) -> list[FloatArray]:
        """Return where an accepted cause can be fixed: at the mean of its place, or the best node.

        The mean is the better place, but only on the hill on which the best node is.
        """
        model, grid, mode, _ = accepted
        if not len(grid.nodes):
            return [mode.z]
        # a node is only as near as its cell is small: what it misses would look like another cause
        nodes = self.evidence_of_nodes(accepted, np.array([self.largest_size]))
        places = [special.softmax(nodes) @ grid.points]
        low, high = grid.edges[mode.node].T
        if not np.all((places[0] >= low) & (places[0] <= high)):
            places.append(grid.points[mode.node])
        out = np.repeat(mode.z[None], len(places), axis=0)
        out[:, grid.nodes] = [to_normal([model.priors[k] for k in grid.nodes], p) for p in places]
        return list(out)

    def noise_of(self, mode: LocalMode, sigma: float) -> float:
        """Return the noise that a fit suggests; the one it was made with where it failed."""
        problem = self.problem
        if problem.noise_is_known or not np.isfinite(mode.objective):
            return sigma
        return float(self._possible(np.sqrt(mode.squares / len(problem.y))))

    def deviance(self, mode: LocalMode, sigma: float) -> float:
        """Return minus twice the log posterior density at a mode, with the noise that suits it.

        Climbs share the noise of a fit without the cause, ``sigma``. At that much noise a fit to
        the data counts for little against the priors, and the wrong one of two modes would win.
        """
        problem = self.problem
        if not np.isfinite(mode.objective):
            return np.inf
        if problem.noise_is_known:
            return mode.objective
        squares = max(mode.squares, len(problem.y) * (NEGLIGIBLE * problem.scale) ** 2)
        return float(len(problem.y) * np.log(squares) + mode.objective - mode.squares / sigma**2)
