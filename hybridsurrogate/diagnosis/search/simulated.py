"""Data sets with a known cause, and what the linearised evidence of all causes says of each.

The size of a cause in the output is the root mean square, over the rows, of what the simulation's
parameters cannot follow of it, in standard deviations of the noise. Of a cause in the noise it is
the largest standard deviation of a row over the smallest, less one; of noise that neighbouring rows
share, the size of the shared part in that of the other.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import special

from hybridsurrogate.diagnosis.search.candidate import NAMELESS, prior_odds
from hybridsurrogate.diagnosis.search.context import Fitted, SearchContext
from hybridsurrogate.diagnosis.search.null_test import NullTest, evidence_at_null, faults_of
from hybridsurrogate.diagnosis.search.search import Search
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.inference.evidence.grid import Grid, divided, make_grid, with_cells
from hybridsurrogate.inference.evidence.levenberg_marquardt import REACH_SD
from hybridsurrogate.inference.evidence.linearised import (
    Linearised,
    linearise,
    linearised_pieces,
)
from hybridsurrogate.inference.evidence.marginal_likelihood import scan
from hybridsurrogate.inference.evidence.settings import SETTINGS
from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.model.posterior import FEW_DRAWS
from hybridsurrogate.numerics.linear_algebra import LARGE_BLOCK, blocks
from hybridsurrogate.simulation.arrays import LARGEST
from hybridsurrogate.types import FloatArray


class Place(NamedTuple):
    """Rows in which nothing is wrong, to first order around their fit.

    Attributes
    ----------
    context : SearchContext
    null : Fitted
        "Nothing is wrong" at its best.
    parts : Linearised
        Of it.
    noise : ndarray of shape (n,)
        Standard deviation of each row, on the scale of eta.
    causes : tuple of Cause
        All that a search compares with each other, but for outliers and what looks only at unusual
        rows (`Cause.is_screened`).
    """

    context: SearchContext
    null: Fitted
    parts: Linearised
    noise: FloatArray
    causes: tuple[Cause, ...]

    @classmethod
    def of(
        cls,
        context: SearchContext,
        null: Fitted,
        causes: Sequence[Cause],
        noise: FloatArray | None = None,
    ) -> Place:
        """Return the place of a fit; ``noise`` (n,) None: as large as that of the fit."""
        parts = context.linearise(null)
        if noise is None:
            factor = np.ones(1) if parts.noise is None else parts.noise[0]
            noise = np.broadcast_to(null.sigma * factor, parts.mean[0].shape)
        compared = tuple(c for c in causes if not (c.is_screened or "outliers" in c.acts_on))
        return cls(context, null, parts, noise, compared)

    @property
    def output(self) -> FloatArray:
        """The rows without noise, (n,), at the fit."""
        return output_of(self.parts, self.null.mode.z[self.null.grid.fixed])[0]

    def left_of(self, curves: FloatArray) -> FloatArray:
        """Return what the parameters cannot follow of curves (k, n), in noise sd, (k, n)."""
        whitened = self.parts.G[0] / self.noise[:, None]
        # directions that move no row, by the rule of `numpy.linalg.matrix_rank`
        basis, size, _ = np.linalg.svd(whitened, full_matrices=False)
        least = len(whitened) * np.finfo(float).eps * np.max(size, initial=0.0)
        basis = basis[:, size > least]
        scaled = curves / self.noise
        return np.asarray(scaled - (scaled @ basis) @ basis.T)

    def responses(
        self, curves: FloatArray, factors: FloatArray, random: np.random.RandomState
    ) -> FloatArray:
        """Draw measured rows (k, n) with curves added and the noise times factors, both (k, n).

        What an emulator leaves open is drawn, too.
        """
        U, point = self.parts.U, self.context.problem.working_point
        eta = self.output + curves + random.standard_normal((len(curves), U.shape[1])) @ U.T
        if point is not None:
            return point.replicates(eta, random)
        return eta + self.noise * factors * random.standard_normal(eta.shape)


def output_of(parts: Linearised, z: FloatArray) -> FloatArray:
    """Return the rows without noise (M, n) at fixed directions z (d,), all sizes neutral."""
    return np.asarray(parts.mean + parts.G[:, :, : len(z)] @ z)


# parameters that follow more of a curve than this leave nothing to detect
_MIN_LEFT_SHARE = 0.1
# of a shape that has its size: how near, on a logarithmic scale, it has to be, before it is scaled
_SIZE_TOLERANCE = 0.3


class Shapes(NamedTuple):
    """Shapes of one cause, drawn from its prior; each can be given some sizes.

    Attributes
    ----------
    curves : ndarray of shape (k, n)
        On the scale of eta, at the largest of their known sizes.
    sizes : ndarray of shape (k, s)
        In rising order: of what is linear in its size, that of the curves alone.
    factors : ndarray of shape (k, n)
        On the noise.
    smallest, largest : ndarray of shape (k,)
        Sizes that each can have.
    weight : ndarray of shape (k,)
        Share of the prior.
    is_path : bool
        Whether they are noise that neighbouring rows share.
    run : callable or None
        Curves (m, n) of some shapes at shares (m,) of the farthest move, `_STEPS` at the sizes; far
        out a change of the simulation leaves its tangent. None: linear.
    """

    curves: FloatArray
    sizes: FloatArray
    factors: FloatArray
    smallest: FloatArray
    largest: FloatArray
    weight: FloatArray
    is_path: bool
    run: Callable[[NDArray[np.intp], FloatArray], FloatArray] | None = None

    def weight_at(self, size: float) -> FloatArray:
        """Return the share (k,) of each shape among those that can have a size."""
        return self.weight * ((self.smallest <= size) & (size <= self.largest))

    def at(self, index: NDArray[np.intp], size: float) -> tuple[FloatArray, FloatArray]:
        """Return curves and factors of some shapes at a size, both (m, n)."""
        sizes, factors = self.sizes[index], self.factors[index]
        if self.run is None:
            curves: FloatArray = self.curves[index] * size / sizes
        else:
            # a power between two steps, and linear before the first
            row, k = np.arange(len(index)), np.argmax(sizes >= size, axis=1)
            low, high = sizes[row, np.maximum(k - 1, 0)], sizes[row, k]
            power = np.log(size / low) / np.log(np.where(k > 0, high / low, np.e))
            ratio = _STEPS[k] / _STEPS[k - 1]
            share = np.where(k > 0, _STEPS[k - 1] * ratio**power, _STEPS[0] * size / low)
            curves = self.run(index, share)
        if self.is_path:
            shared = 1 / np.sqrt(1 + size**2)
            return curves * shared, factors * shared
        contrast = np.log(np.max(factors, axis=1) / np.min(factors, axis=1))
        power = np.divide(np.log1p(size), contrast, out=np.ones_like(contrast), where=contrast > 0)
        factors = factors ** power[:, None]
        return curves, factors / np.sqrt(np.mean(factors**2, axis=1, keepdims=True))


def shapes_of(place: Place, cause: Cause, random: np.random.RandomState) -> Shapes:
    """Draw shapes of one cause from its prior.

    Those that the parameters follow are left out: none may remain.

    Parameters
    ----------
    place : Place
    cause : Cause
        Prepared.
    random : RandomState
    """
    problem, null = place.context.problem, place.null
    model = problem.model.with_effects((*problem.model.effects, cause))
    grid = _drawn(model, make_grid(model), random)
    z = grid.neutral.copy()
    z[: len(null.mode.z)] = null.mode.z
    # a cause that changes the simulation comes in one piece
    run = _runs(place, model, grid, z, random) if len(grid.sizes) else None
    pieces = [
        _shapes(place, cause, parts, output_of(parts, z[grid.fixed]), run, random)
        for parts in linearised_pieces(model, problem.X, place.context.emulator, grid, z)
    ]
    curves, sizes, factors, smallest, largest, weight = (
        np.concatenate([piece[k] for piece in pieces]) for k in range(6)
    )
    is_path = cause.is_correlated_noise
    return Shapes(curves, sizes, factors, smallest, largest, weight, is_path, run)


# shares of the farthest move of a cause that changes the simulation
_STEPS: FloatArray = np.geomspace(1 / 512, 1, 13)


def _runs(
    place: Place, model: MeasuredModel, grid: Grid, z: FloatArray, random: np.random.RandomState
) -> Callable[[NDArray[np.intp], FloatArray], FloatArray]:
    """Return what some nodes make of the simulation, sizes moved by shares of the farthest.

    Zero where the simulation fails.
    """
    X, c = place.context.problem.X, place.context.emulator.mean
    directions = random.standard_normal((len(grid.points), len(grid.sizes)))
    # a parameter moves within its prior, as far as searches start
    directions *= REACH_SD / np.max(np.abs(directions), axis=1, keepdims=True)

    def output(index: NDArray[np.intp], share: FloatArray) -> FloatArray:
        places = np.tile(z, (len(index), 1))
        places[:, grid.sizes] += share[:, None] * directions[index]
        values = model.values(places)
        values[:, grid.nodes] = grid.points[index]
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            return np.asarray(model.output(X, values, c)[0])

    def run(index: NDArray[np.intp], share: FloatArray) -> FloatArray:
        curves = output(index, share) - output(index, np.zeros(len(index)))
        ran = (np.abs(curves) < LARGEST).all(axis=1, keepdims=True)
        return np.where(ran, curves, 0.0)

    return run


def _drawn(model: MeasuredModel, grid: Grid, random: np.random.RandomState) -> Grid:
    """Return the grid with draws of its coordinates from their prior in place of its nodes."""
    weight = np.exp(grid.log_weight - np.logaddexp.reduce(grid.log_weight))
    index = random.choice(len(weight), FEW_DRAWS, p=weight / weight.sum())
    cells, points = grid.edges[index], grid.points[index]
    for k, position in enumerate(grid.nodes if not grid.exact else ()):
        prior = model.priors[position]
        below, above = prior.cdf(cells[:, k, 0]), prior.cdf(cells[:, k, 1])
        within = prior.ppf(below + (above - below) * random.uniform(size=FEW_DRAWS))
        points[:, k] = np.clip(within, cells[:, k, 0], cells[:, k, 1])
    edges = np.repeat(points[:, :, None], 2, axis=2)
    return with_cells(grid, edges, np.full(FEW_DRAWS, -np.log(FEW_DRAWS)))


def _shapes(
    place: Place,
    cause: Cause,
    parts: Linearised,
    output: FloatArray,
    run: Callable[[NDArray[np.intp], FloatArray], FloatArray] | None,
    random: np.random.RandomState,
) -> tuple[FloatArray, ...]:
    """Return the fields of `Shapes`, one for each node, each with a random direction.

    ``output`` are the rows without noise at the nodes, sizes neutral: (k, n) or, of all, (1, n).
    """
    k, n, q = parts.H.shape
    weight = np.exp(parts.log_weight)
    own = np.ones((k, n))
    if parts.noise is not None:
        relative = parts.noise if place.parts.noise is None else parts.noise / place.parts.noise
        own = np.broadcast_to(relative, (k, n))
    near = np.exp([-_SIZE_TOLERANCE, _SIZE_TOLERANCE])
    smallest, largest = np.zeros(k), np.full(k, np.inf)
    if not q and not cause.touches_simulation:
        # noise alone: a shape has its contrast, and may be scaled a little
        contrast = np.max(own, axis=1) / np.min(own, axis=1) - 1
        zero = np.zeros((k, n))
        return zero, np.ones((k, 1)), own, contrast * near[0], contrast * near[1], weight
    if run is None:
        curves = np.einsum("knq,kq->kn", parts.H, random.standard_normal((k, q)))
        curves = (output - place.output + curves)[:, None]
    else:
        curves = np.stack([run(np.arange(k), np.full(k, share)) for share in _STEPS], axis=1)
    left = place.left_of(curves.reshape(-1, n)).reshape(curves.shape)
    size = np.sqrt(np.mean(left**2, axis=2))
    raw = np.sqrt(np.mean((curves[:, 0] / place.noise) ** 2, axis=1))
    valid = np.isfinite(size[:, 0]) & (size[:, 0] > _MIN_LEFT_SHARE * raw) & (size[:, 0] > 0)
    size = np.where(valid[:, None], np.maximum.accumulate(size, axis=1), 1.0)
    if run is not None:
        largest = size[:, -1]
    elif not q:
        smallest, largest = size[:, 0] * near[0], size[:, 0] * near[1]
    last = np.where(valid[:, None], curves[:, -1], 0.0)
    factors = np.ones((k, n)) if cause.is_process else own
    return last, size, factors, smallest, largest, weight * valid


def hidden(
    place: Place,
    shapes: Sequence[tuple[Cause, Shapes]],
    size: float,
    m: int,
    random: np.random.RandomState,
) -> tuple[FloatArray, FloatArray] | None:
    """Draw m data sets with a cause of a kind; None where none of its forms has this size.

    Parameters
    ----------
    place : Place
    shapes : sequence of (Cause, Shapes)
        The forms of the kind: each has its share of the prior of the kind.
    size : float
    m : int
    random : RandomState

    Returns
    -------
    responses : ndarray of shape (m, n)
    change : ndarray of shape (m,)
        The largest change of a row without noise, on the scale of eta.
    """
    odds = prior_odds([cause for cause, _ in shapes])
    able = np.array([one.weight_at(size).any() for _, one in shapes])
    if not able.any():
        return None
    share = odds * able / np.sum(odds * able)
    counts = random.multinomial(m, share)
    curves, factors = [], []
    for (_, one), count in zip(shapes, counts, strict=True):
        weight = one.weight_at(size)
        if count:
            index = random.choice(len(weight), count, p=weight / weight.sum())
            both = one.at(index, size)
            curves.append(both[0])
            factors.append(both[1])
    added, factor = np.concatenate(curves), np.concatenate(factors)
    return place.responses(added, factor, random), np.max(np.abs(added), axis=1)


# the word for data sets in which nothing is wrong, or nothing is detected
NOTHING = "none"


class Outcomes(NamedTuple):
    """Conclusions from data sets.

    Attributes
    ----------
    statistic : ndarray of shape (m,)
        T, the log of the best evidence ratio, see `null_test`.
    none : ndarray of shape (m,)
        Probability that nothing is wrong.
    kind : ndarray of str of shape (m,)
        The most probable kind, given that something is wrong.
    share : ndarray of shape (m,)
        Its probability, given that something is wrong.
    """

    statistic: FloatArray
    none: FloatArray
    kind: NDArray[np.str_]
    share: FloatArray

    def between(self, start: int, end: int) -> Outcomes:
        """Return those of some of the data sets."""
        some = slice(start, end)
        return Outcomes(self.statistic[some], self.none[some], self.kind[some], self.share[some])

    def detected(self, limit: float, rate: float) -> NDArray[np.bool_]:
        """Return where something is detected: by the test and by its probability.

        Parameters
        ----------
        limit : float
            What T exceeds in a share ``rate`` of data sets without a cause.
        rate : float
            False alarm rate.
        """
        # the bound of `evidence_bound`, with prior odds of one
        odds = self.none / np.maximum(1 - self.none, np.finfo(float).tiny)
        return ((self.statistic > limit) | (odds <= rate)) & (self.none <= 0.5)


def log_evidence(place: Place, causes: Sequence[Cause], responses: FloatArray) -> FloatArray:
    """Return the log evidence of "nothing is wrong" and of causes for data sets, (m, 1 + k).

    Linearised at the fit: enough to say whether something shows.

    Parameters
    ----------
    place : Place
    causes : sequence of Cause
    responses : ndarray of shape (m, n)
    """
    forms = _forms(place, causes)
    sizes = place.context.sizes([place.null])
    return evidence_at_null(place.context, place.null, forms, responses, sizes)


def _forms(place: Place, causes: Sequence[Cause]) -> list[tuple[MeasuredModel, Grid]]:
    """Return the models and grids of "nothing is wrong" and of causes."""
    model = place.context.problem.model
    models = [model.with_effects((*model.effects, one)) for one in causes]
    return [(place.null.model, place.null.grid), *((one, make_grid(one)) for one in models)]


def refined_log_evidence(
    place: Place, causes: Sequence[Cause], responses: FloatArray
) -> FloatArray:
    """Return the log evidence as `log_evidence` does, finer where something shows clearly.

    There a change of an input or a parameter is expanded at many of its sizes, and the grids of
    other causes have half the distance: it matters which of them explains more.
    """
    context, forms = place.context, _forms(place, causes)
    args, sizes = (context, place.null), context.sizes([place.null])
    evidence = evidence_at_null(*args, forms, responses, sizes)
    gain = evidence[:, 1:] - evidence[:, :1]
    best = np.max(gain, axis=1)
    for k, (cause, (one, grid)) in enumerate(zip(causes, forms[1:], strict=True)):
        # the stronger the data, the more a tangent or a coarse grid misses: up to half of the
        # evidence of a constant at the end of its prior
        some = np.flatnonzero((best > SETTINGS.max_behind) & (gain[:, k] > best / 3))
        if not len(some):
            continue
        if "inputs" in cause.acts_on and len(grid.sizes) == 1:
            evidence[some, 1 + k] = _expanded(place, one, grid, responses[some], sizes)
        elif len(grid.nodes) and not grid.exact:
            finer = [(one, divided(one, grid, 2))]
            evidence[some, 1 + k] = evidence_at_null(*args, finer, responses[some], sizes)[:, 0]
    return evidence


# where the size of a change is expanded, in standard deviations of its prior, and how far around,
# in shares of that; a tangent at the middle alone names a tenth of drifts of eight times the noise
_PLACES, _REACH = np.geomspace(1 / 32, 2, 11), 0.25


def _expanded(
    place: Place, model: MeasuredModel, grid: Grid, responses: FloatArray, sizes: FloatArray
) -> FloatArray:
    """Return the log evidence (m,) of a cause with one size, expanded at many of its values.

    The wide ones of the normal distributions of which the size's prior is a mixture are replaced
    by narrow ones side by side, each with a tangent of its own.
    """
    context, null = place.context, place.null
    args = responses, null.sigma, context.noise
    base = grid.neutral.copy()
    base[: len(null.mode.z)] = null.mode.z

    def around(shift: float) -> Linearised:
        z = base.copy()
        z[grid.sizes] += shift
        return linearise(model, context.problem.X, context.emulator, grid, z)

    ratio = np.sqrt(_PLACES[1] / _PLACES[0])
    parts, core = around(0.0), _PLACES[0] / ratio
    scales = np.minimum(sizes / np.median(parts.H_rms[:, 0]), 1.0)
    wide = scales > core
    terms = [] if wide.all() else [scan(parts, *args, sizes[~wide]) + np.log(np.mean(~wide))]
    ends = np.append(core, _PLACES * ratio)
    mass = np.sum(np.diff(special.ndtr(ends[:, None] / scales[wide]), axis=0), axis=1)
    inner = np.sum(2 * special.ndtr(core / scales[wide]) - 1)
    shifts = np.concatenate([[0.0], _PLACES, -_PLACES])
    reach = np.concatenate([[core], _REACH * _PLACES, _REACH * _PLACES])
    shares = np.concatenate([[inner], mass, mass]) / len(scales)
    for k in map(int, np.flatnonzero(shares > 0)):
        parts = around(shifts[k])
        # the size counts from here
        mean = parts.mean + shifts[k] * parts.H_rms[:, :1] * parts.H[:, :, 0]
        parts = replace(parts, mean=mean, cap=reach[k] * parts.cap)
        terms.append(scan(parts, *args, np.array([np.inf])) + np.log(shares[k]))
    return np.asarray(special.logsumexp(np.concatenate(terms, axis=1), axis=1))


def outcomes(place: Place, responses: FloatArray) -> Outcomes:
    """Return what a diagnosis would conclude from data sets (m, n) at a place."""
    pieces = blocks(len(responses), responses.shape[1], LARGE_BLOCK)
    evidence = np.concatenate(
        [refined_log_evidence(place, place.causes, responses[some]) for some in pieces]
    )
    statistic = np.max(evidence[:, 1:], axis=1) - evidence[:, 0]
    weight = evidence + np.log(prior_odds([None, *place.causes]))
    probability = np.exp(weight - special.logsumexp(weight, axis=1, keepdims=True))
    kind, share = _most_probable(place.causes, probability[:, 1:])
    return Outcomes(statistic, probability[:, 0], kind, share)


def _most_probable(
    causes: Sequence[Cause], probability: FloatArray
) -> tuple[NDArray[np.str_], FloatArray]:
    """Return the most probable kind of each data set, as `Search.leader`, and its share."""
    total = np.maximum(np.sum(probability, axis=1, keepdims=True), np.finfo(float).tiny)
    kinds, of_kind = _summed([one.kind for one in causes], probability / total)
    families, of_family = _summed([one.concerns for one in causes], probability / total)
    has = {(one.concerns, one.kind) for one in causes}
    member = np.array([[(family, kind) in has for kind in kinds] for family in families])
    among = np.where(member[np.argmax(of_family, axis=1)], of_kind, -1.0)
    best = np.argmax(among, axis=1)
    # a curve of any shape, where it beats every kind
    nameless = np.isin(kinds, NAMELESS)[best]
    best = np.where(nameless, np.argmax(of_kind, axis=1), best)
    return np.array(kinds)[best], np.take_along_axis(of_kind, best[:, None], axis=1)[:, 0]


def _summed(names: Sequence[str], values: FloatArray) -> tuple[list[str], FloatArray]:
    """Return the different names, and the values (m, k) of each name summed."""
    different = list(dict.fromkeys(names))
    belongs = np.array([[name == other for other in different] for name in names], dtype=float)
    return different, values @ belongs


# share of the data sets in which a cause counts as detectable
POWER = 0.9
# sizes, in standard deviations of the mean of 40 rows, and data sets of each
_SIZES, _SETS = np.geomspace(0.5, 8.0, 5) * np.sqrt(40), 20


def detectable(result: Search, test: NullTest, rate: float) -> pd.DataFrame:
    """Return the smallest size of each kind that would have been detected in these rows.

    Data sets with a cause of each kind are evaluated by the evidence of that kind and of "nothing
    is wrong" alone: another kind may show a smaller one.

    Parameters
    ----------
    result : Search
        The first one, which detected nothing.
    test : NullTest
        Of it.
    rate : float
        False alarm rate.

    Returns
    -------
    DataFrame
        One row a kind, see `DiscrepancyDiagnosis`.
    """
    # a fixed stream: a verdict is reproducible
    random = np.random.RandomState(0)
    causes = [w.cause for w in result.candidates if w.cause is not None]
    place = Place.of(result.context, result.candidates[0].fit, causes)
    limit = float(np.quantile(test.replicates, 1 - rate, method="higher"))
    log_prior = np.log(prior_odds([None, *causes]))
    levels, rows = _SIZES / np.sqrt(len(place.noise)), []
    for kind in dict.fromkeys(one.kind for one in place.causes):
        own = [one for one in place.causes if one.kind == kind]
        prior = log_prior[[0, *(1 + causes.index(one) for one in own)]]
        forms = [(one, shapes_of(place, one, random)) for one in own]
        drawn = [(size, hidden(place, forms, float(size), _SETS, random)) for size in levels]
        made = [(size, one) for size, one in drawn if one is not None]
        if not made:
            continue
        evidence = log_evidence(
            place, own, np.concatenate([responses for _, (responses, _) in made])
        )
        better = np.max(evidence[:, 1:], axis=1) - evidence[:, 0] > limit
        odds = special.logsumexp(evidence[:, 1:] + prior[1:], axis=1) - evidence[:, 0] - prior[0]
        seen = (better & (odds >= 0)).reshape(len(made), _SETS)
        sizes, share = np.array([size for size, _ in made]), np.mean(seen, axis=1)
        rows.append((kind, size_at(sizes, share, POWER), _change_at(forms, sizes, share)))
    return pd.DataFrame(rows, columns=["kind", "size", "change"])


def _change_at(forms: Sequence[tuple[Cause, Shapes]], sizes: FloatArray, rate: FloatArray) -> float:
    """Return the largest change of a row of which a cause is detected with `POWER`.

    A step of some height has many sizes, as the parameters follow one place more than another: its
    rate is the average of those at these sizes.
    """
    peak = np.concatenate(
        [np.max(np.abs(one.curves), axis=1) / one.sizes[:, -1] for _, one in forms]
    )
    odds = prior_odds([cause for cause, _ in forms])
    weight = np.concatenate([k * one.weight for k, (_, one) in zip(odds, forms, strict=True)])
    peak, weight = peak[weight * peak > 0], weight[weight * peak > 0]
    if not len(peak):
        return np.nan
    changes = np.geomspace(sizes[0] * peak.min(), sizes[-1] * peak.max(), 60)
    log_sizes, rising = np.log(sizes), np.maximum.accumulate(rate)
    at = np.interp(np.log(changes[:, None] / peak), log_sizes, rising)
    return size_at(changes, at @ weight / weight.sum(), POWER)


def size_at(sizes: FloatArray, rate: FloatArray, power: float) -> float:
    """Return where a rate over size rises to a power, NaN where it does not.

    Interpolated on a logarithmic scale of size, as a curve that never falls; the smallest size
    where the rate is as high there.

    Parameters
    ----------
    sizes, rate : ndarray of shape (k,)
        Sizes in rising order.
    power : float

    Examples
    --------
    >>> import numpy as np
    >>> size_at(np.array([1.0, 4.0]), np.array([0.5, 1.0]), 0.75)
    2.0
    """
    size, rate = np.log(sizes), np.maximum.accumulate(rate)
    if rate[-1] < power:
        return np.nan
    k = int(np.argmax(rate >= power))
    if not k:
        return float(sizes[0])
    share = (power - rate[k - 1]) / (rate[k] - rate[k - 1])
    return float(np.exp(size[k - 1] + share * (size[k] - size[k - 1])))


def smallest_detectable(result: Search, test: NullTest, rate: float) -> float | None:
    """Return the root mean square of the smallest fault that would have been detected.

    A fault of some size shows where the p-value of the whole search is at most ``rate`` in nine of
    ten data sets with it, see `faults_of`. The median over the shapes is returned: a parameter of
    the simulation may absorb one shape, and not the others.

    Parameters
    ----------
    result : Search
        The first one.
    test : NullTest
        Of the same search.
    rate : float
        False alarm rate.

    Returns
    -------
    float or None
        On the scale of eta. None where rows do not vary along an input, or no such fault up to 16
        times the residual and the emulator's error shows.
    """
    limit = float(np.quantile(test.replicates, 1 - rate, method="higher"))
    sizes, statistic = faults_of(result)
    if not len(statistic):
        return None
    enough = np.mean(statistic > limit, axis=2) >= POWER
    # the size from which on all larger ones show
    enough = np.flip(np.cumprod(np.flip(enough, axis=1), axis=1), axis=1).astype(bool)
    least = np.where(enough.any(axis=1), sizes[np.argmax(enough, axis=1)], np.inf)
    median = float(np.sort(least)[(len(least) - 1) // 2])
    return median if np.isfinite(median) else None
