"""Four questions that every reader has, their answers, and what to do next."""

from __future__ import annotations

from hybridsurrogate.diagnosis.report.details.evidence import needs_smooth_curve
from hybridsurrogate.diagnosis.report.details.gain import is_better, is_worse
from hybridsurrogate.diagnosis.report.elements.section import Advice, Card
from hybridsurrogate.diagnosis.report.elements.view import SETTINGS, View, label_of, label_of_cause
from hybridsurrogate.diagnosis.validation.gain import HeldOutGain
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
        model = "diagnosis" if view.extended else "diagnosis.estimator_"
        predict = f"{model}.predict(X)"
        return (
            Advice("Within the measured range predict with the smooth curve:", predict),
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


def _use(view: View) -> list[Advice]:
    result = view.result
    if is_worse(result.gain):
        return [Advice("Predict with the simulation as it is:", "diagnosis.estimator_.predict(X)")]
    where = ", within the measured range" if is_worse(result.gain_out_of_range) else ""
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
    if [step for step in view.result.steps if step.test is not None][-1].tried:
        # a further cause was searched already
        return []
    if needs_smooth_curve(view):
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
            f"{name} = {view.value(name, value)}" if not isinstance(value, str) else value
            for name, value in result.next_measurement.place.items()
        ]
    )
    bits = digits.at_least(result.next_measurement.information)
    if result.next_measurement.information < SETTINGS.min_information:
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


WRONG = "Is something wrong?"
CAUSE = "How sure is the cause?"
GAIN = "What is gained?"
RANGE = "How far to trust it?"


def cards(view: View, on_test: HeldOutGain | None) -> tuple[Card, ...]:
    """Return the four cards.

    Parameters
    ----------
    view : View
    on_test : HeldOutGain or None
        On rows that were held out by the user.
    """
    return (_wrong(view), _cause(view), _gain(view, on_test), _range(view, on_test))


def _wrong(view: View) -> Card:
    result = view.result
    word = {
        "adequate": "No sign of it",
        "undecided": "Cannot be decided",
    }.get(result.conclusion.verdict)
    where = {
        "noise": "Yes, in the noise",
        "inputs": "Yes, in an input",
        "data": "Yes, in the data",
        "prior": "Yes, in a prior",
    }.get(result.conclusion.concerns or "", "Yes")
    p, sign = digits.number(result.test.p_value, 2), "≤" if _is_bounded(view) else "="
    return Card(WRONG, word or where, f"p {sign} {p}: {basis_of_p_value(view)}")


def _is_bounded(view: View) -> bool:
    """Return whether the evidence bounds the p-value, below what replicates could show."""
    return view.result.test.p_value < view.result.test.share


def basis_of_p_value(view: View) -> str:
    """Return what the p-value rests on, as half a sentence."""
    result = view.result
    n, test = result.settings.n_replicates, result.test
    extreme = round(test.share * (n + 1)) - 1
    if _is_bounded(view):
        # by Markov's inequality, see `evidence_bound`
        odds = "a million" if test.bound < 1e-6 else f"{float(f'{1 / test.bound:.2g}'):,.0f}"
        return f"at most one in {odds} data sets made by the simulation itself looks as wrong"
    how_many = {0: "none", n: "all"}.get(extreme, str(extreme))
    looks = "looks" if extreme in (0, 1) else "look"
    return f"{how_many} of {n} data sets made by the simulation itself {looks} as wrong"


def _cause(view: View) -> Card:
    result = view.result
    if result.conclusion.verdict == "adequate":
        none = digits.probability(float(view.search.probability[0]))
        return Card(CAUSE, "None needed", f"that nothing is wrong has {none} of the probability")
    if result.conclusion.verdict == "undecided":
        return Card(CAUSE, "Not known", "the evidence does not suffice to name one")
    if result.conclusion.verdict == "unexplained":
        return Card(CAUSE, "Not known", "it is not in the catalogue, or its shape is smooth")
    kind = digits.probability(result.extension.best_cause.probability)
    if result.conclusion.probability_right is None:
        return Card(CAUSE, kind, "if the catalogue holds the true cause")
    right = f"{digits.probability(result.conclusion.probability_right)} right"
    if result.conclusion.verdict == "ambiguous":
        shares = view.search.kind_shares
        best = result.extension.best_cause
        others = [k for k in result.indistinguishable if k not in (best.kind, *best.same_curve)]
        listed = [f"{best.kind} {kind}"]
        listed += [f"{k} {digits.probability(shares[k])}" for k in others[:2]]
        return Card(CAUSE, right, f"if the catalogue holds it: {', '.join(listed)}")
    return Card(CAUSE, right, f"{kind} if the catalogue holds the true cause")


def _gain(view: View, on_test: HeldOutGain | None) -> Card:
    result = view.result
    if not view.extended:
        return Card(GAIN, "Nothing to gain", "no cause was added to the simulation")
    gain = result.gain if result.gain is not None else on_test
    if gain is None:
        return Card(GAIN, "Not measured", "cross_validate() measures it on held-out rows")
    score = digits.plus_minus(gain.elpd_difference, gain.standard_error, sign=True)
    detail = f"log score {score} a measurement"
    if is_better(gain) and gain.rmse_before > 0:
        change = gain.rmse_after / gain.rmse_before - 1
        if abs(change) >= 0.01:
            unit = view.units.get(view.output, "") if view.stacking is None else ""
            before, after = digits.number(gain.rmse_before, 3), digits.number(gain.rmse_after, 3)
            return Card(
                GAIN,
                f"{'−' if change < 0 else '+'}{100 * abs(change):.0f} % error",
                f"on held-out rows: {before} → {after}{f' {unit}' if unit else ''}; {detail}",
            )
        return Card(GAIN, "Better intervals", f"on held-out rows: {detail}")
    if is_worse(gain):
        return Card(GAIN, "Worse", f"predict with the simulation as it is: {detail}")
    return Card(GAIN, "No clear gain", f"within two standard errors on held-out rows: {detail}")


def _measured_range(view: View) -> str:
    """Return the measured range of each input of the simulation, of many of the first two."""
    parts = []
    for name in view.inputs[:2]:
        column = view.X[:, view.columns.index(name)]
        low, high = (digits.number(float(end), 3) for end in (column.min(), column.max()))
        unit = f" {view.units[name]}" if name in view.units else ""
        parts.append(f"{name} {low} to {high}{unit}")
    more = ", ..." if len(view.inputs) > 2 else ""
    return f"Within {', '.join(parts)}{more}"


def _range(view: View, on_test: HeldOutGain | None) -> Card:
    within = _measured_range(view)
    beyond, where = view.result.gain_out_of_range, "of rows left out at its ends"
    if on_test is not None:
        beyond, where = on_test, "of the rows that you held out"
    if beyond is None:
        return Card(RANGE, within, "beyond the measured range nothing was tested")
    coverage = beyond.coverage_after if view.extended else beyond.coverage_before
    held = f"the 90 % intervals cover {digits.percent(coverage)} {where}"
    if view.extended and is_worse(beyond):
        return Card(RANGE, within, f"it predicts worse than the simulation alone {where}")
    return Card(RANGE, within, held)
