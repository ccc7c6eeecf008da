"""The rivals, in prose: who cannot be told apart, and what would tell them apart."""

from __future__ import annotations

import numpy as np

from hybridsurrogate import digits
from hybridsurrogate.diagnosis.answers.table import NOT_WEIGHED, is_weighed
from hybridsurrogate.diagnosis.report.findings import sureness
from hybridsurrogate.diagnosis.report.scores import is_worse
from hybridsurrogate.diagnosis.report.settings import SETTINGS
from hybridsurrogate.diagnosis.report.tables import noise_of
from hybridsurrogate.diagnosis.report.view import View, label, label_of, label_of_cause

_NOTED = ["kind", "target", "form", "note"]


def rivals(view: View) -> list[str]:
    """Say how to read the probabilities, who cannot be told apart, what was not weighed."""
    d = view.diagnosis
    out = [
        "Before the data, 'nothing is wrong' (none) has half of the probability and the kinds "
        "share the rest. Log evidence compares with none: each unit is a factor of 2.7 in odds."
    ]
    if len(view.findings) > 1:
        first = d.result_.steps[0]
        out.append(
            "The table is about the first cause. Each was weighed alone and beside correlated "
            "noise, and its log evidence counts both."
            if first.given_others is first.search
            else "The table is about the first cause, with the others a part of the simulation: "
            "none says that they are all that is wrong."
        )
    if view.extended:
        out += sureness(view) + _alike(view) + _remainder(view)
    table = d.causes_
    weighed = is_weighed(table)
    failing = table[weighed & (table["note"] != "")]
    for kind, target, form, note in failing[_NOTED].head(SETTINGS.most_notes).to_numpy():
        variant = form.removeprefix(kind).removeprefix(": ")
        under = "As it is" if kind == "none" else f"With {label(kind, target, variant)}"
        out.append(f"{under} {note}.")
    if len(failing) > SETTINGS.most_notes:
        out.append(
            f"The notes in causes_ tell of {len(failing) - SETTINGS.most_notes} more such causes."
        )
    left = table[~weighed]
    skipped = [
        f"{label(kind, target if isinstance(target, str) else None)} "
        f"({note.removeprefix(NOT_WEIGHED)})"
        for kind, target, note in zip(left["kind"], left["target"], left["note"], strict=True)
    ]
    if skipped:
        out.append(f"Not weighed: {digits.listing(skipped)}.")
    return out


def next_step(view: View) -> list[str]:
    """Say what to do now, and where to measure once more."""
    d = view.diagnosis
    view = view.of(d.next_measurement_["output"]) if view.stacking is not None else view
    place = digits.listing(
        [f"{name} = {digits.number(d.next_measurement_[name])}" for name in view.columns]
    )
    if view.stacking is not None:
        place += f" in {view.output}"
    at = np.array([[d.next_measurement_[name] for name in view.columns]])
    asked = d.result_.asked
    first, *others = view.rivals(asked)
    out = [_advice(view)]
    if not others:
        return out
    bits = f"{_small(d.next_information_)} bits"
    scale = "where 1 bit decides between two explanations that are equally probable"
    if d.next_information_ < SETTINGS.little_information:
        settled = asked.probability.max() > SETTINGS.settled
        why = (
            "the data have decided between them already"
            if settled
            else "within what was simulated they predict nearly the same, beside their uncertainty"
        )
        out.append(
            "No single measurement more would tell much about which explanation is true: "
            f"{why}. The best place is {place}, with {bits} on average, {scale}."
        )
        return out
    here, there = (float(view.expected(asked, rival, at)[0]) for rival in (first, others[0]))
    out.append(
        f"One more measurement would best tell the explanations apart at {place}: there "
        f"'{label_of(first)}' expects {view.output} = {digits.number(here)}, "
        f"'{label_of(others[0])}' {digits.number(there)}, with noise of "
        f"{noise_of(view, after=True)}. It would tell {bits} on average, {scale}. For several "
        "together, and places that cost more than others, ask next_measurements(n, cost=...)."
    )
    return out


def _small(value: float) -> str:
    return "less than 0.01" if value < 0.01 else digits.number(value, 2)


