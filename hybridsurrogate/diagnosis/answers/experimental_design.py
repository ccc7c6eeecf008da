"""Where further measurements best separate the alternatives, and further runs inform most."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy import special
from scipy.stats import qmc

from hybridsurrogate.diagnosis.answers.averaging import (
    Component,
    Predictions,
    components_of,
    is_smooth,
    predictions_at,
)
from hybridsurrogate.diagnosis.search.candidate import MIN_PROBABILITY
from hybridsurrogate.diagnosis.search.search import Search
from hybridsurrogate.emulators.failures import Failures
from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.model.posterior import Posterior
from hybridsurrogate.model.rows.columns import Experiments
from hybridsurrogate.numerics.linear_algebra import LARGE_BLOCK, blocks
from hybridsurrogate.simulation.arrays import as_numbers
from hybridsurrogate.simulation.outputs import OUTPUT
from hybridsurrogate.simulation.simulator import SimulationData, Simulator
from hybridsurrogate.simulation.variables import MAX_LEVELS
from hybridsurrogate.types import FloatArray

# values of the new measurement under each component: Gauss and Legendre's nodes of its cumulative
# probability, which serve narrow and wide alternatives together as well as similar ones; fewer
# where each component is there at three amplitudes of a remainder
_N_QUANTILES, _N_QUANTILES_BEYOND = 24, 8
# places along a column, and the share of the most information from which one is as good
_N_PLACES, _GOOD_SHARE = 60, 0.98
# places of a batch or of runs to choose from where none are given, and simulated batches: expected
# information is estimated to about 0.02 bits
_MAX_PLACES, _N_BATCHES = 400, 500


@dataclass(frozen=True)
class NextMeasurement:
    """The place, and the expected information of a measurement there.

    Attributes
    ----------
    place : dict of str to float
        Value of each measured column; of several outputs also "output", the name of one.
    information : float
        Expected reduction of the uncertainty about which alternative is true, in bits.
    uncertainty : float
        What there is to reduce: the entropy of the alternatives' probabilities, in bits.
    """

    place: dict[str, Any]
    information: float
    uncertainty: float


def next_measurement(result: Search, ranges: Mapping[str, tuple[float, float]]) -> NextMeasurement:
    """Return where one more measurement is expected to separate the alternatives most.

    A grid over each column in turn, the others where they were best so far, twice over.

    Parameters
    ----------
    result : Search
    ranges : dict of str to (low, high)
        Of the simulated inputs; other columns, and inputs that number a few things (such as 0 and
        1), keep to values that were measured.
    """
    problem = result.problem
    columns = problem.model.columns
    components = components_of(result)
    point = np.median(problem.as_places(problem.X), axis=0)
    if problem.stacking is not None:
        point[problem.stacking.at] = 0.0
    information = 0.0
    for _ in range(2 if len(columns) > 1 else 1):
        for k, name in enumerate(columns):
            values = _values_of(name, problem.X[:, k], ranges)
            grid = np.repeat(point[None], len(values), axis=0)
            grid[:, k] = values
            # without any prediction there is no information either
            bits = np.nan_to_num(_information(result, components, grid))
            # of places that are as good, the one nearest to what is known
            good = np.flatnonzero(bits >= _GOOD_SHARE * bits.max())
            best = good[np.argmin(np.abs(grid[good, k] - point[k]))]
            point, information = grid[best], float(bits[best])
    place: dict[str, Any] = dict(zip(columns, point.tolist(), strict=False))
    if problem.stacking is not None:
        place["output"] = problem.stacking.names[int(place.pop(OUTPUT))]
    weight = np.bincount([c.alternative for c in components], [c.weight for c in components])
    return NextMeasurement(place, information, float(special.entr(weight).sum() / np.log(2)))


def _values_of(
    name: str, measured: FloatArray, ranges: Mapping[str, tuple[float, float]]
) -> FloatArray:
    known = np.unique(measured)
    # between its values a column such as a batch or the number of a sensor means nothing
    # an input with so few values, whole numbers in a row, counts things
    numbers = len(known) <= MAX_LEVELS and bool(np.all(np.diff(known) == 1) and known[0] % 1 == 0)
    if name in ranges and not numbers and name != OUTPUT:
        return np.linspace(*ranges[name], _N_PLACES)
    return known[np.linspace(0, len(known) - 1, min(len(known), _N_PLACES)).round().astype(int)]


def places_between(result: Search, ranges: Mapping[str, tuple[float, float]]) -> FloatArray:
    """Return places to choose a batch from, (m, n_columns): a grid, thinned where it is large.

    Parameters
    ----------
    result : Search
    ranges : dict of str to (low, high)
        As for `next_measurement`.
    """
    problem = result.problem
    axes = [
        _values_of(c, x, ranges) for c, x in zip(problem.model.columns, problem.X.T, strict=False)
    ]
    n = np.array([len(axis) for axis in axes])
    if np.prod(n.astype(float)) <= _MAX_PLACES:
        return np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=1)
    chosen = (qmc.Sobol(len(axes), rng=0).random(_MAX_PLACES) * n).astype(int)
    return np.stack([axis[k] for axis, k in zip(axes, chosen.T, strict=True)], axis=1)


def rows_as_table(result: Search, rows: FloatArray, experiments: Experiments) -> pd.DataFrame:
    """Return rows (m, n_columns) as a table, outputs and labels by name."""
    columns = list(result.problem.model.columns)
    table = pd.DataFrame(rows[:, : len(columns)], columns=columns)
    names = dict(experiments.labels)
    if result.problem.stacking is not None:
        names[OUTPUT] = result.problem.stacking.names
    for column, labels in names.items():
        table[column] = np.array(labels, dtype=object)[table[column].astype(int)]
    return table.rename(columns={OUTPUT: "output"})


def next_measurements(
    found: Search,
    fitted: Any,
    n: int,
    places: ArrayLike | None,
    cost: ArrayLike | Callable[[pd.DataFrame], ArrayLike] | None,
) -> pd.DataFrame:
    """Return where to take n further measurements together, as `DiscrepancyDiagnosis` does.

    Parameters
    ----------
    found : Search
        Whose alternatives are to be separated.
    fitted : PowerScaledSurrogate
        To the measured data.
    n : int
    places : array-like of shape (m, n_columns) or None
    cost : array-like of shape (m,), callable or None
    """
    if places is None:
        rows = places_between(found, fitted.data_.simulation.input_ranges)
    else:
        rows = fitted.checked_rows(places)
    table = rows_as_table(found, rows, fitted.data_.experiments)
    costs = costs_of(table, cost)
    chosen, bits = zip(*batch(found, rows, n, costs), strict=True)
    table = table.iloc[list(chosen)].reset_index(drop=True)
    return table.assign(information=bits, cost=costs[list(chosen)])


def costs_of(
    places: pd.DataFrame, cost: ArrayLike | Callable[[pd.DataFrame], ArrayLike] | None
) -> FloatArray:
    """Return the cost of a measurement at each place, (m,).

    Raises
    ------
    ValueError
        For costs that are not positive and finite, or not one for each place.
    """
    if cost is None:
        return np.ones(len(places))
    costs = as_numbers(cost(places) if callable(cost) else cost, "cost")
    if costs.shape != (len(places),):
        raise ValueError(
            f"cost must give one number for each of the {len(places)} places, got shape "
            f"{costs.shape}. Pass a function of the table of places, or places and cost together."
        )
    if not np.all(np.isfinite(costs) & (costs > 0)):
        raise ValueError("Costs must be positive and finite: leave out places that are no choice.")
    return costs


def batch(result: Search, places: FloatArray, n: int, cost: FloatArray) -> list[tuple[int, float]]:
    """Return where to take n measurements together: positions among places, and bits of each.

    Each in turn informs most, for its cost, about which alternative is true: given those before
    it, on average over their possible values. By the chain rule of mutual information the bits add
    up to the information of the batch. That is at least 63 % of the best batch of n where the
    alternatives' values are independent given the alternative (Krause and Guestrin 2005, UAI
    21:324). A place may be measured more than once.

    Parameters
    ----------
    result : Search
    places : ndarray of shape (m, n_columns)
    n : int
    cost : ndarray of shape (m,)
        Of one measurement there.
    """
    components = components_of(result)
    known = predictions_at(result, components, places)
    finite = np.isfinite(known.mean) & np.isfinite(known.variance_at(slice(None)))
    valid = finite.all(axis=0)
    # a smooth curve does not extrapolate where measurements end: see information_at
    blind = is_smooth(components, known.alternative)[:, None] & ~_between_measured(result, places)
    random = np.random.RandomState(0)
    # batches are simulated under each component in proportion to its weight
    true = np.searchsorted(np.cumsum(known.weight), (np.arange(_N_BATCHES) + 0.5) / _N_BATCHES)
    true = np.minimum(true, len(known.weight) - 1)
    mean = np.repeat(known.mean[None], _N_BATCHES, axis=0)
    odds = np.repeat(np.log(known.weight)[None], _N_BATCHES, axis=0)
    one_hot = known.alternative[:, None] == np.unique(known.alternative)
    chosen = []
    for _ in range(n):
        noise = random.standard_normal(_N_BATCHES)
        other = _seen(odds, np.any(blind, axis=1), true, random)
        before = _entropy(odds, one_hot).mean()
        bits = np.zeros(len(places))
        for k in np.flatnonzero(valid).tolist():
            source = np.where(blind[true, k], other, true)
            y = _value(known, mean, source, k, noise)
            after = odds + _log_density(known, mean, y, k, blind[:, k], odds)
            bits[k] = max(before - _entropy(after, one_hot).mean(), 0.0)
        best = int(np.argmax(bits / cost))
        chosen.append((best, float(bits[best])))
        source = np.where(blind[true, best], other, true)
        y = _value(known, mean, source, best, noise)
        odds = odds + _log_density(known, mean, y, best, blind[:, best], odds)
        known, mean = _conditioned(known, mean, y, best, blind[:, best])
    return chosen


def _seen(
    odds: FloatArray, blind: NDArray[Any], true: NDArray[np.intp], random: np.random.RandomState
) -> NDArray[np.intp]:
    """Return for each batch a component that predicts there, in proportion to its weight."""
    if not blind.any() or blind.all():
        return true
    weight = special.softmax(np.where(blind, -np.inf, odds), axis=1)
    below = np.cumsum(weight, axis=1) < random.uniform(size=(len(odds), 1))
    return np.minimum(below.sum(axis=1), np.flatnonzero(~blind)[-1])


def _value(
    known: Predictions, mean: FloatArray, source: NDArray[np.intp], k: int, noise: FloatArray
) -> FloatArray:
    sd = np.sqrt(known.variance_at(k))
    return np.asarray(mean[np.arange(len(source)), source, k] + sd[source] * noise)


def _log_density(
    known: Predictions,
    mean: FloatArray,
    y: FloatArray,
    k: int,
    blind: NDArray[np.bool_],
    odds: FloatArray,
) -> FloatArray:
    """Return the log density of values y (N,) at place k under each component, (N, C)."""
    variance = known.variance_at(k)
    out = -0.5 * (y[:, None] - mean[:, :, k]) ** 2 / variance - 0.5 * np.log(variance)
    if blind.any() and not blind.all():
        share = np.where(blind, -np.inf, odds)
        share = share - special.logsumexp(share, axis=1, keepdims=True)
        out = np.where(blind, special.logsumexp(share + out, axis=1, keepdims=True), out)
    return np.zeros_like(out) if blind.all() else out


def _conditioned(
    known: Predictions, mean: FloatArray, y: FloatArray, k: int, blind: NDArray[np.bool_]
) -> tuple[Predictions, FloatArray]:
    """Return the predictions once y (N,) was measured at place k: moments of a normal.

    The loadings become L (I - c v v'), with v those of place k, s their square and the variance
    together, and c = (1 - sqrt(1 - v'v / s)) / v'v, so that L L' loses L v v' L' / s.
    """
    v = np.where(blind[:, None], 0.0, known.loadings[:, k])
    square = np.sum(v**2, axis=1)
    total = square + known.variance[:, k]
    along = np.einsum("cmk,ck->cm", known.loadings, v)
    mean = mean + (along / total[:, None]) * (y[:, None] - mean[:, :, k])[:, :, None]
    c = (1 - np.sqrt(1 - square / total)) / np.where(square > 0, square, 1.0)
    loadings = known.loadings - c[:, None, None] * along[:, :, None] * v[:, None, :]
    return known._replace(loadings=loadings), mean


def _entropy(odds: FloatArray, one_hot: NDArray[np.bool_]) -> FloatArray:
    """Return the entropy (N,) of alternatives in bits, given log weights (N, C) of components."""
    shares = special.softmax(odds, axis=1) @ one_hot
    return np.asarray(special.entr(shares).sum(axis=1) / np.log(2))


def information_at(result: Search, grid: FloatArray) -> FloatArray:
    """Return the expected information of a measurement at each row about the alternatives, in bits.

    It is the mutual information between the alternative's identity and the value measured. Under
    each alternative this value follows a mixture of normals, one for each node of its grid. A
    smooth curve of unknown shape does not extrapolate. Where measurements end it is taken to
    predict what the others predict, so that nothing can be learned about it.

    Parameters
    ----------
    result : Search
    grid : ndarray of shape (m, n_columns)

    Returns
    -------
    ndarray of shape (m,)
    """
    return _information(result, components_of(result), grid)


def _information(result: Search, components: list[Component], grid: FloatArray) -> FloatArray:
    """Return the mutual information of alternative and value at each row, (m,)."""
    out = np.zeros(len(grid))
    inside = _between_measured(result, grid)
    # beyond the measured range each alternative has several amplitudes of what else may be lacking
    for where in (inside, ~inside):
        if where.any():
            out[where] = _of_rows(result, components, grid[where], bool(inside[where].all()))
    return out


def _of_rows(
    result: Search, components: list[Component], grid: FloatArray, inside: bool
) -> FloatArray:
    known = predictions_at(result, components, grid)
    smooth = is_smooth(components, known.alternative)
    share = 1.0
    if smooth.any() and not inside:
        if smooth.all():
            return np.zeros(len(grid))
        share = float(known.weight[~smooth].sum())
        known = known.of(~smooth)
    # a simulation may fail at a place, and a measurement there would give no information
    variance = known.variance_at(slice(None))
    valid = (np.isfinite(known.mean) & np.isfinite(variance)).all(axis=0)
    out = np.zeros(len(grid))
    n_values = _N_QUANTILES if inside else _N_QUANTILES_BEYOND
    where = np.flatnonzero(valid)
    for some in blocks(len(where), len(known.weight) ** 2 * n_values, LARGE_BLOCK):
        rows = where[some]
        args = known.mean[:, rows], variance[:, rows], known.weight, known.alternative
        out[rows] = share * _mutual(*args, n_values)
    return out


def _between_measured(result: Search, grid: FloatArray) -> NDArray[np.bool_]:
    X, grid = result.problem.X, result.problem.with_noise(grid)
    return np.all((grid >= X.min(axis=0)) & (grid <= X.max(axis=0)), axis=1)


def _mutual(
    means: FloatArray,
    variances: FloatArray,
    weight: FloatArray,
    alternative: NDArray[np.intp],
    n_values: int = _N_QUANTILES,
) -> FloatArray:
    """Return the mutual information of alternative and value, in bits, (m,).

    Components (C, m) are normal. At values of each the log density under its alternative is
    compared with that under all of them.
    """
    nodes, shares = np.polynomial.legendre.leggauss(n_values)
    sd = np.sqrt(variances)
    y = means[:, None] + special.ndtri((nodes + 1) / 2)[:, None] * sd[:, None]  # (C, Q, m)
    # densities of component c's points under component b, (C, B, Q m), relative to the largest
    z = (y[:, None] - means[None, :, None]) / sd[None, :, None]
    log_density = -0.5 * z**2 + (np.log(weight)[:, None] - np.log(sd))[None, :, None]
    log_density -= log_density.max(axis=1, keepdims=True)
    density = np.exp(log_density, out=log_density).reshape(*log_density.shape[:2], -1)
    same = (alternative[:, None] == alternative).astype(float)
    # an alternative whose share is too small for a number has a weight that is, too
    share = (same[:, None] @ density)[:, 0] / density.sum(axis=1)
    gained = np.log(np.maximum(share, np.finfo(float).tiny)).reshape(y.shape)
    gained = np.einsum("cqm,q->cm", gained - np.log(same @ weight)[:, None, None], shares / 2)
    return np.maximum(weight @ gained, 0.0) / np.log(2)


def next_runs(
    result: Search,
    posteriors: Sequence[Posterior],
    n: int,
    simulation: SimulationData | Simulator,
) -> pd.DataFrame:
    """Return the n runs that reduce uncertainty most where the models ask for the simulation.

    Each in turn reduces the remaining variance most, on average over draws of the posteriors and
    the best fits of the alternatives (Cohn 1996, Neural Networks 9:1071; as
    active learning of a Gaussian process: Gramacy 2020, Surrogates, section 6.2).

    Parameters
    ----------
    result : Search
    posteriors : sequence of Posterior
        Of the models before and after.
    n : int
    simulation : SimulationData
        The runs. One that fails, as some of these may have, reduces nothing.

    Returns
    -------
    DataFrame of n rows
        Where runs are curves without the input along which they are.

    Raises
    ------
    ValueError
        Where the simulation is run itself, or its surrogate has no uncertainty.
    """
    basis, X = result.problem.model.basis, result.problem.X
    if not (basis.leaves_open and isinstance(simulation, SimulationData)):
        raise ValueError(
            "The simulation is run itself, or its emulator has no uncertainty: no further run "
            "would add information."
        )
    asked = [
        model.places(X[:, : len(model.columns)], values)
        for model, values in _models(result, posteriors)
    ]
    inputs, omega = (np.concatenate(parts) for parts in zip(*asked, strict=True))
    kept = basis.of_runs(np.arange(float(inputs.shape[1]))[None])[0].astype(int).tolist()
    runs = np.unique(np.hstack([inputs[:, kept], omega]), axis=0)
    if len(runs) > _MAX_PLACES:
        runs = runs[np.random.default_rng(0).choice(len(runs), _MAX_PLACES, replace=False)]
    names = [*simulation.input_names, *simulation.parameter_ranges]
    points = np.zeros((len(runs), len(names)))
    points[:, [*kept, *range(inputs.shape[1], len(names))]] = runs
    share = 1 - Failures.of(simulation).probability(points)
    chosen = _settling(basis.open_at(runs[:, : len(kept)], runs[:, len(kept) :]), n, share)
    columns = [names[k] for k in kept] + list(names[inputs.shape[1] :])
    return pd.DataFrame(runs[chosen], columns=columns)


def _models(
    result: Search, posteriors: Sequence[Posterior]
) -> list[tuple[MeasuredModel, FloatArray]]:
    """Return models and draws of their values: of posteriors, and best fits of alternatives."""
    out: list[tuple[MeasuredModel, FloatArray]] = []
    for posterior in posteriors:
        out.append((posterior.model, posterior.thinned().values))
    for w, probability in zip(result.candidates, result.probability, strict=True):
        if probability > MIN_PROBABILITY:
            out.append((w.fit.model, w.fit.values))
    return out


def _settling(covariance: FloatArray, n: int, share: FloatArray | float = 1.0) -> NDArray[np.intp]:
    """Return n of the rows of a covariance, the one that takes most from all variances first.

    On average over whether it succeeds, of which ``share`` (n,) is the probability.
    """
    left = covariance.copy()
    chosen: list[int] = []
    least = 1e-9 * float(np.max(np.diagonal(covariance), initial=0.0))
    for _ in range(min(n, len(left))):
        variance = np.diagonal(left)
        gain = share * np.sum(left**2, axis=0) / np.maximum(variance, least)
        gain[chosen] = -np.inf
        k = int(np.argmax(gain))
        chosen.append(k)
        left = left - np.outer(left[:, k], left[k]) / max(float(variance[k]), least)
    return np.array(chosen, dtype=np.intp)
