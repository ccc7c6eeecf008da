"""The rivals, in prose: who cannot be told apart, and what would tell them apart."""

from __future__ import annotations

import numpy as np

from hybridsurrogate.diagnosis.discrepancy import next_measurement
from hybridsurrogate.diagnosis.report import digits
from hybridsurrogate.diagnosis.report.tables import noise_of
from hybridsurrogate.diagnosis.report.view import View, label, label_of

# probability of a remainder from which on it is told
_REMAINDER = 0.5
# expected information in nats below which one more measurement is hardly worth it
_LITTLE_INFORMATION = 0.05
_SETTLED = 0.95


def rivals(view: View) -> list[str]:
    """Say how to read the probabilities, who cannot be told apart, what was not weighed."""
    d = view.diagnosis
    out = [
        "Before the data, 'nothing is wrong' (none) has half of the probability and the kinds "
        "share the rest. Log evidence compares with none: each unit is a factor of 2.7 in odds."
    ]
    if view.extended:
        out += _alike(view) + _remainder(view)
    table = d.causes_
    skipped = [
        f"{kind} ({note.removeprefix('not weighed: ')})"
        for kind, note in zip(table["kind"], table["note"], strict=True)
        if note
    ]
    if skipped:
        out.append(f"Not weighed: {digits.listing(skipped)}.")
    return out


def next_step(view: View) -> list[str]:
    """Say what to do now, and where to measure once more."""
    d = view.diagnosis
    place = digits.listing([f"{k} = {digits.number(v)}" for k, v in d.next_measurement_.items()])
    at = np.array([[d.next_measurement_[name] for name in view.columns]])
    first, *others = view.rivals()
    out = [_advice(view)]
    if not others:
        return out
    here, there = (float(view.expected(rival, at)[0]) for rival in (first, others[0]))
    nats = float(next_measurement(d.search_, at)[0])
    out.append(
        f"One more measurement would best tell the explanations apart at {place}: there "
        f"'{label_of(first)}' expects {view.output} = {digits.number(here)}, "
        f"'{label_of(others[0])}' {digits.number(there)}, with noise of "
        f"{noise_of(view, after=True)}."
    )
    if nats < _LITTLE_INFORMATION:
        settled = d.search_.probability.max() > _SETTLED
        why = (
            "the data have decided between them already"
            if settled
            else "within what was simulated they predict nearly the same, beside their uncertainty"
        )
        out.append(
            f"It would tell little, {digits.number(nats, 2)} nats where 0.7 decide between two "
            f"equal rivals: {why}."
        )
    return out


def _advice(view: View) -> str:
    d = view.diagnosis
    verdict = d.verdict_
    if verdict == "adequate":
        return "Use the calibrated simulation; measure more if smaller faults matter."
    if verdict == "unexplained":
        return (
            "Within the measured range predict with extended_estimator_, whose smooth curve "
            "corrects the simulation; beyond it the curve knows nothing. Look for a mechanism with "
            "the shape of the curve, and pass it as a cause of your own."
        )
    if verdict == "ambiguous":
        return (
            "Do not act on the leading cause alone: check "
            f"{digits.listing(list(d.indistinguishable_))} where the data come from. Predictions "
            "of extended_estimator_ follow the leading one."
        )
    found = [label(f.kind, f.target) for f, _ in view.found if f.kind != "unexplained"]
    return (
        f"Check {digits.listing(found)} where the data come from: a "
        "cause that fits is not yet a cause that is true. Predict with extended_estimator_."
    )


def _alike(view: View) -> list[str]:
    """Say how far apart the leading cause and its rivals are, in units of the noise."""
    candidates = [w for w in view.rivals() if w.cause is not None]
    if len(candidates) < 2 or view.diagnosis.verdict_ == "named":
        return []
    first, *others = candidates
    told = []
    noise = float(np.mean(view.diagnosis.extended_estimator_.posterior_.sigma))
    working = view.diagnosis.search_.problem.likelihood.working
    for other in others:
        gap = working(view.expected(first, view.X)) - working(view.expected(other, view.X))
        size = float(np.sqrt(np.mean(gap**2))) / noise
        told.append(f"{digits.number(size, 2)} from {label_of(other)}")
    return [
        f"At the measured rows the fitted curve of {label_of(first)} is this far, in standard "
        f"deviations of the noise (root mean square), from those of its rivals: "
        f"{digits.listing(told)}."
    ]


def _remainder(view: View) -> list[str]:
    d = view.diagnosis
    best = d.causes_[d.causes_["kind"] == d.best_cause_.kind].iloc[0]
    remainder = float(best["remainder"])
    if d.verdict_ not in ("named", "ambiguous") or not remainder > _REMAINDER:
        return []
    left = view.y - view.after
    order = np.argsort(view.x, kind="stable")
    lag = float(np.corrcoef(left[order][:-1], left[order][1:])[0, 1])
    removed = 1 - float(np.var(left)) / float(np.var(view.y - view.before))
    return [
        f"The cause is not the whole story: with probability {digits.probability(remainder)} a "
        f"smooth remainder is needed beside it. The extension removes {digits.percent(removed)} of "
        f"the variance of the residuals; those that are left have a correlation of {lag:.2f} "
        f"between neighbours in {view.name}, where 0 would mean that only noise is left."
    ]
