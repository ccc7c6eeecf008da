"""Where one more measurement would best tell the rivals apart, and how much it would tell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from hybridsurrogate.diagnosis.search.evidence import Candidate, Search, kind_of
from hybridsurrogate.diagnosis.search.local_prediction import predict_locally
from hybridsurrogate.inference.evidence.linearised import linearise
from hybridsurrogate.inference.evidence.marginal_likelihood import scan
from hybridsurrogate.priors import FloatArray
from hybridsurrogate.simulation.outputs import OUTPUT

# rivals that matter to the answer, and nodes of each (a period, a location) that matter to it
_MOST_RIVALS, _LEAST_PROBABLE = 6, 0.003
_MOST_NODES, _LEAST_NODE = 4, 0.05
# values of the new measurement under each component: Gauss and Legendre's nodes of its cumulative
# probability, which serve narrow rivals beside wide ones as well as rivals that are alike
_NODES, _SHARES = np.polynomial.legendre.leggauss(24)
_VALUES, _SHARES = special.ndtri((_NODES + 1) / 2), _SHARES / 2
# an input with so few values, whole numbers in a row, counts things
_MOST_NUMBERED = 6
_N_PLACES, _SWEEPS, _AS_GOOD = 60, 2, 0.98


@dataclass(frozen=True)
class NextMeasurement:
    """The place, and what a measurement there is expected to tell.

    Attributes
    ----------
    place : dict of str to float
        Value of each measured column; of several outputs also "output", the name of one.
    information : float
        Expected reduction of the uncertainty about which rival is true, in bits.
    uncertainty : float
        What there is to reduce: the entropy of the rivals' probabilities, in bits.
    """

    place: dict[str, Any]
    information: float
    uncertainty: float


class _Component(NamedTuple):
    """One rival at one node of its grid."""

    rival: int
    candidate: Candidate
    node: int | None
    weight: float


def next_measurement(result: Search, ranges: Mapping[str, tuple[float, float]]) -> NextMeasurement:
    """Return where one more measurement is expected to tell most about which rival is true.

    A grid over each column in turn, the others where they were best so far, twice over.

    Parameters
    ----------
    result : Search
    ranges : dict of str to (low, high)
        Of the simulated inputs; other columns, and inputs that number a few things (0 and 1, say),
        keep to values that were measured.
    """
    problem = result.problem
    columns = problem.model.columns
    components = _components(result)
    point = np.median(problem.X, axis=0)
    if problem.stacking is not None:
        point[problem.stacking.at] = 0.0
    information = 0.0
    for _ in range(_SWEEPS if len(columns) > 1 else 1):
        for k, name in enumerate(columns):
            values = _values_of(name, problem.X[:, k], ranges)
            grid = np.repeat(point[None], len(values), axis=0)
            grid[:, k] = values
            # where nothing at all is foreseen, nothing can be told either
            bits = np.nan_to_num(_information(result, components, grid))
            # of places that are as good, the one nearest to what is known
            good = np.flatnonzero(bits >= _AS_GOOD * bits.max())
            best = good[np.argmin(np.abs(grid[good, k] - point[k]))]
            point, information = grid[best], float(bits[best])
    place: dict[str, Any] = dict(zip(columns, point.tolist(), strict=False))
    if problem.stacking is not None:
        place["output"] = problem.stacking.names[int(place.pop(OUTPUT))]
    weight = np.bincount([c.rival for c in components], [c.weight for c in components])
    return NextMeasurement(place, information, float(special.entr(weight).sum() / np.log(2)))


def _values_of(
    name: str, measured: FloatArray, ranges: Mapping[str, tuple[float, float]]
) -> FloatArray:
    known = np.unique(measured)
    # between its values a column such as a batch or the number of a sensor means nothing
    numbers = len(known) <= _MOST_NUMBERED and bool(
        np.all(np.diff(known) == 1) and known[0] % 1 == 0
    )
    if name in ranges and not numbers and name != OUTPUT:
        return np.linspace(*ranges[name], _N_PLACES)
    return known[np.linspace(0, len(known) - 1, min(len(known), _N_PLACES)).round().astype(int)]


def information_at(result: Search, grid: FloatArray) -> FloatArray:
    """Return how much a measurement at each row is expected to tell about the rivals, in bits.

    It is the mutual information between the rival's identity and the value measured. Under each
    rival this value follows a mixture of normals, one for each node of the rival's grid. Where the
    measurements end, a smooth curve of unknown shape foresees nothing: there it is taken to expect
    whatever the others expect, so that nothing can be learned about it.

    Parameters
    ----------
    result : Search
    grid : ndarray of shape (m, n_columns)

    Returns
    -------
    ndarray of shape (m,)
    """
    return _information(result, _components(result), grid)


def _components(result: Search) -> list[_Component]:
    order = np.argsort(-result.probability, kind="stable")[:_MOST_RIVALS]
    matters = (np.arange(len(order)) < 2) | (result.probability[order] > _LEAST_PROBABLE)
    # against overwhelming evidence a rival's probability is too small for a number
    matters &= result.probability[order] > 0
    order = order[matters]
    total = float(result.probability[order].sum())
    out = []
    for rival, k in enumerate(order):
        w = result.candidates[k]
        for node, share in _nodes(result, w):
            out.append(_Component(rival, w, node, share * float(result.probability[k]) / total))
    return out


def _nodes(result: Search, w: Candidate) -> list[tuple[int | None, float]]:
    """Return the nodes that hold most of the evidence for a cause, with their shares."""
    if not len(w.grid.nodes):
        return [(None, 1.0)]
    problem = result.problem
    parts = linearise(w.model, problem.X, result.emulator, w.grid, w.mode.z)
    log_evidence = scan(parts, problem.y[None], w.sigma, result.noise, result.sizes)[0]
    share = special.softmax(log_evidence)
    order = np.argsort(-share)[:_MOST_NODES]
    order = order[share[order] >= _LEAST_NODE * share[order[0]]]
    return [(int(node), float(share[node] / share[order].sum())) for node in order]


def _information(result: Search, components: list[_Component], grid: FloatArray) -> FloatArray:
    smooth = np.array([kind_of(c.candidate) == "unexplained" for c in components])
    weight = np.array([c.weight for c in components])
    rival = np.array([c.rival for c in components])
    predictions = [predict_locally(result, c.candidate, grid, c.node) for c in components]
    means, variances = map(np.array, zip(*predictions, strict=True))
    # a simulation may fail at a place, and a measurement there would tell nothing
    valid = np.isfinite(means).all(axis=0) & np.isfinite(variances).all(axis=0)
    out = np.zeros(len(grid))
    inside = _between_measured(result, grid) if smooth.any() else np.ones(len(grid), dtype=bool)
    if (where := valid & inside).any():
        out[where] = _mutual(means[:, where], variances[:, where], weight, rival)
    others = weight[~smooth]
    if (where := valid & ~inside).any() and len(others):
        known = np.ix_(~smooth, where)
        share = others.sum()
        bits = _mutual(means[known], variances[known], others / share, rival[~smooth])
        out[where] = share * bits
    return out


def _between_measured(result: Search, grid: FloatArray) -> NDArray[np.bool_]:
    X, grid = result.problem.X, result.problem.with_noise(grid)
    return np.all((grid >= X.min(axis=0)) & (grid <= X.max(axis=0)), axis=1)


def _mutual(
    means: FloatArray, variances: FloatArray, weight: FloatArray, rival: FloatArray
) -> FloatArray:
    """Return the mutual information of rival and value, in bits, (m,).

    Components (C, m) are normal. At values of each the log density under its rival is compared
    with that under all of them.
    """
    sd = np.sqrt(variances)
    y = means[:, None] + _VALUES[:, None] * sd[:, None]  # (C, Q, m)
    # densities of component c's points under component b, (C, B, Q, m)
    z = (y[:, None] - means[None, :, None]) / sd[None, :, None]
    log_density = -0.5 * z**2 - np.log(sd)[None, :, None]
    log_density += np.log(weight)[None, :, None, None]
    total = special.logsumexp(log_density, axis=1)
    same = rival[:, None] == rival
    own = special.logsumexp(log_density, axis=1, b=same[:, :, None, None].astype(float))
    prior = np.log(same @ weight)[:, None, None]
    gained = np.einsum("cqm,q->cm", own - prior - total, _SHARES)
    return np.maximum(weight @ gained, 0.0) / np.log(2)
