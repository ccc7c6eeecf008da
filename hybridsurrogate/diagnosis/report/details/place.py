"""Where in the measured range the simulation is wrong, by how much, and in which outputs."""

from __future__ import annotations

import numpy as np

from hybridsurrogate.diagnosis.answers.discrepancy import Third
from hybridsurrogate.diagnosis.report.details import pictures
from hybridsurrogate.diagnosis.report.elements.section import Picture, Section, Table
from hybridsurrogate.diagnosis.report.elements.tables import output_table, third_table, thirds
from hybridsurrogate.diagnosis.report.elements.view import (
    SETTINGS,
    View,
    label_of_cause,
    root_mean_square,
)
from hybridsurrogate.numerics import digits


def section(view: View) -> Section:
    """Return the section."""
    experiments = pictures.experiment_column(view)
    drawn = [Picture(pictures.picture_discrepancy, view)]
    if experiments is not None:
        drawn.append(Picture(pictures.picture_experiments, view, experiments))
    table = third_table(view)
    caption = "Share of the squared change by thirds of each measured range"
    return Section(
        "Where the simulation is wrong",
        _hint(view),
        tuple(_sentences(view)),
        tables=() if table is None else (Table(table, caption),),
        pictures=tuple(drawn),
    )


def _hint(view: View) -> str:
    if not view.extended:
        return "nowhere that the data show"
    parts = thirds(view)
    if not parts:
        return "not in the mean"
    most = _most(parts)
    if most.share < 1.5 * most.rows:
        return f"all over {most.column}"
    return f"most where {most.column} is {_span(view, most)}"


def _most(parts: list[Third]) -> Third:
    """Return the third that has most of the change for its rows."""
    return max(parts, key=lambda third: third.share - third.rows)


def _span(view: View, third: Third) -> str:
    low, high = (view.value(third.column, end) for end in (third.low, third.high))
    return low if third.low == third.high else f"{low} to {high}"


def _sentences(view: View) -> list[str]:
    if not view.extended:
        return [
            "Nowhere that the data show. The band is pointwise: it excludes zero in places even "
            "where nothing is wrong.",
        ]
    if not any(cause.changes_output for _, cause in view.findings):
        return [
            "The mean of the simulation stays as it is; the scatter of the measurements around it "
            "changes, and so the weight of each.",
        ]
    out = []
    if not thirds(view):
        out.append("The predicted mean stays as it is; its uncertainty changes.")
    else:
        change = np.abs(view.change)
        most = int(np.argmax(change))
        place = digits.listing(
            [f"{n} = {view.value(n, v)}" for n, v in zip(view.columns, view.X[most], strict=True)]
        )
        rms = root_mean_square(change)
        out.append(
            f"The extended model moves the predictions at the measured rows by {view.amount(rms)} "
            f"(root mean square), most at {place}: {view.amount(float(view.change[most]))}."
        )
        part = _most(thirds(view))
        out.append(
            f"Of this (as squares) {digits.percent(part.share)} lies where {part.column} is "
            f"{_span(view, part)}, with {digits.percent(part.rows)} of the rows."
        )
    # the smooth curve is one over an input; of another column the first picture shows more
    return [*out, _curve(view)] if view.name == view.band.column else out


def _curve(view: View) -> str:
    band = view.band
    elsewhere = "" if view.is_curve else ", the other columns at their medians"
    stretches = [s for s in band.stretches(view.band_x) if s[1] > s[0]]
    if not stretches:
        return (
            "A smooth curve through the residuals of the simulation nowhere excludes zero "
            f"(pointwise 90 % band) over {band.column}{elsewhere}: the fault is no smooth curve."
        )
    spans = [
        f"{'above' if sign > 0 else 'below'} from {digits.number(low)} to {digits.number(high)}"
        for low, high, sign in stretches[: SETTINGS.max_listed]
    ]
    rest = len(stretches) - SETTINGS.max_listed
    more = f" and {rest} more stretches" if rest > 0 else ""
    return (
        "A smooth curve through the residuals of the simulation excludes zero (pointwise 90 % "
        f"band) over {digits.percent(band.share_outside)} of {band.column}{elsewhere}: "
        f"{', '.join(spans)}{more}."
    )


def section_on_outputs(view: View) -> tuple[Section, ...]:
    """Return the section, nothing for a single output."""
    if view.stacking is None:
        return ()
    others = [view.of(name) for name in view.outputs if name != view.output]
    return (
        Section(
            "Outputs one by one",
            digits.listing(list(view.outputs)),
            tuple(_of_outputs(view)),
            tables=(Table(output_table(view), "Residuals and noise, root mean squares"),),
            pictures=tuple(Picture(pictures.picture_overview, one) for one in others),
        ),
    )


def _of_outputs(view: View) -> list[str]:
    """Report for each output whether a cause concerns it."""
    out = []
    for name in view.outputs:
        own = [c for _, c in view.findings if c.output in (None, name)]
        if not own:
            out.append(f"{name}: the simulation stands as it is.")
            continue
        shared = "" if all(c.output is not None for c in own) else ", shared by all outputs"
        out.append(f"{name}: {digits.listing([label_of_cause(c) for c in own])}{shared}.")
    return out
