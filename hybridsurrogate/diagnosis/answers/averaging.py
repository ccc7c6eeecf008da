"""Predictions averaged over what may be the cause: normal values, a set an alternative."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from hybridsurrogate.diagnosis.search.candidate import MIN_PROBABILITY, Candidate
from hybridsurrogate.diagnosis.search.forward_selection import SearchStep
from hybridsurrogate.diagnosis.search.search import Search, predict_jointly
from hybridsurrogate.effects import InOutput, Remainder
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.effects.output.processes import LEAST, LEAST_OF_CURVE, MOST
from hybridsurrogate.estimators.averaged import AveragedSurrogate
from hybridsurrogate.estimators.power_scaled import PowerScaledSurrogate, as_causes
from hybridsurrogate.exceptions import DiagnosisWarning, HybridSurrogateWarning
from hybridsurrogate.simulation.outputs import OUTPUT
from hybridsurrogate.types import FloatArray


def with_remainder(
    before: PowerScaledSurrogate, after: PowerScaledSurrogate
) -> PowerScaledSurrogate:
    """Return a fitted extension with a `Remainder` as large as what it changed.

    Parameters
    ----------
    before, after : PowerScaledSurrogate
        Fitted to the same rows; after has causes as effects.
    """
    rows, stacking = before.data_.single.X[:, : len(before.data_.columns)], before.data_.stacking
    column = after.data_.experiments.column
    # errors that rows share leave the simulation the same in all
    effects = [one for one in after.posterior_.model.effects if one.changes_output]
    by = column if any(column in one.reads for one in effects) else None
    is_any_curve = any(effect.kind == "unexplained" for effect in as_causes(after.effects))
    least = LEAST_OF_CURVE if is_any_curve else LEAST
    change = np.mean(after.posterior_.eta(rows)[0], axis=0)
    change = change - np.mean(before.posterior_.eta(rows)[0], axis=0)
    names = ("",) if stacking is None else stacking.names
    which = np.zeros(len(rows)) if stacking is None else rows[:, stacking.at]
    remainders: list[Cause] = []
    for k, name in enumerate(names):
        size = float(np.sqrt(np.mean(change[which == k] ** 2)))
        if 0 < size < np.inf:  # else nothing has changed
            one = Remainder(size, least, by=by)
            remainders.append(one if stacking is None else InOutput(one, name))
    return after.with_prior_only(remainders)


# alternatives, and nodes of each (a period, a location), that an answer looks at
_MAX_ALTERNATIVES, _MAX_NODES = 6, 4
# what is less probable is not averaged over: on cases outside the catalogue that costs 0.01 nats a
# row beyond the data (standard error 0.01), and takes less than half of the fits. Nor is a node of
# a smaller share of the best one's evidence
_MIN_SHARE = 0.05
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

    def variance_at(self, rows: Any) -> FloatArray:
        """Return the variance of a measured value at some of the rows, (C, ...)."""
        loadings = self.loadings[:, rows]
        return np.asarray(self.variance[:, rows] + np.sum(loadings**2, axis=-1))

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
    order = np.argsort(-result.probability, kind="stable")[:_MAX_ALTERNATIVES]
    matters = (np.arange(len(order)) < 2) | (result.probability[order] > MIN_PROBABILITY)
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
    order = np.argsort(-share)[:_MAX_NODES]
    order = order[share[order] >= _MIN_SHARE * share[order[0]]]
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


Causes = tuple[Cause, ...]


def averaged_over(
    steps: Sequence[SearchStep],
    before: PowerScaledSurrogate,
    fitted: Callable[[Causes], PowerScaledSurrogate],
) -> AveragedSurrogate:
    """Return the average over possible causes, by probability, the accepted ones first.

    Each extension keeps a remainder beyond the measured range, as large as what it changes; of one
    by a curve of any shape the simulation takes the place there. A `DiagnosisWarning` lists what
    cannot be fitted together with the first.

    Parameters
    ----------
    steps : sequence of SearchStep
        Accepted.
    before : PowerScaledSurrogate
        Fitted without effects.
    fitted : callable
        Returns the estimator fitted with causes as effects.
    """
    models: list[PowerScaledSurrogate] = []
    weights: list[float] = []
    for causes, share in zip(*explanations(steps), strict=True):
        try:
            with warnings.catch_warnings():
                if models:
                    # of the rows the first fit has warned; doubtful draws are in the report
                    warnings.simplefilter("ignore", HybridSurrogateWarning)
                model = fitted(causes) if causes else before
                # excluded rows carry no information on the simulation elsewhere
                if not all(cause.concerns == "data" for cause in causes):
                    model = with_remainder(before, model)
        except ValueError as error:
            if not models:
                raise
            warnings.warn(
                f"{' and '.join(cause.name for cause in causes)}, with {100 * share:.0f} % of the "
                f"probability, could not be fitted and is not averaged over: {error}",
                DiagnosisWarning,
                stacklevel=6,
            )
            continue
        models.append(model)
        weights.append(share)
    has_curve = any(e.is_smooth_curve for one in models for e in as_causes(one.effects))
    beyond = before if has_curve else None
    return AveragedSurrogate.of_fitted(models, weights, before.random_state, beyond)


def explanations(steps: Sequence[SearchStep]) -> tuple[list[Causes], list[float]]:
    """Return the sets of causes that have at least 5 % of the probability, and their shares of it.

    The accepted ones come first; in each further one another cause, or none, stands
    in place of one of them. The probability of the others is conditional on those that stay, which
    gives their ratio to that of the accepted causes. Correlated noise stays with the causes
    that were compared given it and need it.

    Parameters
    ----------
    steps : sequence of SearchStep
        Accepted.
    """
    found = tuple(step.chosen.cause for step in steps if step.chosen.cause is not None)
    sets, ratios = [found], [1.0]
    for k, step in enumerate(steps):
        search = step.conditional
        held = [id(effect) for effect in search.problem.model.effects]
        free = [c for c in found if id(c) not in held and c is not found[k]]
        if not all(cause.is_correlated_noise for cause in free):
            continue
        others = [c for c in found if all(c is not other for other in free)]
        at = next(i for i, w in enumerate(search.candidates) if w.cause is found[k])
        for i, candidate in enumerate(search.candidates):
            if i == at:
                continue
            own = () if candidate.cause is None else (candidate.cause,)
            causes = tuple(c for old in others for c in (own if old is found[k] else (old,)))
            if search.correlated[i] > 0.5:
                # given the noise that the causes of this search were compared with
                paths = [
                    (w.log_evidence, w.cause)
                    for w in search.candidates
                    if w.cause is not None and w.cause.is_correlated_noise
                ]
                causes = (*causes, max(paths, key=lambda path: path[0])[1])
            sets.append(causes)
            ratios.append(float(search.probability[i] / search.probability[at]))
    shares = np.array(ratios) / np.sum(ratios)
    # the accepted ones come first, even where a cause was chosen for what it explains with a second
    order = [0, *(1 + np.argsort(-shares[1:], kind="stable"))]
    kept = [i for i in order if i == 0 or shares[i] >= _MIN_SHARE]
    return [sets[i] for i in kept], [float(shares[i]) for i in kept]