def _advice(view: View) -> str:
    d = view.diagnosis
    verdict = d.verdict_
    if verdict == "adequate":
        return "Use the calibrated simulation; measure more if smaller faults matter."
    if verdict == "undecided":
        runs = "Add the runs of next_runs(n), or let refine() do it, and diagnose again."
        if d.emulator_check_ is not None and not d.emulator_check_.needs_runs:
            runs = d.emulator_check_.remedy
        return {
            "runs": runs,
            "rows": "Measure more, or pass a mechanism of your own as a cause.",
            "prior": "Widen the prior, run the simulation there, and diagnose again.",
        }[str(d.undecided_by_)]
    if verdict == "unexplained":
        return (
            "Within the measured range predict with extended_estimator_, whose smooth curve "
            "corrects the simulation; beyond it the curve knows nothing. Look for a mechanism with "
            "the shape of the curve, and pass it as a cause of your own."
        )
    if verdict == "ambiguous":
        return (
            "Do not act on the leading cause alone: check "
            f"{digits.listing(list(d.indistinguishable_))} where the data come from. "
            f"{_predict_with(view)}"
        )
    if verdict == "nearest":
        return (
            "Do not act on the name: the cause may stand for something that the catalogue lacks. "
            f"Look at what it leaves (the residuals above). {_search_on(view)} "
            f"{_predict_with(view)}"
        )
    found = [label_of_cause(c) for f, c in view.findings if f.kind != "unexplained"]
    found += [label_of(w) for w in view.kindred()]
    check = (
        f"Check {digits.listing(found)} where the data come from: a cause that fits is not yet a "
        "cause that is true."
    )
    if _remainder_with_cause(view) > SETTINGS.told_remainder:
        check += f" {_search_on(view)}"
    elif _is_curve_of_several(view):
        check += (
            " Two parameters that differ draw such curves as well: max_causes=2 weighs them "
            "together, which takes longer."
        )
    return f"{check} {_predict_with(view)}"


def _is_curve_of_several(view: View) -> bool:
    """Tell whether what was found may be several parameters of the simulation that differ."""
    curves = any(finding.kind == "curve-by-experiment" for finding, _ in view.findings)
    return curves and len(view.search.problem.model.parameters) > 1


def _search_on(view: View) -> str:
    more = len(view.findings) + 1
    return (
        f"Something is left beside {_it(view)}: search on with max_causes={more}, and put a "
        "mechanism of your own among the causes."
    )


def _predict_with(view: View) -> str:
    d = view.diagnosis
    if d.gain_ is not None and is_worse(d.gain_):
        return "Predict with estimator_, the simulation as it is: the extension predicts worse."
    if d.gain_out_of_range_ is not None and is_worse(d.gain_out_of_range_):
        return (
            "Predict with extended_estimator_ within the measured range, not beyond it: there its "
            "predictions were worse than those of the simulation as it is."
        )
    return "Predict with extended_estimator_."


def _alike(view: View) -> list[str]:
    """Say how far apart the leading cause and its rivals are, in units of the noise."""
    if view.diagnosis.verdict_ in ("named", "nearest"):
        return []
    found = view.search
    first = next(w for w in found.candidates if w.cause is view.cause)
    others = [w for w in view.rivals(found) if w.cause not in (None, view.cause)]
    if not others:
        return []
    parts = []
    noise = view.noise(view.found)
    working = found.problem.likelihood.working
    for other in others:
        gap = working(view.expected(found, first, view.X)) - working(
            view.expected(found, other, view.X)
        )
        size = float(np.sqrt(np.mean(gap**2))) / noise
        parts.append(f"{_small(size)} from {label_of(other)}")
    return [
        f"At the measured rows the fitted curve of {label_of(first)} is this far, in standard "
        f"deviations of the noise (root mean square), from those of its rivals: "
        f"{digits.listing(parts)}."
    ]


def _it(view: View) -> str:
    return "it" if len(view.findings) == 1 else "them"


def _remainder_with_cause(view: View) -> float:
    """Return the probability that a smooth remainder is needed beside all that was found."""
    d = view.diagnosis
    if d.verdict_ not in ("named", "nearest", "ambiguous"):
        return 0.0
    cause, search = view.findings[-1][1], d.result_.steps[-1].given_others
    place = [w.cause is cause for w in search.candidates].index(True)
    remainder = float(search.remainder[place])
    return remainder if np.isfinite(remainder) else 0.0


def _remainder(view: View) -> list[str]:
    remainder = _remainder_with_cause(view)
    if remainder <= SETTINGS.told_remainder:
        return []
    left = view.y - view.after
    order = np.argsort(view.x, kind="stable")
    lag = float(np.corrcoef(left[order][:-1], left[order][1:])[0, 1])
    removed = 1 - float(np.var(left)) / float(np.var(view.y - view.before))
    return [
        f"{'The cause is' if len(view.findings) == 1 else 'These causes are'} not the whole story: "
        f"with probability {digits.probability(remainder)} a smooth remainder is needed beside "
        f"{_it(view)}. The extension removes {digits.percent(removed)} of "
        f"the variance of the residuals; those that are left have a correlation of {lag:.2f} "
        f"between neighbours in {view.name}, where 0 would mean that only noise is left."
    ]
