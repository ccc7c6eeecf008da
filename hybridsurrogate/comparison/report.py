"""The report on several simulations."""

from __future__ import annotations

from functools import partial

import pandas as pd

from hybridsurrogate.diagnosis.report.details.provenance import installed
from hybridsurrogate.diagnosis.report.elements.drawing import rendered
from hybridsurrogate.diagnosis.report.elements.section import (
    Advice,
    Card,
    Drawn,
    FirstScreen,
    Picture,
    Section,
    Table,
)
from hybridsurrogate.diagnosis.report.elements.tables import records, rounded
from hybridsurrogate.diagnosis.report.report import Report
from hybridsurrogate.numerics import digits
from hybridsurrogate.plotting.comparison import plot_comparison


def report_of(
    table: pd.DataFrame,
    agreement: pd.DataFrame,
    chosen: str | None,
    all_wrong: bool | None,
    full: bool = False,
) -> Report:
    """Return the report on several simulations.

    Parameters
    ----------
    table, agreement : DataFrame
        Of a `SimulationComparison`.
    chosen : str or None
    all_wrong : bool or None
    full : bool
        Whether the text has the tables, too.
    """
    first = FirstScreen(
        f"{digits.listing([str(name) for name in table.index])} · "
        f"hybridsurrogate {installed('hybridsurrogate')}",
        _headline(table, chosen, all_wrong),
        _lead(table, agreement),
        _cards(table),
        _caution(chosen, all_wrong),
        Picture(partial(_drawn, table)),
        _advice(table, chosen, all_wrong),
    )
    named = table.reset_index(names="simulation")
    sections = (
        Section("Scores", "each simulation", tables=(Table(rounded(named, 3)),)),
        Section("Agreement", "each pair", tables=(Table(rounded(agreement, 3)),)),
    )
    summary = {
        "schema_version": 1,
        "chosen": chosen,
        "all_wrong": all_wrong,
        "table": records(named),
        "agreement": records(agreement),
    }
    return Report(first, sections, summary, full)


def _headline(table: pd.DataFrame, chosen: str | None, all_wrong: bool | None) -> str:
    if all_wrong:
        nearest = f"; {chosen} is nearest" if chosen else ""
        return f"None of the {len(table)} simulations is right{nearest}."
    if chosen is None:
        return f"The measurements cannot choose between these {len(table)} simulations."
    if "verdict" in table and table.loc[chosen, "verdict"] not in ("adequate", "undecided"):
        return f"The measurements favour {chosen}, in which a fault is detected as well."
    return f"The measurements favour {chosen}."


def _lead(table: pd.DataFrame, agreement: pd.DataFrame) -> tuple[str, ...]:
    best = table.iloc[0]
    out = [
        f"{best.name} has {digits.probability(float(best['probability']))} of the probability "
        "among them."
    ]
    if "verdict" in table:
        out += [_lacks(str(name), row) for name, row in table.iterrows()][:4]
    if "after" in agreement:
        apart = agreement[agreement["after"] > 1]
        if apart.empty:
            out.append("Once extended they agree at the measured rows, within their uncertainty.")
        else:
            worst = apart.loc[apart["after"].idxmax()]
            out.append(
                f"Once extended {worst['first']} and {worst['second']} still differ, by "
                f"{digits.number(float(worst['after']), 2)} standard deviations."
            )
    return tuple(out)


def _lacks(name: str, row: pd.Series) -> str:
    if row["verdict"] == "adequate":
        return f"Nothing wrong is detected in {name}."
    if row["verdict"] == "undecided":
        return f"Whether {name} is right cannot be decided."
    return f"{name} lacks something: {row['cause']} ({row['verdict']})."


def _cards(table: pd.DataFrame) -> tuple[Card, ...]:
    best = table.loc[table["elpd"].idxmax()]
    weights = ", ".join(f"{name} {weight:.2f}" for name, weight in table["weight"].items())
    second = table.drop(index=best.name)["difference"]
    nearest = table.loc[second.idxmax()]
    cards = [
        Card(
            "Most probable?",
            str(table.index[0]),
            f"{digits.probability(float(table['probability'].iloc[0]))} by the evidence",
        ),
        Card(
            "Predicts best?",
            str(best.name),
            f"{nearest.name} is at "
            + digits.plus_minus(
                float(nearest["difference"]), float(nearest["difference_error"]), sign=True
            )
            + " nats a held-out row",
        ),
        Card("Best mixture?", weights, "weights by stacking"),
    ]
    return tuple(cards)


def _caution(chosen: str | None, all_wrong: bool | None) -> str:
    if all_wrong:
        return (
            "Probabilities suppose that one of the simulations is right, and a diagnosis detects a "
            "fault in each."
        )
    if all_wrong is None and chosen:
        return (
            "The favoured simulation may be wrong, too: no diagnosis was made of it "
            "(diagnose=True)."
        )
    return ""


def _advice(table: pd.DataFrame, chosen: str | None, all_wrong: bool | None) -> tuple[Advice, ...]:
    name = chosen or str(table.index[0])
    if all_wrong is None:
        return (Advice("See what it lacks:", "hs.DiscrepancyDiagnosis(model).fit(X, y)"),)
    out = [Advice("Read what each lacks:", f"comparison.diagnoses[{name!r}].report()")]
    if chosen is None:
        out.append(Advice("Predict by the mixture: the weights are in", "comparison.table"))
    return tuple(out)


def _drawn(table: pd.DataFrame) -> Drawn:
    return rendered(
        [plot_comparison(table)],
        "Held-out score of each simulation, as a difference from the best, with standard errors.",
        table.reset_index(names="simulation"),
    )
