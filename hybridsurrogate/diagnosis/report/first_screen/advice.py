"""What to do next, as calls to paste."""

from __future__ import annotations

from hybridsurrogate.diagnosis.report.details.evidence import probability_of_smooth_curve
from hybridsurrogate.diagnosis.report.details.gain import is_worse
from hybridsurrogate.diagnosis.report.elements.section import Advice
from hybridsurrogate.diagnosis.report.elements.settings import SETTINGS
from hybridsurrogate.diagnosis.report.elements.view import View, label_of, label_of_cause
from hybridsurrogate.numerics import digits


def advice(view: View) -> tuple[Advice, ...]:
    """Return what to do next, the most important first."""
    result = view.result
    if result.conclusion.verdict == "adequate":
        return (
            Advice("Use the calibrated simulation:", "diagnosis.predict(X)"),
            Advice("If smaller faults matter, measure more:", "diagnosis.next_measurements(5)"),
        )
    if result.conclusion.verdict == "undecided":
        return _decide(view)
    if result.conclusion.verdict == "unexplained":
        return (
            Advice("Within the measured range predict with the smooth curve:", _predict(view)),
            Advice(
                "Look for a mechanism with the shape of the curve, and compare it:",
                "DiscrepancyDiagnosis(model, causes=[MyCause()])",
            ),
            *_measure(view),
        )
    return (*_use(view), _check(view), *_search_on(view), *_measure(view))


def _decide(view: View) -> tuple[Advice, ...]:
    """Return what would decide."""
    result = view.result
    if result.conclusion.undecided_by == "runs":
        if result.emulator_check is not None and not result.emulator_check.needs_runs:
            return (Advice(result.emulator_check.remedy),)
        return (
            Advice("Run the simulation where it is most uncertain:", "diagnosis.next_runs(20)"),
            Advice("Or let the package run it:", "hs.refine(diagnosis, X, y)"),
            Advice("Or diagnose with the simulation itself:", "surrogate=hs.ExactSurrogate()"),
        )
    if result.conclusion.undecided_by == "rows":
        return (
            Advice("Measure more:", "diagnosis.next_measurements(5)"),
            Advice(
                "Or compare a user-defined cause:",
                "DiscrepancyDiagnosis(model, causes=[MyCause()])",
            ),
        )
    return (Advice("Widen the prior, run the simulation there, and diagnose again."),)


def _predict(view: View) -> str:
    return "diagnosis.predict(X)" if view.extended else "diagnosis.estimator_.predict(X)"


def _use(view: View) -> list[Advice]:
    result = view.result
    if result.gain is not None and is_worse(result.gain):
        return [Advice("Predict with the simulation as it is:", "diagnosis.estimator_.predict(X)")]
    within = result.gain_out_of_range is not None and is_worse(result.gain_out_of_range)
    where = ", within the measured range" if within else ""
    out = [Advice(f"Use the extended model{where}:", "diagnosis.predict(X)")]
    if result.extension.simulator is not None:
        out.append(Advice("Take it away as Python code:", 'diagnosis.to_python("extended.py")'))
    return out


def _check(view: View) -> Advice:
    result = view.result
    if result.conclusion.verdict == "ambiguous":
        kinds = digits.listing(list(result.indistinguishable))
        return Advice(f"Before you act on one cause, check where the data come from: {kinds}.")
    found = [label_of_cause(c) for f, c in view.findings if f.kind != "unexplained"]
    found += [label_of(w) for w in view.other_forms()]
    return Advice(
        f"Check {digits.listing(found)} where the data come from: a cause that fits need not be "
        "true."
    )


def _search_on(view: View) -> list[Advice]:
    if (
        view.result.conclusion.verdict == "nearest"
        or probability_of_smooth_curve(view) > SETTINGS.smooth_curve_said
    ):
        more = len(view.findings) + 1
        return [Advice("Search for a further cause:", f"max_causes={more}")]
    curves = any(finding.kind == "curve-by-experiment" for finding, _ in view.findings)
    if curves and len(view.search.problem.model.parameters) > 1:
        return [Advice("Two parameters that differ draw such curves as well:", "max_causes=2")]
    return []


def _measure(view: View) -> list[Advice]:
    """Return where one more measurement would best separate the explanations."""
    result = view.result
    asked = result.asked
    if len(view.alternatives(asked)) < 2:
        return []
    place = digits.listing(
        [
            f"{name} = {digits.number(value)}" if not isinstance(value, str) else value
            for name, value in result.next_measurement.place.items()
        ]
    )
    bits = digits.at_least(result.next_measurement.information)
    if result.next_measurement.information < SETTINGS.little_information:
        return [
            Advice(
                "One more measurement would hardly separate the explanations: the best place, "
                f"{place}, is worth {bits} bits."
            )
        ]
    return [
        Advice(
            f"Measure at {place} to separate the explanations (worth {bits} bits):",
            "diagnosis.next_measurements(5)",
        )
    ]
