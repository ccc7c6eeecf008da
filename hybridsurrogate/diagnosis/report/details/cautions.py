"""Reasons to doubt a report, the most important first."""

from __future__ import annotations

from hybridsurrogate.diagnosis.answers.table import is_compared
from hybridsurrogate.diagnosis.checks.identifiability import confounded, sentences_on_parameters
from hybridsurrogate.diagnosis.checks.residuals import STRANGE
from hybridsurrogate.diagnosis.report.details.evidence import probability_of_smooth_curve
from hybridsurrogate.diagnosis.report.details.gain import is_worse
from hybridsurrogate.diagnosis.report.elements.settings import SETTINGS
from hybridsurrogate.diagnosis.report.elements.view import View
from hybridsurrogate.numerics import digits


def cautions(view: View) -> list[str]:
    """Return every reason to doubt the headline, the most important first."""
    result = view.result
    out = [one.sentence for one in result.cautions]
    out += _at_prior_ends(view) + _residual_structure(view) + _worse(view)
    out += _failed_runs(view) + _doubtful_draws(view)
    return [*out, *sentences_on_parameters(confounded(result.extension.confounded))]


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
    if check is not None and check.p_value <= STRANGE:
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
    share = probability_of_smooth_curve(view)
    if result.conclusion.verdict == "nearest" or share > SETTINGS.smooth_curve_said:
        return [
            f"A smooth curve is needed in addition, with probability {digits.probability(share)}: "
            "something that the catalogue does not hold may be at work too."
        ]
    return []


def _worse(view: View) -> list[str]:
    result = view.result
    if result.gain is not None and is_worse(result.gain):
        return ["On held-out rows the extended model predicts worse than the simulation as it is."]
    if result.gain_out_of_range is not None and is_worse(result.gain_out_of_range):
        return [
            "Beyond the measured range the extended model predicts worse than the simulation as "
            "it is."
        ]
    return []


def _failed_runs(view: View) -> list[str]:
    """Report that causes were compared only where the simulation runs."""
    table = view.result.causes
    failing = table[is_compared(table) & (table["note"] != "")]
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
    models = [("simulation", view.result.before)]
    if view.extended:
        models.append(("extended model", view.found))
    return [
        f"The draws of the {word} are doubtful: {'; '.join(problems)}."
        for word, model in models
        if (problems := model.diagnostics_.problems())
    ]
