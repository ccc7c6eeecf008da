"""The evidence for the cause: what was compared, and how clearly the data decide."""

from __future__ import annotations

import numpy as np
import pandas as pd

from hybridsurrogate.diagnosis.answers.finding import NOT_COMPARED, is_compared
from hybridsurrogate.diagnosis.checks.caution import SETTINGS as CHECKS
from hybridsurrogate.diagnosis.fitting.verdict import DOCUMENTED, N_CASES, NOT_HELD
from hybridsurrogate.diagnosis.report.details import pictures
from hybridsurrogate.diagnosis.report.elements import tables
from hybridsurrogate.diagnosis.report.elements.section import Picture, Section, Table
from hybridsurrogate.diagnosis.report.elements.view import (
    SETTINGS,
    View,
    label,
    label_of,
    label_of_cause,
    root_mean_square,
)
from hybridsurrogate.numerics import digits


def section(view: View) -> Section:
    """Return the section."""
    compared = is_compared(view.result.causes)
    n = int(compared.sum()) - 1
    left = _not_compared(view)
    sentences = [
        "Before the data, 'nothing' has half of the probability and the kinds share the rest. Log "
        "evidence is relative to 'nothing': each unit is a factor of 2.7 in odds."
    ]
    if len(view.findings) > 1:
        sentences.append(_conditional(view))
    if view.extended:
        sentences += _probabilities(view) + _alike(view)
    sentences += _outside(view) + _failing(view)
    shown = [Table(tables.compared_causes(view), "Causes compared, most probable first")]
    if len(left):
        shown.append(Table(left, "Not applicable here"))
    return Section(
        "Evidence for the cause",
        f"{n} causes compared, {len(left)} not applicable",
        tuple(sentences),
        tables=tuple(shown),
        pictures=(Picture(pictures.picture_causes, view),),
    )


def probability_of_smooth_curve(view: View) -> float:
    """Return the probability that a smooth curve is needed in addition to all that was found."""
    result = view.result
    if result.conclusion.verdict not in ("named", "nearest", "ambiguous") or not view.findings:
        return 0.0
    cause, search = view.findings[-1][1], result.steps[-1].conditional
    place = [w.cause is cause for w in search.candidates].index(True)
    share = float(search.remainder[place])
    return share if np.isfinite(share) else 0.0


def needs_smooth_curve(view: View) -> bool:
    """Return whether the causes that were found leave something to explain."""
    nearest = view.result.conclusion.verdict == "nearest"
    return nearest or probability_of_smooth_curve(view) > CHECKS.majority


def failing_causes(view: View) -> pd.DataFrame:
    """Return the rows of the table of causes with which the simulation does not run everywhere."""
    table = view.result.causes
    return table[is_compared(table) & (table["note"] != "")]


def _conditional(view: View) -> str:
    first = view.result.steps[0]
    if first.conditional is first.search:
        return (
            "The table is about the first cause. Each was compared with and without correlated "
            "noise, and its log evidence counts both."
        )
    return (
        "The table is about the first cause, conditional on the others: 'nothing' means that "
        "they are all that is wrong."
    )


def _probabilities(view: View) -> list[str]:
    """Report how probable the cause is, its kind and the nearest alternative."""
    own = digits.probability(view.own_probability)
    kind = digits.probability(view.result.extension.best_cause.probability)
    of_kind = f", its kind in all its forms {kind}" if kind != own else ""
    other = next((pair for pair in view.candidates if pair[0].cause is not view.cause), None)
    nearest = (
        f"; the next alternative, {label_of(other[0])}, {digits.probability(other[1])}"
        if other is not None
        else ""
    )
    out = [f"{label_of_cause(view.cause)} has {own} of the probability{of_kind}{nearest}."]
    if view.other_forms():
        names = [label_of_cause(view.cause), *map(label_of, view.other_forms())]
        out.append(
            f"The data do not separate these forms of the same kind: {digits.listing(names)}."
        )
    return out


def _alike(view: View) -> list[str]:
    """Report how far the most probable cause and its alternatives differ, in units of the noise."""
    if view.result.conclusion.verdict in ("named", "nearest"):
        return []
    found = view.search
    first = next(w for w in found.candidates if w.cause is view.cause)
    others = [w for w in view.alternatives(found) if w.cause not in (None, view.cause)]
    if not others:
        return []
    noise = view.noise(view.found)
    working = found.problem.likelihood.working
    curve = working(view.expected(found, first, view.X))
    parts = []
    for other in others:
        gap = curve - working(view.expected(found, other, view.X))
        size = root_mean_square(gap) / noise
        parts.append(f"{digits.at_least(size)} from {label_of(other)}")
    return [
        f"At the measured rows the curve of {label_of(first)} differs by so many standard "
        f"deviations of the noise (root mean square): {digits.listing(parts)}."
    ]


def _outside(view: View) -> list[str]:
    """Report how sure the name is, where causes outside the catalogue count."""
    right = view.result.conclusion.probability_right
    if right is None:
        return []
    return [
        f"Of {DOCUMENTED} measured data sets with a documented cause {NOT_HELD} had one that the "
        "catalogue does not hold. With such causes counted, this one is right with a probability "
        f"of {digits.probability(right)}, by {N_CASES} blind cases with and without their kind in "
        "the catalogue."
    ]


def _failing(view: View) -> list[str]:
    failing = failing_causes(view)
    out = []
    columns = ["kind", "target", "form", "note"]
    for kind, target, form, note in failing[columns].head(SETTINGS.max_listed).to_numpy():
        variant = form.removeprefix(kind).removeprefix(": ")
        under = "As it is" if kind == "none" else f"With {label(kind, target, variant)}"
        out.append(f"{under} {note}.")
    if len(failing) > SETTINGS.max_listed:
        out.append(f"The notes in causes_ list {len(failing) - SETTINGS.max_listed} more.")
    return out


def _not_compared(view: View) -> pd.DataFrame:
    table = view.result.causes
    left = table[~is_compared(table)]
    names = [
        label(kind, target if isinstance(target, str) else None)
        for kind, target in zip(left["kind"], left["target"], strict=True)
    ]
    reasons = [note.removeprefix(NOT_COMPARED) for note in left["note"]]
    return pd.DataFrame({"cause": names, "reason": reasons})
