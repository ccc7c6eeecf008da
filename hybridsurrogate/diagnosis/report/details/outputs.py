"""Which of several outputs a fault concerns."""

from __future__ import annotations

from functools import partial

from hybridsurrogate.diagnosis.report.details import pictures
from hybridsurrogate.diagnosis.report.elements.section import Picture, Section, Table
from hybridsurrogate.diagnosis.report.elements.tables import output_table
from hybridsurrogate.diagnosis.report.elements.view import View, label_of_cause
from hybridsurrogate.numerics import digits


def section(view: View) -> tuple[Section, ...]:
    """Return the section, nothing for a single output."""
    if view.stacking is None:
        return ()
    others = [view.of(name) for name in view.outputs if name != view.output]
    return (
        Section(
            "Outputs one by one",
            digits.listing(list(view.outputs)),
            tuple(sentences(view)),
            tables=(Table(output_table(view), "Residuals and noise, root mean squares"),),
            pictures=tuple(Picture(partial(pictures.picture_output, one)) for one in others),
        ),
    )


def sentences(view: View) -> list[str]:
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
