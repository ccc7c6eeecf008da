"""The report on planned measurements."""

from __future__ import annotations

from typing import NamedTuple

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
from hybridsurrogate.diagnosis.simulated.detectable import POWER
from hybridsurrogate.diagnosis.simulated.outcomes import NOTHING
from hybridsurrogate.numerics import digits
from hybridsurrogate.plotting.planning import plot_power


class Rates(NamedTuple):
    """What a `Detectability` consists of.

    Attributes
    ----------
    table, rates, confusion : pandas.DataFrame
    smallest : pandas.Series
        Smallest size of each cause that is detected in nine of ten data sets.
    n_rows, n_replicates : int
    false_alarm_rate : float
    """

    table: pd.DataFrame
    rates: pd.DataFrame
    confusion: pd.DataFrame
    smallest: pd.Series
    n_rows: int
    n_replicates: int
    false_alarm_rate: float


def report_of(result: Rates, full: bool = False) -> Report:
    """Return the report on planned measurements.

    Parameters
    ----------
    result : Rates
    full : bool
        Whether the text has the tables, too.
    """
    first = FirstScreen(
        f"{result.n_rows} planned rows · hybridsurrogate {installed('hybridsurrogate')}",
        _headline(result),
        (
            "A size is the root mean square of what the simulation's parameters cannot follow, in "
            "standard deviations of the noise.",
            f"Rates are shares of {result.n_replicates} simulated data sets of each cause and "
            "size, evaluated by the linearised evidence.",
        ),
        _cards(result),
        "",
        Picture(lambda: _drawn(result)),
        _advice(result),
    )
    rows = Section("Rates", "each cause and size", tables=(Table(rounded(result.table, 2)),))
    confusion = rounded(result.confusion.reset_index(), 2)
    matrix = Section(
        "Confusion", "what is found in place of what", tables=(Table(confusion, "All sizes."),)
    )
    summary = {
        "schema_version": 1,
        "rows": result.n_rows,
        "false_alarm_rate": result.false_alarm_rate,
        "table": records(result.table),
        "rates": records(result.rates),
    }
    return Report(first, (rows, matrix), summary, full)


def _headline(result: Rates) -> str:
    smallest = result.smallest
    some = smallest.dropna()
    if some.empty:
        return (
            f"These {result.n_rows} rows would detect no cause of the sizes tried in nine of ten "
            "data sets."
        )
    best, last = some.idxmin(), some.idxmax()
    each = f"{len(some)} of {len(smallest)} causes" if len(smallest) > 1 else str(best)
    sizes = digits.number(float(some[best]), 2)
    if len(some) > 1:
        sizes += f" ({best}) to {digits.number(float(some[last]), 2)} ({last})"
    return (
        f"These {result.n_rows} rows would detect {each} in nine of ten data sets, from a size of "
        f"{sizes} times the noise."
    )


def _cards(result: Rates) -> tuple[Card, ...]:
    table = result.table
    largest = table[table["size"] == table["size"].max()]
    worst = table.loc[table["confused"].idxmax()]
    never = [name for name, size in result.smallest.items() if size != size]
    alarms = result.rates[(result.rates["cause"] == NOTHING) & (result.rates["found"] != NOTHING)]
    confused = "none"
    if worst["confused"] > 0:
        confused = f"{worst['cause']} as {worst['confused_with']}"
    return (
        Card(
            "Named",
            digits.probability(float(largest["named"].mean())),
            f"of data sets with a cause of size {digits.number(largest['size'].iloc[0], 2)}",
        ),
        Card(
            "Confused most",
            confused,
            f"at size {digits.number(worst['size'], 2)}: another kind in "
            f"{digits.probability(worst['confused'])}",
        ),
        Card(
            "Not detected",
            digits.listing([str(name) for name in never]) if never else "none",
            f"in less than {100 * POWER:.0f} % at any size tried",
        ),
        Card(
            "False alarms",
            digits.probability(float(alarms["rate"].sum())),
            f"of data sets without a cause, at a rate of {result.false_alarm_rate:g}",
        ),
    )


def _advice(result: Rates) -> tuple[Advice, ...]:
    table = result.table
    asked = table[(table["detected"] < POWER) & table["rows"].notna()]
    out = []
    if len(asked):
        row = asked.loc[asked["size"].idxmax()]
        out.append(
            Advice(
                f"To detect {row['cause']} of size {digits.number(row['size'], 2)} in nine of "
                f"ten data sets, plan about {row['rows']:.0f} rows laid out alike."
            )
        )
    out.append(Advice("Compare other plans:", "hs.detectability(model, other_rows, ...)"))
    return tuple(out)


def _drawn(result: Rates) -> Drawn:
    return rendered(
        [plot_power(result.table)],
        "How often each cause would be detected (lines) and named (dashed), over its size.",
        result.table,
    )
