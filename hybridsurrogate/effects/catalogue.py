"""Every cause that a diagnosis weighs, for one simulation and one set of measured columns."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from hybridsurrogate.effects.base import Cause, Context
from hybridsurrogate.effects.discrepancy_process import GaussianProcessDiscrepancy
from hybridsurrogate.effects.dynamics import DynamicDrift, DynamicTerm
from hybridsurrogate.effects.shapes import Bump, MissingInput, Offset, Periodic, Step, Trend
from hybridsurrogate.effects.simulation_faults import Gain, ParameterDrift, WrongConstant

# a shape over an input needs as many distinct values as it has numbers, and some to spare
_MIN_DISTINCT = {"trend": 3, "parameter-drift": 3, "step": 6, "periodic": 8, "bump": 8}
_MIN_ROWS = 4
# inside the dynamics: a step is a steep logistic course, a ramp nearly a slow one
_COURSES = ("logistic", "periodic")
_MIN_TIMES = 8


@dataclass(frozen=True)
class Skipped:
    """A cause that could not be weighed, and why."""

    kind: str
    target: str | None
    reason: str


def catalogue(context: Context, extra: Sequence[Cause] = ()) -> tuple[list[Cause], list[Skipped]]:
    """Return the prepared causes, and those left out with reasons.

    Parameters
    ----------
    context : Context
    extra : sequence of Cause
        The user's own mechanisms.
    """
    causes, skipped = [], []
    for cause in (*_built_in(context), *extra):
        reason = _reason_to_skip(cause, context)
        if reason:
            skipped.append(Skipped(cause.kind, cause.target, reason))
        else:
            causes.append(cause.prepare(context))
    if not context.assumed:
        skipped.append(Skipped("wrong-constant", None, "the simulation has no assumed constants"))
    if not context.parameters:
        skipped.append(Skipped("parameter-drift", None, "the simulation has no parameters"))
    if not context.states:
        reason = "inside the dynamics: needs an OdeSimulator and surrogate=ExactSurrogate()"
        skipped.append(Skipped("missing-term", None, reason))
    if not context.extras:
        skipped.append(Skipped("missing-input", None, "no measured column beside the inputs"))
    return causes, skipped


def _built_in(context: Context) -> Iterator[Cause]:
    yield Offset()
    yield Gain()
    for constant in context.assumed:
        yield WrongConstant(constant)
    for column in context.inputs:
        yield from (Trend(column), Periodic(column), Step(column), Bump(column))
        # a rate that changes in time does so inside the dynamics
        inside = context.rates if column == context.inputs[0] else ()
        for parameter in context.parameters:
            if parameter not in inside:
                yield ParameterDrift(parameter, column)
    yield from _inside_dynamics(context)
    for column in context.extras:
        yield MissingInput(column)
    yield GaussianProcessDiscrepancy()


def _inside_dynamics(context: Context) -> Iterator[Cause]:
    for rate in context.rates:
        for course in _COURSES:
            yield DynamicDrift(rate, course)
    for state in context.states:
        yield DynamicTerm(state, "constant")
        yield DynamicTerm(state, "proportional")


def _reason_to_skip(cause: Cause, context: Context) -> str | None:
    n = len(next(iter(context.X.values())))
    if n < _MIN_ROWS:
        return f"{n} rows are too few"
    if cause.kind == "offset" and context.log_scale:
        return "on a logarithmic scale a constant is a factor, weighed as gain"
    if cause.modification is not None and context.states:
        distinct = len(np.unique(context.X[context.inputs[0]]))
        if distinct < _MIN_TIMES:
            return f"{context.inputs[0]} has {distinct} distinct values, {_MIN_TIMES} are needed"
    column = getattr(cause, "column", None)
    if column is None or column not in context.X:
        return None
    distinct = len(np.unique(context.X[column]))
    needed = _MIN_DISTINCT.get(cause.kind, 2)
    if distinct < needed:
        return f"{column} has {distinct} distinct values, {needed} are needed"
    return None
