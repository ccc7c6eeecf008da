"""Which of several simulations the measurements favour, and what each of them lacks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import pandas as pd

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from hybridsurrogate.diagnosis.report.report import Report

# probability with which one of the simulations is chosen
CHOSEN = 0.9


@dataclass(frozen=True, eq=False)
class SimulationComparison:
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
        return str(first.name) if first["probability"] > CHOSEN else None

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
        from hybridsurrogate.plotting.comparison import plot_comparison

        return plot_comparison(self.table, ax)

    def report(self, full: bool = False) -> Report:
        """Return the report: prints as text, shows as HTML, ``.save("report.html")``.

        Parameters
        ----------
        full : bool, default=False
            Whether the text has the tables too; HTML always has them, folded.
        """
        from hybridsurrogate.comparison.report import report_of

        return report_of(self.table, self.agreement, self.chosen, self.all_wrong, full)

    def __str__(self) -> str:
        return str(self.report())

    def _repr_html_(self) -> str:
        return str(self.report()._repr_html_())
