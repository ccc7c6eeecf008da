"""The whole diagnosis once more, on some of the rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.random import RandomState
from numpy.typing import ArrayLike
from sklearn.base import clone

from hybridsurrogate.diagnosis.answers.averaging import averaged_over
from hybridsurrogate.diagnosis.answers.extension import extend_simulator
from hybridsurrogate.diagnosis.checks.parameters import Settings
from hybridsurrogate.diagnosis.search.candidate import Candidate
from hybridsurrogate.diagnosis.search.context import on_working_rows
from hybridsurrogate.diagnosis.search.forward_selection import SearchStep, forward_search
from hybridsurrogate.diagnosis.search.search import Search, local_posterior, measured_and_other
from hybridsurrogate.diagnosis.search.setup import prepare
from hybridsurrogate.diagnosis.validation.gain import in_one_word
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.effects.noise.outliers import GrossError, GrossRow
from hybridsurrogate.estimators.averaged import AveragedSurrogate
from hybridsurrogate.estimators.beta_path import fitted_near
from hybridsurrogate.estimators.power_scaled import (
    FitTask,
    PowerScaledSurrogate,
    as_causes,
    prepared,
)
from hybridsurrogate.model.posterior import FEW_DRAWS
from hybridsurrogate.model.problem import Problem
from hybridsurrogate.simulation.outputs import OUTPUT, AllOutputs
from hybridsurrogate.simulation.simulator import Simulator
from hybridsurrogate.types import FloatArray


def with_rows(causes: Sequence[Cause], steps: Sequence[SearchStep]) -> tuple[Cause, ...]:
    """Return causes in which a `GrossError` has the detected rows; others are as they are.

    Parameters
    ----------
    causes : sequence of Cause
        Of the searches.
    steps : sequence of SearchStep

    Examples
    --------
    >>> import hybridsurrogate as hs
    >>> causes = (hs.Offset(),)
    >>> with_rows(causes, []) == causes
    True
    """
    return tuple(
        _found(cause, steps) if isinstance(cause, GrossError) else cause for cause in causes
    )


def _found(cause: GrossError, steps: Sequence[SearchStep]) -> Cause:
    for step in steps:
        for search in (step.conditional, step.search):
            for w in search.candidates:
                if w.cause is cause:
                    return cause.filled(rows=excluded_rows(search, w))
    return cause


def excluded_rows(search: Search, w: Candidate) -> tuple[GrossRow, ...]:
    """Return the rows that are unlike the others, with what all others predict there.

    Parameters
    ----------
    search : Search
    w : Candidate
        Of its candidates, with a `GrossError`.
    """
    cause, problem = w.cause, search.problem
    assert isinstance(cause, GrossError)
    positions = cause.at(float(w.fit.grid.points[w.fit.mode.node, 0]))
    rows, _ = measured_and_other(search, w, problem.X[:0])
    local = local_posterior(search, w, rows, float(search.sizes[-1]))
    simulation = slice(0, rows.first)
    design = rows.design[positions, simulation]
    eta = rows.offset[positions] + design @ local.mean[simulation]
    predicted = problem.likelihood.inverse(eta)
    columns = problem.model.columns
    return tuple(
        GrossRow(
            int(i) + 1,
            tuple(zip(columns, problem.X[i, : len(columns)].tolist(), strict=True)),
            float(problem.observed[i]),
            float(predicted[k]),
        )
        for k, i in enumerate(positions)
    )


class Pair(NamedTuple):
    """The models before and after, fitted to the same rows, and what the search chose."""

    before: PowerScaledSurrogate
    after: PowerScaledSurrogate | AveragedSurrogate
    kind: str


@dataclass(frozen=True)
class Refit:
    """Search and extension, repeated on some of the rows: selection is part of what is scored.

    Attributes
    ----------
    estimator : PowerScaledSurrogate
        The model before, not fitted.
    settings : Settings
    found : sequence of Search
        On all rows, the first one first: its emulator comes from the runs alone, which are the
        same in each fold, and optimisations start where theirs ended.
    n_causes : int
        At most, as many as in all rows.
    fitted : Pair
        On all rows: fits of the same causes start from their proposals.
    """

    estimator: PowerScaledSurrogate
    settings: Settings
    found: Sequence[Search]
    n_causes: int
    fitted: Pair

    def __call__(
        self,
        X: ArrayLike,
        y: ArrayLike,
        weights: FloatArray | None = None,
        y_err: FloatArray | None = None,
    ) -> Pair:
        """Return the models before and after for these rows."""
        task = prepared(clone(self.estimator), X, y, weights, y_err)
        before = coarsely_fitted(task, self.fitted.before)
        settings = self.settings
        setup = prepare(before, settings.causes, settings.exclude, settings.max_causes)
        basis = self.found[0].problem.model.basis
        problem = replace(setup.problem, model=replace(setup.problem.model, basis=basis))
        problem = on_working_rows(problem, before.posterior_)
        steps = forward_search(
            problem,
            setup.causes,
            self.found[0].context.emulator,
            self.n_causes,
            settings.false_alarm_rate,
            None,
            # without replicates nothing in a search is random
            RandomState(0),
            self.found,
        )
        kind = in_one_word([step.chosen.kind for step in steps])
        if not accepted(steps):
            return Pair(before, before, kind)
        known = as_causes(self.estimator.effects)
        # the extensions that were fitted to all rows, by the causes in them
        after = self.fitted.after
        models = after.estimators_ if isinstance(after, AveragedSurrogate) else []
        elsewhere = {_forms(added_causes(one, self.estimator)): one for one in models}

        def fitted(causes: tuple[Cause, ...]) -> PowerScaledSurrogate:
            extended = task.with_effects((*known, *with_rows(causes, steps)))
            return coarsely_fitted(extended, elsewhere.get(_forms(causes)))

        return Pair(before, averaged_over(steps, before, fitted), kind)


def _forms(causes: Sequence[Cause]) -> tuple[tuple[str, str], ...]:
    return tuple((cause.name, cause.variant) for cause in causes)


def coarsely_fitted(
    task: FitTask, near: PowerScaledSurrogate | None = None
) -> PowerScaledSurrogate:
    """Fit one of many models by few importance draws, trusted or not.

    Where these were not to be trusted, predictions beyond the data were 0.04 standard deviations
    from those of a long ensemble; those of an ensemble of 1000 steps, which takes 15 times as long,
    0.12. The proposals are those of ``near``, fitted to all rows, if these serve.
    """
    one, is_auto = task.estimator, task.estimator.sampler == "auto"
    task = task.with_settings(
        n_draws=min(int(one.n_draws), FEW_DRAWS), sampler="importance" if is_auto else one.sampler
    )
    known = fitted_near(task, near) if near is not None and is_auto else None
    return task.fit() if known is None else known


def added_causes(extended: PowerScaledSurrogate, before: PowerScaledSurrogate) -> tuple[Cause, ...]:
    """Return the causes that an extended estimator has in addition to known effects."""
    learned = [effect for effect in as_causes(extended.effects) if effect.is_learned]
    return tuple(learned[len(as_causes(before.effects)) :])


def accepted(steps: Sequence[SearchStep]) -> tuple[Cause, ...]:
    """Return the causes that a forward search accepted."""
    return tuple(step.chosen.cause for step in steps if step.is_accepted and step.chosen.cause)


def extended_estimator(
    before: PowerScaledSurrogate, steps: Sequence[SearchStep]
) -> PowerScaledSurrogate | AveragedSurrogate:
    """Return the estimator extended by what may be missing, fitted; the one before for nothing.

    The average over the probable causes, the accepted ones first and with all draws, each with a
    remainder beyond the measured range.
    """
    found = accepted(steps)
    if not found:
        return before
    task, known = FitTask.of_fitted(before), as_causes(before.effects)

    def fitted(causes: tuple[Cause, ...]) -> PowerScaledSurrogate:
        one = task.with_effects((*known, *with_rows(causes, steps)))
        return one.fit() if causes == found else coarsely_fitted(one)

    return averaged_over(steps, before, fitted)


def extended_simulator(
    simulator: Simulator | None, causes: Sequence[Cause], problem: Problem
) -> Simulator | None:
    """Return the user's simulation with all causes in it.

    None where there are only runs, or nothing to add.
    """
    changes = [c for c in causes if c.kind != "unexplained" and c.changes_output]
    inside = [c for c in changes if c.modification is not None]
    moving = [c for c in changes if c.modification is None and "inputs" in c.acts_on]
    outside = [c for c in changes if "inputs" not in c.acts_on]
    # a factor acts on the simulation alone, not on what other causes add to it
    outside.sort(key=lambda cause: not cause.touches_simulation)
    if simulator is None or not changes:
        return None
    for cause in inside:
        simulator = extend_simulator(simulator, cause, problem)
    if problem.stacking is None or not (moving or outside):
        return _wrapped(simulator, moving, outside, problem)
    names = problem.stacking.names
    single = _wrapped(simulator.single_output(np.ones(len(names))), moving, outside, problem)
    inputs = {name: ends for name, ends in single.input_ranges.items() if name != OUTPUT}
    function = AllOutputs(single, names)
    return Simulator(function, inputs, single.parameters, single.assumed, names)


def _wrapped(
    simulator: Simulator, moving: Sequence[Cause], outside: Sequence[Cause], problem: Problem
) -> Simulator:
    # each wraps those before it, and the first cause moves the rows first
    for cause in [*reversed(moving), *outside]:
        simulator = extend_simulator(simulator, cause, problem)
    return simulator
