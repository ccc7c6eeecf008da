"""Whether the numbers can be trusted: cautions, and the numerical methods behind them."""

from __future__ import annotations

import math

import pandas as pd

from hybridsurrogate.diagnosis.checks.parameters import confounded, sentences_on_parameters
from hybridsurrogate.diagnosis.checks.simulation import MAX_MISSED, advice_on_runs
from hybridsurrogate.diagnosis.report.details import pictures
from hybridsurrogate.diagnosis.report.details.evidence import (
    failing_causes,
    needs_smooth_curve,
    probability_of_smooth_curve,
)
from hybridsurrogate.diagnosis.report.details.gain import is_worse
from hybridsurrogate.diagnosis.report.elements.section import Picture, Section, Table
from hybridsurrogate.diagnosis.report.elements.view import View, averaged
from hybridsurrogate.diagnosis.search.residuals import RESIDUAL_LEVEL
from hybridsurrogate.model.posterior import KHAT_LIMIT
from hybridsurrogate.numerics import digits


def section(view: View) -> Section:
    """Return the section."""
    found = cautions(view)
    hint = "no cautions" if not found else f"{len(found)} caution{'s' * (len(found) > 1)}"
    return Section(
        "Checks",
        hint,
        (*found, *emulator(view), *_refinement(view), *_averaged(view)),
        tables=(
            Table(
                _draws(view),
                f"Draws of the posterior; a Pareto k-hat below {KHAT_LIMIT:g} is good",
            ),
            *_residuals(view),
        ),
        pictures=(Picture(pictures.picture_residuals, view),),
    )


def emulator(view: View) -> list[str]:
    """Report how well the runs, and the surrogate, determine the simulation."""
    result = view.result
    check, made = result.emulator_check, result.before.emulation_
    if check is None:
        return []
    out = [
        *([] if made is None else [made.origin]),
        f"At the measured rows the runs leave the simulation uncertain by {_times(check.left_open)}"
        " the noise, which is part of every comparison.",
        f"The surrogate, trained on the runs alone, differs from them by {_times(check.missed)} "
        "the noise there. The comparisons do without it, and the predictions rest on it"
        + (f": {advice_on_runs(result.before.surrogate_)}." if check.missed > MAX_MISSED else "."),
    ]
    if check.scatter:
        out.append(
            f"Repeated runs differ by {_times(check.scatter)} the noise there. The measured system "
            "is one run: every comparison allows for it, and more runs do not make it smaller."
        )
    if check.beyond:
        where = ", ".join(f"{rows} along {name}" for name, rows in check.beyond.items())
        out.append(
            f"Measured rows lie beyond every run ({where}): there the simulation is extrapolated. "
            "Give runs at the ends of its range."
        )
    return out


def _times(ratio: float) -> str:
    return "less than a thousandth of" if ratio < 1e-3 else f"{digits.number(ratio, 2)} times"


def _refinement(view: View) -> list[str]:
    rounds = view.result.refinement
    if rounds is None or len(rounds) < 2:
        return []
    first, last = rounds.iloc[0], rounds.iloc[-1]
    return [
        f"{last.n_runs - first.n_runs} further runs followed the first {first.n_runs}: what they "
        f"leave uncertain fell from {_times(first.left_open)} to {_times(last.left_open)} the "
        f"noise, and the most probable kind went from {first.kind} "
        f"({digits.percent(first.probability)}) to {last.kind} "
        f"({digits.percent(last.probability)})."
    ]


def _draws(view: View) -> pd.DataFrame:
    rows = []
    for word, model in view.models.items():
        d = model.diagnostics_
        # several rounds of proposals may be worth more than the draws that are kept
        effective = min(d.effective_draws, model.n_draws)
        khat = "" if math.isnan(d.khat) else f"{d.khat:.2f}"
        rows.append((word, d.sampler, f"{effective:.0f}", khat, "; ".join(d.problems()) or "none"))
    return pd.DataFrame(rows, columns=["model", "sampler", "effective draws", "k-hat", "problems"])


