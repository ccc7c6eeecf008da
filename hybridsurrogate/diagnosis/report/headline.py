"""One sentence that names what is wrong, in the user's units, and a few that explain it."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import replace
from typing import Any

from hybridsurrogate.diagnosis.answers.finding import CauseFinding
from hybridsurrogate.diagnosis.checks.caution import SETTINGS as CHECKS
from hybridsurrogate.diagnosis.report.elements.tables import noise_of, unit_of
from hybridsurrogate.diagnosis.report.elements.view import SETTINGS, View, label_of_cause
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.effects.over_column import AtLevel
from hybridsurrogate.effects.registry import headline_of, meaning_of
from hybridsurrogate.inference.evidence.settings import SETTINGS as SEARCH
from hybridsurrogate.numerics import digits


def subject(view: View) -> str:
    """Return what was compared: the simulation's name and the data."""
    counted = [f"{len(view.of(name).y)} measurements of {name}" for name in view.outputs]
    return f"{name_of(view)} · {digits.listing(counted)}"


def name_of(view: View) -> str:
    """Return the name of the simulation, or that of its output."""
    simulator = view.result.before.simulation.simulator
    return str(simulator.name) if simulator is not None else f"runs of {view.output}"


def headline(view: View) -> str:
    """Return one sentence that names what was detected."""
    result = view.result
    if result.conclusion.verdict == "adequate":
        return "The measurements give no reason to doubt the simulation."
    if result.conclusion.verdict == "undecided":
        return {
            "runs": "The runs cannot show whether the simulation is right.",
            "rows": "The simulation fits badly, and these measurements cannot show why.",
            "prior": "The prior of a parameter is too narrow to show whether the simulation is "
            "right.",
        }[str(result.conclusion.undecided_by)]
    if result.conclusion.verdict == "unexplained":
        return (
            f"The simulation misses a smooth change of {view.output} that no cause of the "
            "catalogue explains."
        )
    finding, cause = view.findings[0]
    if result.conclusion.verdict == "ambiguous":
        shares = view.search.kind_shares
        own = finding.kind, *finding.same_curve
        others = [kind for kind in result.indistinguishable if kind not in own]
        kinds = [finding.kind, *sorted(others, key=lambda kind: -shares[kind])]
        shown = kinds[: SETTINGS.max_listed]
        left = len(kinds) - len(shown)
        more = f" or {left} others" if left > 1 else " or one other" if left else ""
        if len(shown) > 1 and not more:
            choice = f"{', '.join(shown[:-1])} or {shown[-1]}"
        else:
            choice = ", ".join(shown) + more
        return f"{_at_fault(view)} wrong, and the data leave open how: {choice}."
    sentence = sentence_of(view, finding, cause)
    right = result.conclusion.probability_right
    if result.conclusion.verdict == "nearest" and right is not None and right < CHECKS.majority:
        return f"{_at_fault(view)} wrong. The closest match: {_lower(sentence)}"
    return sentence


def lead(view: View) -> tuple[str, ...]:
    """Return the sentences that explain the headline."""
    result = view.result
    if result.conclusion.verdict == "adequate":
        return (_detectable(view),)
    if result.conclusion.verdict == "undecided":
        return _undecided(view)
    if result.conclusion.verdict == "unexplained":
        return _unexplained(view)
    finding, cause = view.findings[0]
    out = []
    if result.conclusion.verdict == "ambiguous":
        share = digits.probability(finding.probability)
        sentence = _lower(sentence_of(view, finding, cause))
        out.append(f"Most probable ({share} of the evidence): {sentence}")
    elif result.conclusion.verdict == "nearest":
        out.append("This is the closest match in the catalogue; the residuals show more.")
    mean = {
        "noise": "The mean of the simulation stands; the scatter of the data is not as assumed.",
        "inputs": "The simulation itself stands; a measured input is in error.",
        "data": "The simulation itself stands; these rows need a check.",
        "prior": "The simulation itself may be right, with a wider prior.",
    }
    concerned = {one.concerns for _, one in view.findings[1:]}
    if result.conclusion.concerns in mean and "simulation" not in concerned:
        out.append(mean[result.conclusion.concerns])
    estimates = estimates_of(view, finding, cause)
    if estimates:
        out.append(f"{estimates[0].upper()}{estimates[1:]}.")
    if finding.same_curve:
        same = digits.listing(list(finding.same_curve))
        out.append(f"On these rows {same} would draw the same curve.")
    later = (step for step in result.steps[1:] if step.chosen.cause is not None)
    for step, (other, further) in zip(later, view.findings[1:], strict=True):
        if other.kind == "unexplained":
            out.append("A second fault: a smooth curve of unknown cause.")
            continue
        own = step.conditional.kind_shares.get(other.kind, 0.0)
        of = f", most probably ({digits.probability(own)} of the evidence)"
        word = "A further fault" + of * (own < SEARCH.naming_level)
        out.append(f"{word}: {_lower(sentence_of(view, other, further))}")
    return tuple(out)


