"""Every cause that a diagnosis compares, for one simulation and one set of measured columns."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hybridsurrogate.effects.base import Cause, Context
from hybridsurrogate.effects.registry import FORMS, Form
from hybridsurrogate.effects.wrapped import InOutput, of_all_outputs, of_output

# distinct times that a change inside an ODE needs: one that is placed in time, and any other
_MIN_TIMES_PLACED, _MIN_TIMES = 8, 3


@dataclass(frozen=True)
class Skipped:
    """A cause that could not be compared, and why."""

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
        User-defined causes; one replaces the built-in cause of its form and target.
    excluded : collection of str
        Kinds of which no built-in cause is compared.
    alone : bool, default=True
        One cause has to explain everything. Otherwise an offset in addition to a missing input is
        a separate cause.
    """
    if context.outputs:
        return _of_outputs(context, extra, excluded, alone)
    causes: list[Cause] = []
    skipped = [Skipped(kind, None, "you excluded it") for kind in excluded]
    own = {(cause.kind, cause.variant, cause.target) for cause in extra}

    users = [(FORMS.get(cause.kind, Form(cause.kind, type(cause))), cause) for cause in extra]
    built_in = [
        (form, cause)
        for form in FORMS.values()
        if form.kind not in excluded and (alone or not form.only_alone)
        for cause in form.propose(context)
        if (cause.kind, cause.variant, cause.target) not in own
    ]
    left_out: list[tuple[Form, str | None, str]] = []
    for form, cause in (*built_in, *users):
        if reason := _reason_to_skip(form, cause, context):
            left_out.append((form, cause.target, reason))
        else:
            causes.append(cause.prepare(context))
    for form in FORMS.values():
        if form.kind not in excluded:
            left_out += [(form, target, reason) for target, reason in form.lacking(context)]
    for form, target, reason in left_out:
        # the form where it is not the plain one
        word = form.name.partition(": ")[2].partition(",")[0]
        whole = f"{word}: {reason}" if word and not reason.startswith(word) else reason
        one = Skipped(form.kind, target, whole)
        # what the plain form lacks is not said again of another form of its kind
        if one not in skipped and replace(one, reason=reason) not in skipped:
            skipped.append(one)
    return causes, skipped


def _of_outputs(
    context: Context, extra: Sequence[Cause], excluded: Collection[str], alone: bool
) -> tuple[list[Cause], list[Skipped]]:
    """Return the causes in what several outputs share, then those in each of them.

    What moves the simulation's inputs or parameters concerns all, anything else one output.
    """
    inside = [cause for cause in extra if cause.output is not None]
    further = [cause for cause in extra if cause.output is None]
    shared, skipped = catalogue(of_all_outputs(context), further, excluded, alone)
    causes = [cause for cause in shared if "inputs" in cause.acts_on]
    for position, name in enumerate(context.outputs):
        here = [cause.inner for cause in inside if cause.output == name]
        own, missing = catalogue(of_output(context, position), [*here, *further], excluded, alone)
        for cause in own:
            what = ""
            if "outliers" in cause.acts_on or cause.concerns == "data":
                what = "outliers are" if "outliers" in cause.acts_on else "single rows are"
            elif "overdispersion" in cause.acts_on:
                what = "overdispersion is"
            if what:
                reason = f"{what} not compared in one of several outputs"
                missing.append(Skipped(cause.kind, cause.target, reason))
            elif "inputs" not in cause.acts_on:
                causes.append(InOutput(cause, name, position, context.of_outputs[position].scale))
        skipped += [one for one in missing if one not in skipped]
    return causes, skipped


def _reason_to_skip(form: Form, cause: Cause, context: Context) -> str | None:
    n = len(next(iter(context.X.values())))
    if n < form.least_rows:
        return f"{n} rows are too few"
    if "outliers" in cause.acts_on and not context.gaussian:
        return "the likelihood is not normal, and outliers are part of it or impossible"
    if "overdispersion" in cause.acts_on and not context.overdisperses:
        return "it is a scatter beyond that of a Poisson or binomial likelihood"
    if "noise" in cause.acts_on and not (context.scales_noise or "overdispersion" in cause.acts_on):
        return "the likelihood has no scale of the noise that could change"
    if cause.modification is not None and context.states:
        distinct = len(np.unique(context.X[context.inputs[0]]))
        needed = _MIN_TIMES_PLACED if cause.modification.is_in_time else _MIN_TIMES
        if distinct < needed:
            return f"{context.inputs[0]} has {distinct} distinct values, {needed} are needed"
        if cause.modification.looks_back and not context.remembers:
            return "inside the dynamics: needs an OdeSimulator with method='rk4'"
    trouble = form.trouble(cause, context)
    if trouble:
        return trouble
    for column in cause.reads:
        distinct = len(np.unique(context.X[column])) if column in context.X else form.least_distinct
        if distinct < form.least_distinct:
            return f"{column} has {distinct} distinct values, {form.least_distinct} are needed"
    return None
