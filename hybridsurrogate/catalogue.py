"""Every cause that a diagnosis weighs, for one simulation and one set of measured columns."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from hybridsurrogate.effects.base import Cause, Context
from hybridsurrogate.effects.dynamics.dynamic_delay import DynamicDelay
from hybridsurrogate.effects.dynamics.dynamic_drift import DynamicDrift
from hybridsurrogate.effects.dynamics.dynamic_term import DynamicTerm
from hybridsurrogate.effects.inputs.delay import Delay
from hybridsurrogate.effects.noise.autocorrelation import Autocorrelation
from hybridsurrogate.effects.noise.noise import Noise
from hybridsurrogate.effects.noise.noise_of_mean import NoiseOfMean
from hybridsurrogate.effects.noise.outliers import Outliers
from hybridsurrogate.effects.output.bump import Bump
from hybridsurrogate.effects.output.decay import Decay
from hybridsurrogate.effects.output.discrepancy_process import GaussianProcessDiscrepancy
from hybridsurrogate.effects.output.interaction import Interaction
from hybridsurrogate.effects.output.missing_input import MissingInput, trouble_with_levels
from hybridsurrogate.effects.output.offset import Offset
from hybridsurrogate.effects.output.periodic import Periodic
from hybridsurrogate.effects.output.ramp import Ramp
from hybridsurrogate.effects.output.saturation import Saturation
from hybridsurrogate.effects.output.step import Step
from hybridsurrogate.effects.output.trend import Trend
from hybridsurrogate.effects.parameters.gain import Gain
from hybridsurrogate.effects.parameters.parameter_drift import ParameterDrift
from hybridsurrogate.effects.parameters.wrong_constant import WrongConstant

# what may be excluded: "none" and "unexplained" are always weighed
KINDS = (
    *("offset", "trend", "periodic", "step", "ramp", "bump", "decay", "saturation", "gain"),
    *("wrong-constant", "parameter-drift", "missing-input", "missing-term", "interaction"),
    *("delay", "noise"),
)

# a shape over a column needs as many distinct values as it has numbers, and some to spare; a kind's
# own word stands for its plain form, a second word for each other form
_MIN_DISTINCT = {
    "trend": 3,
    "trend: quadratic": 4,
    "parameter-drift": 3,
    "parameter-drift: step": 6,
    "parameter-drift: logistic": 8,
    "parameter-drift: periodic": 8,
    "step": 6,
    "ramp": 6,
    "decay": 6,
    "saturation": 6,
    "periodic": 8,
    "periodic: overtone": 12,
    "bump": 8,
    "missing-input: quadratic": 4,
    "missing-input: with offset": 3,
    "noise: autocorrelation": 12,
}
# a shift is one number and no shape, but one from label to label means nothing
_MIN_DISTINCT_OF_LABELS = 5
_MIN_ROWS = 4
# two standard deviations are compared, and those of a few rows say nothing
_MIN_ROWS_OF_NOISE = 8

# inside the dynamics: a step is a steep logistic course, a ramp is within a twentieth of one
_COURSES = ("logistic", "exponential", "periodic")
_MIN_TIMES = 8
# of its span a column may begin so far from zero to be one that is measured from there
_NEAR_ZERO = 0.25


@dataclass(frozen=True)
class Skipped:
    """A cause that could not be weighed, and why."""

    kind: str
    target: str | None
    reason: str


def catalogue(
    context: Context,
    extra: Sequence[Cause] = (),
    excluded: Collection[str] = (),
    alone: bool = True,
) -> tuple[list[Cause], list[Skipped]]:
    """Return the prepared causes, and those left out with reasons.

    Parameters
    ----------
    context : Context
    extra : sequence of Cause
        The user's own mechanisms; one replaces the built-in cause of its form and target.
    excluded : collection of str
        Kinds of which no built-in cause is weighed.
    alone : bool, default=True
        One cause has to explain everything. Otherwise an offset beside a missing input is a cause
        of its own.
    """
    causes: list[Cause] = []
    skipped = [Skipped(kind, None, "you excluded it") for kind in excluded]
    own = {(cause.kind, cause.variant, cause.target) for cause in extra}
    built_in = [
        (form, cause)
        for form, cause in _built_in(context, alone)
        if cause.kind not in excluded and (cause.kind, cause.variant, cause.target) not in own
    ]
    for form, cause in (*built_in, *((cause.kind, cause) for cause in extra)):
        reason = _reason_to_skip(form, cause, context)
        if reason:
            skipped.append(Skipped(cause.kind, cause.target, _with_form(form, reason)))
        else:
            causes.append(cause.prepare(context))
    skipped += [one for one in _impossible(context) if one.kind not in excluded]
    # forms of one kind may lack the same
    return causes, list(dict.fromkeys(skipped))


def _built_in(context: Context, alone: bool) -> Iterator[tuple[str, Cause]]:
    yield "offset", Offset()
    yield "gain", Gain()
    for constant in context.assumed:
        yield "wrong-constant", WrongConstant(constant)
    for column in context.inputs:
        # sensors side by side, or the standards of a calibration
        if trouble_with_levels(context.X[column], column) is None:
            for level in np.unique(context.X[column]):
                yield "offset: level", Offset(column, float(level))
        yield "trend", Trend(column)
        yield "trend: quadratic", Trend(column, degree=2)
        yield "periodic", Periodic(column)
        yield "periodic: overtone", Periodic(column, harmonics=2)
        yield "step", Step(column)
        yield "step", Step(column, before=True)
        yield "ramp", Ramp(column)
        yield "bump", Bump(column)
        yield "decay", Decay(column)
        yield "saturation", Saturation(column)
        yield "delay", Delay(column)
        # a rate that changes in time does so inside the dynamics, and a start is of one moment
        elsewhere = (*context.rates, *context.starts) if column == context.inputs[0] else ()
        for parameter in context.parameters:
            if parameter in elsewhere:
                continue
            yield "parameter-drift", ParameterDrift(parameter, column)
            for shape in ("step", "logistic", "periodic"):
                yield f"parameter-drift: {shape}", ParameterDrift(parameter, column, shape)
    for rate in context.rates:
        for course in _COURSES:
            yield "parameter-drift: inside", DynamicDrift(rate, course)
    for state in context.states:
        yield "missing-term", DynamicTerm(state, "constant")
        yield "missing-term", DynamicTerm(state, "proportional")
        yield "missing-term", DynamicTerm(state, "seasonal")
        yield "delay", DynamicDelay(state)
    for first, second in combinations(context.inputs, 2):
        yield "interaction", Interaction(first, second)
        if _begins_at_zero(context.X[first]) and _begins_at_zero(context.X[second]):
            yield "interaction", Interaction(first, second, centers=(0.0, 0.0))
    for column in context.extras:
        # its order may mean something: a time, a row number
        yield "step", Step(column)
        yield "step", Step(column, before=True)
        yield "periodic", Periodic(column)
        yield "missing-input", MissingInput(column)
        yield "missing-input: quadratic", MissingInput(column, shape="quadratic")
        yield "missing-input: categorical", MissingInput(column, shape="categorical")
        if alone:
            yield "missing-input: with offset", MissingInput(column, offset=True)
        levels = np.unique(context.X[column])
        if len(levels) > 2 and _begins_at_zero(context.X[column]):
            # such as a dose, where the simulation knows none
            yield "missing-input", MissingInput(column, center=0.0)
        if trouble_with_levels(context.X[column], column) is None:
            for level in levels:
                one = MissingInput(column, shape="categorical", level=float(level))
                yield "missing-input: level", one
        for parameter in context.parameters:
            yield "parameter-drift: over extras", ParameterDrift(parameter, column)
    for column in context.X:
        yield "noise", Noise(column)
    # neighbours along a column that orders nothing err together only where a curve is missing
    for column in context.inputs[:1]:
        yield "noise: autocorrelation", Autocorrelation(column)
    yield "noise: mean", NoiseOfMean()
    yield "noise: tails", Outliers()
    yield "unexplained", GaussianProcessDiscrepancy()


def _begins_at_zero(values: np.ndarray) -> bool:
    """Tell whether a column ends near zero, and is never on the other side of it."""
    low, high = values.min(), values.max()
    ends = sorted(abs(end) for end in (low, high))
    return bool(low * high >= 0 and ends[0] <= _NEAR_ZERO * (high - low))


def _reason_to_skip(form: str, cause: Cause, context: Context) -> str | None:
    n = len(next(iter(context.X.values())))
    needed_rows = _MIN_ROWS_OF_NOISE if form.startswith("noise") else _MIN_ROWS
    if n < needed_rows:
        return f"{n} rows are too few"
    if form == "offset" and context.log_scale:
        return "on a logarithmic scale a constant is a factor, weighed as gain"
    if cause.has_outliers and not context.gaussian:
        return "the likelihood is not normal, and outliers are part of it or impossible"
    if cause.touches_noise and not context.scales_noise:
        return "the likelihood has no scale of the noise that could change"
    if cause.modification is not None and context.states:
        distinct = len(np.unique(context.X[context.inputs[0]]))
        if distinct < _MIN_TIMES:
            return f"{context.inputs[0]} has {distinct} distinct values, {_MIN_TIMES} are needed"
        if cause.modification.looks_back and not context.remembers:
            return "inside the dynamics: needs an OdeSimulator with method='rk4'"
    if form == "missing-input: categorical":
        return _trouble_with_categories(context.X[cause.reads[0]], cause.reads[0])
    for column in cause.reads:
        if column not in context.X:
            continue
        values = np.unique(context.X[column])
        needed = _MIN_DISTINCT.get(form, 2)
        if len(values) < needed:
            return f"{column} has {len(values)} distinct values, {needed} are needed"
        if form == "delay" and _may_be_labels(values):
            return (
                f"{column} has {len(values)} distinct values one apart, which may be labels; "
                f"{_MIN_DISTINCT_OF_LABELS} are needed"
            )
    return None


def _may_be_labels(distinct: np.ndarray) -> bool:
    """Tell whether values, rising, are few whole numbers side by side, such as those of sensors."""
    few = len(distinct) < _MIN_DISTINCT_OF_LABELS
    return few and bool(np.all(distinct == np.round(distinct)) and np.all(np.diff(distinct) == 1))


def _trouble_with_categories(values: np.ndarray, column: str) -> str | None:
    if len(np.unique(values)) == 2:
        return f"{column} has 2 distinct values: a straight line over it says the same"
    return trouble_with_levels(values, column)


def _with_form(form: str, reason: str) -> str:
    """Return the reason, preceded by the form where it is not the plain one."""
    _, _, other = form.partition(": ")
    return f"{other}: {reason}" if other else reason


def _impossible(context: Context) -> Iterator[Skipped]:
    """Yield the kinds for which the simulation or the data have nothing to try."""
    if not context.assumed:
        yield Skipped("wrong-constant", None, "the simulation has no assumed constants")
    if not context.parameters:
        yield Skipped("parameter-drift", None, "the simulation has no parameters")
    for parameter in context.starts:
        reason = f"over {context.inputs[0]}: it sets the initial state and nothing else"
        yield Skipped("parameter-drift", parameter, reason)
    if not context.states:
        reason = "inside the dynamics: needs an OdeSimulator and surrogate=ExactSurrogate()"
        yield Skipped("missing-term", None, reason)
    if not context.extras:
        reason = "no measured column beside the inputs"
        yield Skipped("missing-input", None, reason)
        if context.parameters:
            yield Skipped("parameter-drift", None, f"over extras: {reason}")
    if len(context.inputs) < 2:
        yield Skipped("interaction", None, "a product needs two inputs, the simulation has one")
    for column in context.extras:
        trouble = trouble_with_levels(context.X[column], column)
        if trouble:
            yield Skipped("missing-input", column, f"level: {trouble}")
