"""The docstring of a module."""

from __future__ import annotations

import textwrap

from hybridsurrogate.diagnosis.source.extended_model import ExtendedModel
from hybridsurrogate.diagnosis.source.parts import SourceParts, own_arguments
from hybridsurrogate.diagnosis.source.text import WIDTH, inline
from hybridsurrogate.numerics.digits import listing


def docstring(model: ExtendedModel, parts: SourceParts) -> str:
    """Return the docstring, quotes included."""
    outputs = listing(list(model.outputs))
    causes = [one.cause for one in model.causes if one.cause.is_learned]
    found = [cause.name for cause in causes if cause.changes_output]
    what = f"extended by {listing(found)}" if found else "as it is, its parameters estimated"
    call = listing([*own_arguments(parts), *parts.columns.values()]) if parts.columns else ""
    noise = [part for part in parts.coded if part.code.does == "scatters"]
    text = [f"{outputs[:1].upper()}{outputs[1:]} of the simulation {model.name}, {what}."]
    text += list(model.about)
    others = [cause.name for cause in causes if not cause.changes_output]
    if others:
        text.append(f"Of the measurements, and not in the simulation: {listing(others)}.")
    text += [f"{p.function} is how measurements scatter around it." for p in noise]
    if parts.link:
        scale = "logarithm" if parts.link == "log" else "log odds"
        text.append(f"Causes act on the {scale} of the output.")
    text.append(f"The function extended takes {call}.")
    text.append(
        "Its defaults are posterior means, with 90 % intervals; in brackets are units, where a "
        "name stands for the unit of what it names."
    )
    lines = [line for each in text for line in [*textwrap.wrap(inline(each), WIDTH), ""]]
    if parts.estimates:
        width = max(len(name) for name, _, _ in parts.estimates)
        table = [f"    {n:{width}}  {known} {unit}".rstrip() for n, known, unit in parts.estimates]
        lines += [*table, ""]
    if model.functions:
        given = [
            *(name for name, _ in model.functions),
            *own_arguments(parts)[len(model.functions) :],
        ]
        lines += [f"    from {module} import {name}" for name, module in model.functions]
        lines += ["", f"    extended({', '.join([*given, *parts.columns.values()])})", ""]
    lines += [*textwrap.wrap(inline(model.written_by), WIDTH), ""] if model.written_by else []
    return '"""' + "\n".join(_first_alone(lines, model.name)[:-1]).rstrip('"') + '\n"""'


def _first_alone(lines: list[str], name: str) -> list[str]:
    """Return lines of a docstring of which the first is no longer than a line."""
    return lines if lines.index("") == 1 else [f"An extension of {inline(name)[:60]}.", "", *lines]
