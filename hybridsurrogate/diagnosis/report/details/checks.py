"""Whether the numerical methods behind the numbers did their job."""

from __future__ import annotations

import math
from functools import partial

import pandas as pd

from hybridsurrogate.diagnosis.checks.emulator import MOST_MISSED, advice_on_runs
from hybridsurrogate.diagnosis.report.details import pictures
from hybridsurrogate.diagnosis.report.details.cautions import cautions
from hybridsurrogate.diagnosis.report.elements.section import Picture, Section, Table
from hybridsurrogate.diagnosis.report.elements.view import View, averaged
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
        pictures=(Picture(partial(pictures.picture_residuals, view)),),
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
        + (f": {advice_on_runs(result.before.surrogate_)}." if check.missed > MOST_MISSED else "."),
    ]
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
    models = [("simulation", view.result.before)]
    if view.extended:
        models.append(("extended model", view.found))
    rows = []
    for word, model in models:
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
