"""Which of several simulations the measurements favour, what each lacks, and a report on it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import pandas as pd
from matplotlib.axes import Axes

from hybridsurrogate.diagnosis.report.details.provenance import installed
from hybridsurrogate.diagnosis.report.elements.section import (
    Advice,
    Card,
    Drawn,
    FirstScreen,
    Picture,
    Section,
    Table,
    rendered,
)
from hybridsurrogate.diagnosis.report.elements.tables import rounded
from hybridsurrogate.diagnosis.report.report import Report, Reported
from hybridsurrogate.diagnosis.report.summary import plain
from hybridsurrogate.numerics import digits
from hybridsurrogate.plotting.scores import plot_comparison
from hybridsurrogate.scoring.scores import COVERAGE_LEVEL


def _report_of(found: SimulationComparison, full: bool) -> Report:
    table, agreement = found.table, found.agreement
    chosen, all_wrong = found.chosen, found.all_wrong
    first = FirstScreen(
        f"{digits.listing([str(name) for name in table.index])} · "
        f"hybridsurrogate {installed('hybridsurrogate')}",
        _headline(table, chosen, all_wrong),
        _lead(table, agreement),
        _cards(table),
        _caution(chosen, all_wrong),
        Picture(_drawn, table),
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
        "table": plain(named),
        "agreement": plain(agreement),
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
    difference = digits.plus_minus(nearest["difference"], nearest["difference_error"], sign=True)
    return (
        Card(
            "Most probable?",
            str(table.index[0]),
            f"{digits.probability(float(table['probability'].iloc[0]))} by the evidence",
        ),
        Card(
            "Predicts best?",
            str(best.name),
            f"{nearest.name} is at {difference} nats a held-out row",
        ),
        Card("Best mixture?", weights, "weights by stacking"),
    )


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


@dataclass(frozen=True, eq=False)
class SimulationComparison(Reported):
    """Several simulations of the same measurements compared.

    Attributes
    ----------
    table : pandas.DataFrame
        One row a simulation, indexed by its name, most probable first:

        - log_evidence: of the measured rows, parameters and noise integrated out, the simulation
          as it is;
        - probability: among these simulations, equally probable before;
        - elpd: mean log density of a held-out row;
        - difference and difference_error: of that from the best one, with its paired standard
          error;
        - weight: in the mixture that predicts held-out rows best (stacking);
        - verdict, cause and p_value: of a diagnosis of each, where they were asked for.
    agreement : pandas.DataFrame
        One row a pair of simulations: "first", "second", and "before" and "after": root mean square
        difference of their noise-free predictions at the measured rows, in posterior standard
        deviations; at most one where they agree to within their uncertainty. "after": both extended
        by what their diagnosis detected.
    log_density : pandas.DataFrame
        Of each held-out measurement, a column a simulation.
    estimators : dict of name to PowerScaledSurrogate
        Fitted to all rows.
    diagnoses : dict of name to DiscrepancyDiagnosis
        Fitted; empty where none were asked for.

    Examples
    --------
    >>> import hybridsurrogate as hs
    >>> from hybridsurrogate.datasets import make_log_sin
    >>> case = make_log_sin(random_state=0)
    >>> exact, coarse = (
    ...     hs.PowerScaledSurrogate(case.simulation, hs.PolynomialChaos(degree=d), random_state=0)
    ...     for d in (6, 1))
    >>> found = hs.compare_simulations(
    ...     {"fine": exact, "coarse": coarse}, case.X, case.y, diagnose=False, random_state=0)
    >>> sorted(found.table.index)
    ['coarse', 'fine']
    """

    table: pd.DataFrame
    agreement: pd.DataFrame
    log_density: pd.DataFrame
    estimators: dict[str, Any]
    diagnoses: dict[str, Any]

    @property
    def chosen(self) -> str | None:
        """The simulation with a probability of more than 0.9 among these; None without one."""
        first = self.table.iloc[0]
        return str(first.name) if first["probability"] > COVERAGE_LEVEL else None

    @property
    def all_wrong(self) -> bool | None:
        """Whether a diagnosis of each detects something wrong; None where none were asked for."""
        if not self.diagnoses:
            return None
        return not any(one.verdict_ in ("adequate", "undecided") for one in self.diagnoses.values())

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the held-out score of each simulation as a difference from the best.

        Parameters
        ----------
        ax : matplotlib Axes or None, default=None

        Returns
        -------
        matplotlib Axes
        """
        return plot_comparison(self.table, ax)

    def report(self, full: bool = False) -> Report:
        """Return the report: prints as text, shows as HTML, ``.save("report.html")``.

        Parameters
        ----------
        full : bool, default=False
            Whether the text has the tables too; HTML always has them, folded.
        """
        return _report_of(self, full)