def sentence_of(view: View, finding: CauseFinding, cause: Cause) -> str:
    """Return a cause and its size as a sentence.

    Parameters
    ----------
    view : View
    finding : CauseFinding
    cause : Cause
    """
    if cause.output is not None:
        inner = replace(finding, target=cause.inner.target)
        return sentence_of(view.of(cause.output), inner, cause.inner)
    places: dict[str, Any] = {
        "output": view.output,
        "target": (finding.target or "").replace(" * ", " and "),
        "column": getattr(cause, "column", None) or finding.target or view.inputs[0],
        "through": getattr(cause, "through", None),
    }
    if isinstance(cause, AtLevel) and cause.level is not None:
        places["level"] = cause.name_of(cause.level)
    log = f"log {view.output}"
    for name, limits in finding.estimates.items():
        unit = known_unit(view, cause, name)
        if name == "slope" and not unit:
            unit = f"{log if view.log_scale else ''} per unit of {places['column']}".lstrip()
        factor = view.log_scale and unit.startswith(log)
        unit = unit.removeprefix(log).lstrip() if factor else unit
        places[name] = _Estimate(*limits, unit, factor)
    for form in (headline_of(cause), meaning_of(cause)):
        with suppress(KeyError):  # an estimate that this form does not have
            if form:
                return f"{_capital(form.format_map(places))}."
    return f"The simulation misses something: {label_of_cause(cause)}."


def estimates_of(view: View, finding: CauseFinding, cause: Cause) -> str:
    """Return the first estimates with their intervals: "amplitude 2.74 ppm (2.71 to 2.78)"."""
    parts: list[str] = []
    for name, (mean, low, high) in list(finding.estimates.items())[: SETTINGS.max_listed]:
        value, _, limits = digits.interval(mean, low, high).partition(" (")
        unit = known_unit(view, cause, name)
        inside = f" ({limits}" if limits else ""
        if inside and not parts:
            inside = f" (90 % interval {limits}"
        parts.append(f"{name.replace('_', ' ')} {value}{f' {unit}' if unit else ''}{inside}")
    return ", ".join(parts)


def known_unit(view: View, cause: Cause, name: str) -> str:
    """Return the unit of an estimate where the user's units give it, else ""."""
    unit = unit_of(replace(view, units=_Marked(view.units)), cause, name)
    return "" if _NOT_GIVEN in unit or unit.startswith("a ") else unit


# stands in the place of a unit that is not given
_NOT_GIVEN = "\0"


class _Marked(dict[str, str]):
    """Units that mark those that are not given."""

    def get(self, key: str, default: Any = None) -> Any:
        return super().get(key, _NOT_GIVEN)