def _residuals(view: View) -> tuple[Table, ...]:
    check = view.result.conclusion.residual_check
    if check is None:
        return ()
    rows = [(name, digits.number(p, 2)) for name, p in check.statistics.items()]
    caption = (
        "Residuals of the extended model against replicated noise: the chance of values as "
        f"extreme. Of the most extreme: p = {digits.number(check.p_value, 2)}"
    )
    return (Table(pd.DataFrame(rows, columns=["statistic", "p"]), caption),)


def _averaged(view: View) -> list[str]:
    """Report whether draws are doubtful of further models in the average."""
    doubtful = [
        f"{label} (weight {digits.probability(weight)}): {'; '.join(one.diagnostics_.problems())}"
        for one, label, weight in averaged(view)[1:]
        if one.diagnostics_.problems()
    ]
    if not doubtful:
        return []
    return [
        "Of the other explanations in the average, which have fewer draws, these are doubtful, in "
        f"proportion to their weights: {'. '.join(doubtful)}."
    ]


def cautions(view: View) -> list[str]:
    """Return every reason to doubt the headline, the most important first."""
    out = [one.sentence for one in view.result.cautions]
    out += _at_prior_ends(view) + _residual_structure(view) + _worse(view)
    out += _failed_runs(view) + _doubtful_draws(view)
    return [*out, *sentences_on_parameters(confounded(view.result.extension.confounded))]


def _at_prior_ends(view: View) -> list[str]:
    """Return which parameters the data push against the end of their prior."""
    out = []
    for name, side, mean, end in view.result.extension.at_prior_end:
        beyond = "less" if side == "low" else "more"
        what = "the cause may stand for that" if view.extended else "widen it if that may be"
        out.append(
            f"The parameter {name} is at the {side} end of its prior ({digits.number(mean)}; 2 % "
            f"of the prior lie at {digits.number(end)} or {beyond}). The data ask for "
            f"{'still ' if view.extended else ''}{beyond} than it allows: {what}."
        )
    return out


def _residual_structure(view: View) -> list[str]:
    """Report that the residuals are not noise."""
    result = view.result
    check = result.conclusion.residual_check
    if result.conclusion.verdict in ("adequate", "undecided", "unexplained") or not view.extended:
        return []
    if check is not None and check.p_value <= RESIDUAL_LEVEL:
        what, _, column = check.worst.partition(" over ")
        over = f" over {column}" if column else ""
        kind = {
            "neighbours": f"are correlated between neighbours{over}",
            "curve": f"follow a curve{over}",
            "spread": f"change their spread{over}",
            "tails": "have heavy tails",
        }.get(what, f"have structure ({check.worst})")
        return [
            f"The residuals of the extended model {kind} (p = {digits.number(check.p_value, 2)}): "
            "something that the catalogue does not hold may be at work too."
        ]
    if needs_smooth_curve(view):
        share = digits.probability(probability_of_smooth_curve(view))
        return [
            f"A smooth curve is needed in addition, with probability {share}: "
            "something that the catalogue does not hold may be at work too."
        ]
    return []


def _worse(view: View) -> list[str]:
    result, where = view.result, "On held-out rows"
    if not is_worse(result.gain):
        where = "Beyond the measured range" if is_worse(result.gain_out_of_range) else ""
    worse = f"{where} the extended model predicts worse than the simulation as it is."
    return [worse] if where else []


def _failed_runs(view: View) -> list[str]:
    """Report that causes were compared only where the simulation runs."""
    failing = failing_causes(view)
    if failing.empty:
        return []
    itself = failing["kind"] == "none"
    n = int((~itself).sum())
    with_it = "" if itself.any() else f", with {failing['form'].iloc[0]},"
    note = (failing[itself] if itself.any() else failing)["note"].iloc[0]
    causes = "one cause was" if n == 1 else f"{n} causes were"
    compared = f"; {causes} compared only where it runs" if n else ""
    sentence = note.replace("the simulation", f"The simulation{with_it}", 1)
    return [f"{sentence}{compared}."]


def _doubtful_draws(view: View) -> list[str]:
    return [
        f"The draws of the {word} are doubtful: {'; '.join(problems)}."
        for word, model in view.models.items()
        if (problems := model.diagnostics_.problems())
    ]
