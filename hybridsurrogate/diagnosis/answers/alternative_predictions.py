"""Predictions of each alternative at any rows: jointly normal values, a set for each node."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from hybridsurrogate.diagnosis.search.candidate import Candidate
from hybridsurrogate.diagnosis.search.local_prediction import predict_jointly
from hybridsurrogate.diagnosis.search.search import Search
from hybridsurrogate.effects import Remainder
from hybridsurrogate.effects.output.remainder import LEAST, MOST
from hybridsurrogate.simulation.outputs import OUTPUT
from hybridsurrogate.types import FloatArray

# alternatives that matter to the answer, and nodes of each (a period, a location) that matter to it
_MOST_ALTERNATIVES, _LEAST_PROBABLE = 6, 0.003
_MOST_NODES, _LEAST_NODE = 4, 0.05
# Gauss and Legendre's three nodes of a remainder's amplitude, which is log-uniform
_HEIGHTS, _SHARES = np.polynomial.legendre.leggauss(3)
_AMPLITUDES = LEAST * (MOST / LEAST) ** ((_HEIGHTS + 1) / 2)


class Component(NamedTuple):
    """One alternative at one node of its grid.

    ``size`` (n_outputs,) is the root mean square of what it changes at the measured rows: beyond
    them the simulation may lack as much again (`Remainder`).
    """

    alternative: int
    candidate: Candidate
    node: int | None
    weight: float
    size: FloatArray


class Predictions(NamedTuple):
    """Values at m rows under C components: ``mean + loadings z + sd e``, z and e standard normal.

    ``mean`` (C, m), ``loadings`` (C, m, k), ``variance`` (C, m) of the noise alone, ``weight`` (C,)
    and ``alternative`` (C,) of each component.
    """

    mean: FloatArray
    loadings: FloatArray
    variance: FloatArray
    weight: FloatArray
    alternative: NDArray[np.intp]

    @property
    def total_variance(self) -> FloatArray:
        """Variance of a measured value, (C, m)."""
        return np.asarray(self.variance + np.sum(self.loadings**2, axis=2))

    def at(self, rows: Any) -> Predictions:
        """Return some of the rows."""
        return self._replace(
            mean=self.mean[:, rows],
            loadings=self.loadings[:, rows],
            variance=self.variance[:, rows],
        )

    def of(self, components: NDArray[np.bool_]) -> Predictions:
        """Return some of the components, their weights sharing all."""
        weight = self.weight[components]
        return Predictions(
            self.mean[components],
            self.loadings[components],
            self.variance[components],
            weight / weight.sum(),
            self.alternative[components],
        )


def components_of(result: Search) -> list[Component]:
    """Return the alternatives that matter at the nodes that matter, most probable first."""
    order = np.argsort(-result.probability, kind="stable")[:_MOST_ALTERNATIVES]
    matters = (np.arange(len(order)) < 2) | (result.probability[order] > _LEAST_PROBABLE)
    # against overwhelming evidence an alternative's probability is too small for a number
    matters &= result.probability[order] > 0
    order = order[matters]
    total = float(result.probability[order].sum())
    X, null = result.problem.X, result.candidates[0]
    plain = predict_jointly(result, null, X)[0]
    which = _outputs(result, X)
    n_outputs = 1 if result.problem.stacking is None else len(result.problem.stacking.names)
    counts = np.bincount(which, minlength=n_outputs)
    out = []
    for alternative, k in enumerate(order):
        w = result.candidates[k]
        change = predict_jointly(result, w, X)[0] - plain if w is not null else np.zeros(len(X))
        squares = np.bincount(which, change**2, n_outputs) / np.maximum(counts, 1)
        for node, share in _nodes(result, w):
            weight = share * float(result.probability[k]) / total
            out.append(Component(alternative, w, node, weight, np.sqrt(squares)))
    return out


def _outputs(result: Search, X: FloatArray) -> NDArray[np.intp]:
    columns = result.problem.model.columns
    if OUTPUT not in columns:
        return np.zeros(len(X), dtype=np.intp)
    return X[:, columns.index(OUTPUT)].astype(np.intp)


def _nodes(result: Search, w: Candidate) -> list[tuple[int | None, float]]:
    """Return the nodes with most of the evidence for a cause, with their shares."""
    if not len(w.fit.grid.nodes):
        return [(None, 1.0)]
    log_evidence = result.context.evidence_of_nodes(w.fit, result.sizes)
    share = special.softmax(log_evidence)
    order = np.argsort(-share)[:_MOST_NODES]
    order = order[share[order] >= _LEAST_NODE * share[order[0]]]
    return [(int(node), float(share[node] / share[order].sum())) for node in order]


def predictions_at(result: Search, components: list[Component], grid: FloatArray) -> Predictions:
    """Return the predictions of the components at rows, with a remainder beyond the measured range.

    Where a row lies beyond, each component becomes three, one for each amplitude.

    Parameters
    ----------
    result : Search
    components : list of Component
    grid : ndarray of shape (m, n_columns)
    """
    beyond = _beyond(result, grid)
    known = [predict_jointly(result, c.candidate, grid, c.node) for c in components]
    heights, shares = (_AMPLITUDES, _SHARES / 2) if beyond.any() else (np.zeros(1), np.ones(1))
    width = max(loadings.shape[1] for _, loadings, _ in known)
    of_output = _outputs(result, grid)
    parts = []
    for c, (mean, loadings, variance) in zip(components, known, strict=True):
        wide = np.pad(loadings, ((0, 0), (0, width - loadings.shape[1])))
        own = beyond * c.size[of_output][:, None]
        some = zip(heights, shares, strict=True) if own.any() else [(0.0, 1.0)]
        parts += [
            (mean, np.hstack([wide, height * own]), variance, c.weight * share, c.alternative)
            for height, share in some
        ]
    return Predictions(*map(np.array, zip(*parts, strict=True)))


def _beyond(result: Search, grid: FloatArray) -> FloatArray:
    """Return the columns of a remainder of unit size: of several outputs one set for each."""
    problem = result.problem
    columns = problem.model.columns
    inputs = [name for name in columns[: problem.model.n_inputs] if name != OUTPUT]
    measured = {name: problem.X[:, columns.index(name)] for name in inputs}
    ends = {name: (float(x.min()), float(x.max())) for name, x in measured.items()}
    remainder = Remainder(1.0, ranges={name: e for name, e in ends.items() if e[0] < e[1]})
    rows = {name: grid[:, columns.index(name)] for name in inputs}
    one = remainder.columns(rows, {"amplitude": np.ones(len(grid))})
    if problem.stacking is None:
        return one
    which = _outputs(result, grid)[:, None] == np.arange(len(problem.stacking.names))
    return np.asarray((which[:, :, None] * one[:, None, :]).reshape(len(grid), -1))


def is_smooth(components: list[Component], alternative: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Return which alternatives are a curve of unknown shape, (C,)."""
    smooth = {c.alternative for c in components if c.candidate.kind == "unexplained"}
    return np.isin(alternative, list(smooth))
