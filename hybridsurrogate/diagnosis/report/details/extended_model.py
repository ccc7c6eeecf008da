"""The extended model: formulas, code to take away, estimates before and after."""

from __future__ import annotations

from hybridsurrogate.diagnosis.answers.finding import parameter_course
from hybridsurrogate.diagnosis.report.details.pictures import picture_course
from hybridsurrogate.diagnosis.report.elements.section import Picture, Section, Table
from hybridsurrogate.diagnosis.report.elements.tables import estimate_table
from hybridsurrogate.diagnosis.report.elements.view import View, averaged, label_of_cause
from hybridsurrogate.diagnosis.source.python_code import extended_model, python_source
from hybridsurrogate.effects import Remainder
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.effects.expressions import word
from hybridsurrogate.effects.output.processes import GROWTH
from hybridsurrogate.effects.registry import meaning_of
from hybridsurrogate.numerics import digits


def section(view: View) -> Section:
    """Return the section."""
    table = Table(estimate_table(view), "Means with 90 % intervals")
    if not view.extended:
        return Section(
            "The calibrated simulation",
            "estimates",
            ("Nothing was added: the extended model is the simulation as it is.", *_known(view)),
            tables=(table,),
        )
    return Section(
        "The extended model",
        "formula, Python code, estimates before and after",
        tuple(_sentences(view)),
        formulas=formulas(view),
        code=_code(view),
        tables=(table,),
        pictures=_courses(view),
    )


def _courses(view: View) -> tuple[Picture, ...]:
    """Return a picture of each parameter that would have to vary."""
    table = parameter_course(view.result.before, view.found)
    if table.empty:
        return ()
    return tuple(
        Picture(picture_course, view, own) for _, own in table.groupby("parameter", sort=False)
    )


def formulas(view: View) -> tuple[tuple[str, str, str], ...]:
    """Return the name, plain text and LaTeX of each cause's formula."""
    out = []
    for finding, cause in view.findings:
        # of several outputs a formula without "in" is of all of them
        own = cause.output or digits.listing(list(view.outputs))
        plain, latex = own, word(own)
        if view.log_scale:
            plain, latex = f"log {plain}", rf"\log {latex}"
        name = f"Formula, {label_of_cause(cause)}" if len(view.findings) > 1 else "Formula"
        out.append((name, f"{plain} = {finding.formula}", f"{latex} = {finding.latex}"))
    return tuple(out)


def _code(view: View) -> str:
    """Return the extended model as Python, "" where a cause has no expression."""
    try:
        return python_source(extended_model(view.result, view.units))
    except (ValueError, TypeError):  # a user-defined likelihood or cause
        return ""


def _sentences(view: View) -> list[str]:
    out = [f"{meaning}." for _, cause in view.findings if (meaning := _meaning(view, cause))]
    if view.log_scale:
        likelihood = view.result.search.problem.likelihood.name
        out.append(
            f"Under the {likelihood} likelihood the cause acts on log {view.output}: adding "
            f"0.1 there makes {view.output} larger by a factor of 1.105."
        )
    if len(view.findings) > 1:
        out.append(
            f"It holds {len(view.findings)} causes at once; each formula shows one, with the other "
            "causes inside 'simulation'."
        )
    return out + _known(view) + _averaged(view) + _beyond(view) + _simulator(view)


def _meaning(view: View, cause: Cause) -> str:
    """Return what a cause means for the one who wrote the simulation."""
    if cause.output is not None:
        return _meaning(view.of(cause.output), cause.inner)
    target = (cause.target or "").replace(" * ", " and ")
    column = getattr(cause, "column", None) or target
    text = (meaning_of(cause) or "").format(output=view.output, target=target, column=column)
    return f"What it means: {text}" if text else ""


def _known(view: View) -> list[str]:
    """Say which effects were known before: formulas call the simulation what has them."""
    names = [effect.name for effect in view.result.before.effects]
    if not names:
        return []
    every = digits.listing(names)
    return [f"Known before the diagnosis, and in the simulation of both models: {every}."]


def _averaged(view: View) -> list[str]:
    known = averaged(view)
    if len(known) < 2:
        return []
    shares = [f"{label} {digits.probability(weight)}" for _, label, weight in known]
    return [
        "The estimates are those of the most probable cause. Predictions average over the "
        f"{len(known)} explanations with 5 % of the probability or more: {digits.listing(shares)}."
    ]


def _beyond(view: View) -> list[str]:
    """Report what the extension allows for beyond the measured range."""
    kept = [e for e in view.result.extension.estimator.effects if not e.is_learned]
    own = [e.inner for e in kept if e.output in (None, view.output)]
    found = next((e for e in own if isinstance(e, Remainder)), None)
    if found is None:
        return []
    at_half = view.unit * 0.5**GROWTH
    low, high = (
        at_half * float(found.parameters["amplitude"].ppf(share)) for share in (0.05, 0.95)
    )
    return [
        "Beyond the measured range the extended model allows for further faults. At a distance of "
        f"half that range their standard deviation is {digits.number(low, 2)} to "
        f"{view.amount(high)} (90 %), in proportion to what was found within."
    ]


def _simulator(view: View) -> list[str]:
    simulator = view.result.extension.simulator
    if simulator is None:
        return []
    # the waves of curves mean nothing one by one; not every curve is part of the simulator
    waves = {name for _, c in view.findings if c.is_process for name in c.coefficients}
    names = [name for name in simulator.parameter_names if name not in waves]
    hidden = len(simulator.parameter_names) - len(names)
    if hidden:
        names.append(f"{hidden} amplitudes of waves")
    if not names:
        return ["extended_simulator_ runs the formula."]
    return [f"extended_simulator_ runs the formula, with the parameters {digits.listing(names)}."]
