"""The p-value of the whole search under "the simulation is right"."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import special

from hybridsurrogate.diagnosis.search.candidate import prior_of
from hybridsurrogate.diagnosis.search.context import Fitted, SearchContext
from hybridsurrogate.diagnosis.search.search import Search
from hybridsurrogate.inference.evidence.grid import Grid, make_grid
from hybridsurrogate.inference.evidence.linearised import is_long, linearised_pieces
from hybridsurrogate.inference.evidence.marginal_likelihood import scan
from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.model.problem import Problem
from hybridsurrogate.simulation.outputs import OUTPUT
from hybridsurrogate.types import FloatArray

# data sets of each shape and size of a fault; sizes in units of what the null leaves, after one
# scaling
_SETS, _SIZES = 8, np.geomspace(0.25, 16.0, 7)


class NullTest(NamedTuple):
    """Result of the test.

    Attributes
    ----------
    statistic : float
        T, the log of the best evidence ratio over the whole catalogue.
    replicates : ndarray of shape (R,)
        T of data sets in which nothing is wrong.
    bound : float
        What Markov's inequality leaves to such evidence, see `evidence_bound`.
    least : float
        1 / (1 + R), as asked for: R replicates can show no less.
    """

    statistic: float
    replicates: FloatArray
    bound: float
    least: float

    def __repr__(self) -> str:
        n = len(self.replicates)
        return (
            f"NullTest(statistic={self.statistic:.3g}, p_value={self.p_value:.3g}, {n} replicates)"
        )

    @property
    def share(self) -> float:
        """(1 + #{T_rep >= T}) / (1 + R)."""
        exceeding = np.sum(self.replicates >= self.statistic)
        return float((1 + exceeding) / (1 + len(self.replicates)))

    @property
    def p_value(self) -> float:
        """The share or, where it is less, the bound: never less than one in 1 + R."""
        return min(self.share, max(self.bound, self.least))


def null_test(result: Search, n_replicates: int, random_state: np.random.RandomState) -> NullTest:
    """Repeat the whole search on replicates of "nothing is wrong" at the same inputs.

    Every cause is linearised once, at the null fit and where it changes nothing: designs do not
    depend on y, so measured and replicated responses are evaluated in one batch, by the same
    statistic. Outliers are left out on both sides: the scales of their rows depend on y, others
    explain far rows too, and evidence for outliers counts in `evidence_bound`. Of 29 data sets,
    clean, with tails, a wild row or a trend and tails, none was decided otherwise. Causes that were
    accepted before stay at their fit: their places free, to first order, changed no cause and no
    verdict of 82 cases (48 pairs of size 2, 34 single effects of size 4, up to two causes each).

    Parameters
    ----------
    result : Search
    n_replicates : int
    random_state : RandomState
    """
    responses = np.vstack([result.problem.y, replicates(result, n_replicates, random_state)])
    statistic = evidence_ratios(result, responses)
    return NullTest(float(statistic[0]), statistic[1:], 1.0, 1 / (1 + n_replicates))


def faults_of(result: Search) -> tuple[FloatArray, FloatArray]:
    """Return T of data sets with faults of a few shapes and sizes.

    A step in the middle and a straight line over each input are added to replicates of "nothing is
    wrong".

    Parameters
    ----------
    result : Search

    Returns
    -------
    sizes : ndarray of shape (k,)
        Root mean squares of the faults, on the scale of eta.
    statistic : ndarray of shape (n_shapes, k, n_sets)
    """
    # a fixed stream: a verdict is reproducible
    null = replicates(result, _SETS, np.random.RandomState(0))
    sizes = float(np.std(null - null.mean(axis=0))) * _SIZES
    data = null + sizes[:, None, None] * _shapes(result)[:, None, None, :]
    statistic = evidence_ratios(result, data.reshape(-1, data.shape[-1]))
    return sizes, statistic.reshape(data.shape[:-1])


def _shapes(result: Search) -> FloatArray:
    """Return curves of unit root mean square over the rows, (k, n)."""
    model, X = result.problem.model, result.problem.X
    out = []
    for k in range(model.n_inputs):
        x = X[:, k]
        if model.columns[k] == OUTPUT or np.ptp(x) == 0:
            continue
        out += [(x > np.median(x)).astype(float), (x - x.mean()) / np.std(x)]
    curves = np.array(out).reshape(-1, len(X))
    return curves / np.sqrt(np.mean(curves**2, axis=1, keepdims=True))


def evidence_ratios(result: Search, responses: FloatArray) -> FloatArray:
    """Return T of each of several data sets at the same inputs.

    Parameters
    ----------
    result : Search
    responses : ndarray of shape (k, n)

    Returns
    -------
    ndarray of shape (k,)
        Zero where no cause was compared.
    """
    null = result.candidates[0].fit
    pairs = [
        (w.fit.model, w.fit.grid)
        for w in result.candidates
        if w.cause is None or not (w.cause.is_screened or "outliers" in w.cause.acts_on)
    ]
    if len(pairs) == 1:
        return np.zeros(len(responses))
    evidence = evidence_at_null(result.context, null, pairs, responses, result.sizes)
    return np.asarray(np.max(evidence[:, 1:], axis=1) - evidence[:, 0])


def evidence_at_null(
    context: SearchContext,
    null: Fitted,
    compared: Sequence[tuple[MeasuredModel, Grid]],
    responses: FloatArray,
    sizes: FloatArray,
) -> FloatArray:
    """Return the log evidence of models for data sets at the same inputs, (R, k).

    Each is linearised once, at the null fit and where its last cause changes nothing.

    Parameters
    ----------
    context : SearchContext
    null : Fitted
    compared : sequence of (MeasuredModel, Grid)
    responses : ndarray of shape (R, n)
    sizes : ndarray
        Prior scales of effect sizes.
    """
    X, base = context.problem.X, null.mode.z
    evidence = []
    for model, grid in compared:
        z = grid.neutral.copy()
        z[: len(base)] = base
        # in a replicate a change may be anywhere, not only where the measured one is
        whole = make_grid(model)
        if not len(grid.nodes) or is_long(model, X, whole):
            grid = whole
        pieces = linearised_pieces(model, X, context.emulator, grid, z)
        scans = [
            scan(parts.simplified(), responses, null.sigma, context.noise, sizes)
            for parts in pieces
        ]
        evidence.append(special.logsumexp(np.concatenate(scans, axis=1), axis=1))
    return np.stack(evidence, axis=1)


def evidence_bound(result: Search) -> float:
    """Return how probable evidence like that of a search is at most where nothing is wrong.

    The evidence of all causes together, over that of "nothing is wrong", has an expectation of one
    where that is true; by Markov's inequality a ratio of r or more has probability 1 / r at most.
    Coarse, but valid far from the null fit too, where a first order is useless: a cause that
    shifts the phase of an oscillation is far from its tangent.
    """
    nothing = result.probability[0]
    odds = nothing / max(1 - nothing, np.finfo(float).tiny)
    prior = prior_of(result.candidates)
    return float(min(1.0, odds * prior[1:].sum() / prior[0]))


def replicates(result: Search, n: int, random_state: np.random.RandomState) -> FloatArray:
    """Draw measured responses from the posterior predictive of the linearised null, (n, rows)."""
    problem, null = result.problem, result.candidates[0].fit
    parts = result.context.linearise(null)
    # an accepted cause may have changed the noise: rows are drawn in units of it
    ((unit, unequal),) = parts.at(np.zeros(1, dtype=int)).by_noise()
    G, U = unit.G[0], unit.U
    rows, d = G.shape
    # each output has a noise of its own, whose ratio is known from its rows only
    of = np.zeros(rows, dtype=int)
    if problem.stacking is not None:
        of = np.unique(problem.X[:, problem.stacking.at], return_inverse=True)[1]
    degrees = np.maximum((rows - d) * np.bincount(of) / rows, 1)
    scaled = degrees / random_state.chisquare(degrees, size=(n, len(degrees)))
    sigma = problem.possible_sigma(np.sqrt(null.mode.squares / max(rows - d, 1) * scaled))
    precision = np.eye(d) + G.T @ G / null.sigma**2
    residual = problem.y / unequal - unit.mean[0]
    mean = np.linalg.solve(precision, G.T @ residual) / null.sigma**2
    factor = np.linalg.cholesky(np.linalg.inv(precision))
    g = mean + random_state.standard_normal((n, d)) @ factor.T
    emulator = random_state.standard_normal((n, U.shape[1])) @ U.T
    if problem.working_point is not None:
        eta = unequal * (unit.mean[0] + g @ G.T + emulator)
        return problem.working_point.replicates(eta, random_state)
    noise = random_state.standard_normal((n, rows))
    noise += _from_others(problem, null, degrees.min(), noise, random_state)
    return unequal * (unit.mean[0] + g @ G.T + emulator + sigma[:, of] * noise)


def _from_others(
    problem: Problem,
    null: Fitted,
    degrees: float,
    noise: FloatArray,
    random_state: np.random.RandomState,
) -> FloatArray | float:
    """Return what standardised rows (n, rows) have from others of their measurement.

    Where correlations between outputs are estimated, the coefficients of a regression on the
    outputs before are off, each with a variance of one over the degrees of freedom.
    """
    model = null.model
    if not model.output_correlation:
        return 0.0
    given = model.conditional(problem.X, null.values)
    if given is None:
        return 0.0
    there, k = given.members >= 0, given.members.shape[1]
    off = np.tril(random_state.standard_normal((len(noise), k, k)), -1) / np.sqrt(degrees)
    before = np.where(there, noise[:, given.members], 0.0) @ np.swapaxes(off, 1, 2)
    out = np.zeros_like(noise)
    out[:, given.members[there]] = before[:, there]
    return out