class _Estimate:
    """An estimate inside a sentence: with unit, without sign, or as a word by its sign."""

    def __init__(self, mean: float, low: float, high: float, unit: str, factor: bool) -> None:
        self.mean, self.unit, self.factor = mean, unit, factor
        self.half = (high - low) / 2

    def __format__(self, how: str) -> str:
        if "|" in how:
            return how.split("|")[bool(self.mean < 0)]
        if how == "place":
            return self._rounded(self.mean)
        unit = f" {self.unit}" if self.unit else ""
        if self.factor:
            factor = digits.number(math.exp(abs(self.mean)), 3)
            return f"a factor of {factor}{' up and down' if how == 'around' else ''}{unit}"
        value = abs(self.mean) if how in ("size", "around") else self.mean
        sign = "±" if how == "around" else ""
        return f"{sign}{self._rounded(value)}{unit}"

    def _rounded(self, value: float) -> str:
        """Return a value to the first digit of its uncertainty."""
        if not (math.isfinite(self.half) and self.half > 0) or abs(value) >= 1e7:
            return digits.number(value, 4)
        decimals = -math.floor(math.log10(self.half))
        if decimals > 6:
            return digits.number(value, 3)
        return digits.fixed(value, decimals)


def _at_fault(view: View) -> str:
    return {
        "noise": "The mean of the simulation stands, but its noise is",
        "inputs": "The simulation stands, but a measured input is",
        "data": "The simulation stands, but some rows are",
        "prior": "A prior is",
    }.get(view.result.conclusion.concerns or "", "The simulation is")


def _detectable(view: View) -> str:
    """Report how large a fault would have to be to be detected."""
    least = view.result.conclusion.smallest_detectable
    if least is None:
        return (
            "A fault well below the noise, whose standard deviation is about "
            f"{noise_of(view)}, would not be detected."
        )
    return (
        f"A fault with a root mean square of {view.amount(least * view.unit)} would have been "
        f"detected in nine of ten such data sets{_step(view)}; the noise is about {noise_of(view)}."
    )


def _step(view: View) -> str:
    """Report the least height of a step that would have been detected."""
    table = view.result.conclusion.detectable
    if table is None:
        return ""
    heights = table.loc[table["kind"] == "step", "change"].dropna()
    return "".join(f", a step from {view.amount(one * view.unit)} on" for one in heights[:1])


def _undecided(view: View) -> tuple[str, ...]:
    result = view.result
    if result.conclusion.undecided_by == "runs":
        assert result.emulator_check is not None  # it decided
        if result.emulator_check.rounding is None:
            left_open = digits.number(result.emulator_check.left_open, 2)
            out = [f"They leave the simulation uncertain by {left_open} times the noise."]
        else:
            out = ["Their counts are whole numbers, rounded or drawn, which can hide an effect."]
        if view.extended:
            out.append(
                f"The most probable cause is {label_of_cause(view.cause)}, but the uncertainty of "
                "the runs can look like it."
            )
    elif result.conclusion.undecided_by == "rows":
        out = ["No cause of the catalogue predicts them better than the simulation does."]
    else:
        out = [
            f"The most probable cause is {label_of_cause(view.cause)}, but a value beyond the "
            "prior may explain as much."
        ]
    if result.conclusion.smallest_detectable is not None:
        out.append(_detectable(view))
    return tuple(out)


def _unexplained(view: View) -> tuple[str, ...]:
    share = digits.probability(view.result.extension.best_cause.probability)
    out = [f"A smooth curve of unknown cause has {share} of the probability."]
    band = view.band
    stretches = band.stretches(view.band_x)
    if stretches and view.name in view.inputs:
        low, high, sign = max(stretches, key=lambda s: s[1] - s[0])
        out.append(
            f"{view.output} lies {'above' if sign > 0 else 'below'} the simulation from "
            f"{band.column} = {digits.number(low, 3)} to {digits.number(high, 3)}."
        )
    return tuple(out)


def _lower(sentence: str) -> str:
    first = sentence.split(" ")[0]
    # names keep their case
    return sentence[0].lower() + sentence[1:] if first in _WORDS else sentence


_WORDS = ("The", "A", "At", "From", "One", "Two", "Some", "What")


def _capital(sentence: str) -> str:
    first = sentence.split(" ")[0].lower()
    return sentence[0].upper() + sentence[1:] if first in map(str.lower, _WORDS) else sentence
