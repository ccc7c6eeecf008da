"""What one more measurement would show."""

from __future__ import annotations

import numpy as np

from hybridsurrogate.diagnosis.report.details import pictures
from hybridsurrogate.diagnosis.report.elements.section import Picture, Section
from hybridsurrogate.diagnosis.report.elements.tables import noise_of
from hybridsurrogate.diagnosis.report.elements.view import SETTINGS, View, label_of
from hybridsurrogate.inference.evidence.settings import SETTINGS as EVIDENCE
from hybridsurrogate.numerics import digits

_SCALE = "1 bit decides between two explanations that are equally probable."


def section(view: View) -> Section:
    """Return the section."""
    worth = digits.at_least(view.result.next_measurement.information)
    return Section(
        "What to measure next",
        f"worth {worth} bits",
        tuple(_sentences(view, worth)),
        pictures=(Picture(pictures.picture_next, view),),
    )


def _sentences(view: View, worth: str) -> list[str]:
    result = view.result
    view = view.of(result.next_measurement.place["output"]) if view.stacking is not None else view
    place = digits.listing(
        [
            f"{name} = {view.value(name, result.next_measurement.place[name])}"
            for name in view.columns
        ]
    )
    if view.stacking is not None:
        place += f" in {view.output}"
    asked = result.asked
    first, *others = view.alternatives(asked)
    if not others:
        return ["There is one explanation only: nothing to separate."]
    if result.next_measurement.information < SETTINGS.min_information:
        why = (
            "the data have decided between them"
            if asked.probability.max() >= EVIDENCE.naming_level
            else "within what was simulated they predict nearly the same"
        )
        return [
            f"No single measurement would separate the explanations: {why}. The best place is "
            f"{place}, worth {worth} bits on average. {_SCALE}"
        ]
    at = np.array([[result.next_measurement.place[name] for name in view.columns]])
    here, there = (float(view.expected(asked, one, at)[0]) for one in (first, others[0]))
    return [
        f"One more measurement would best separate the explanations at {place}.",
        f"There {label_of(first)} predicts {digits.number(here)}, {label_of(others[0])} "
        f"{digits.number(there)}, with noise of {noise_of(view, after=True)}.",
        f"It is worth {worth} bits on average. {_SCALE}",
        "For several together, and places with different costs: next_measurements(n, cost=...).",
    ]
