"""How often causes would be detected: curves over size, confusion matrix, picture, report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from hybridsurrogate.arguments import check_number
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
from hybridsurrogate.diagnosis.search.simulated import NOTHING, POWER, size_at
from hybridsurrogate.inference.evidence.settings import SETTINGS
from hybridsurrogate.numerics import digits
from hybridsurrogate.plotting.planning import plot_power
from hybridsurrogate.types import FloatArray


def _report_of(result: Detectability, full: bool) -> Report:
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
        Picture(_drawn, result),
        _advice(result),
    )
    rows = Section("Rates", "each cause and size", tables=(Table(rounded(result.table, 2)),))
    confusion = rounded(result.confusion().reset_index(), 2)
    matrix = Section(
        "Confusion", "what is found in place of what", tables=(Table(confusion, "All sizes."),)
    )
    summary = {
        "schema_version": 1,
        "rows": result.n_rows,
        "false_alarm_rate": result.false_alarm_rate,
        "table": plain(result.table),
        "rates": plain(result.rates),
    }
    return Report(first, (rows, matrix), summary, full)


def _headline(result: Detectability) -> str:
    smallest = result.smallest()
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


def _cards(result: Detectability) -> tuple[Card, ...]:
    table = result.table
    largest = table[table["size"] == table["size"].max()]
    worst = table.loc[table["confused"].idxmax()]
    never = [name for name, size in result.smallest().items() if size != size]
    alarms = result.rates[(result.rates["cause"] == NOTHING) & (result.rates["found"] != NOTHING)]
    confused = f"{worst['cause']} as {worst['confused_with']}" if worst["confused"] > 0 else "none"
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


def _advice(result: Detectability) -> tuple[Advice, ...]:
    table = result.table
    asked = table[(table["detected"] < POWER) & table["rows"].notna()]
    others = Advice("Compare other plans:", "hs.detectability(model, other_rows, ...)")
    if asked.empty:
        return (others,)
    row = asked.loc[asked["size"].idxmax()]
    more = (
        f"To detect {row['cause']} of size {digits.number(row['size'], 2)} in nine of ten data "
        f"sets, plan about {row['rows']:.0f} rows laid out alike."
    )
    return Advice(more), others


def _drawn(result: Detectability) -> Drawn:
    return rendered(
        [plot_power(result.table)],
        "How often each cause would be detected and named, over its size.",
        result.table,
    )


@dataclass(frozen=True)
class Detectability(Reported):
    """How often a diagnosis of planned measurements would detect and name each cause.

    Attributes
    ----------
    table : pandas.DataFrame
        One row a cause and size, see `detectability` for what a size is:

        - detected: share of the data sets in which something is detected;
        - right: in which the kind of the cause is then the most probable one;
        - named: in which it has at least 75 % of the probability, too;
        - confused: in which another kind is the most probable one, and confused_with: which one
          most often;
        - change: the largest change of a row without noise, on the scale of eta, median over the
          data sets; zero for causes in the noise;
        - rows: how many rows, laid out alike, would detect the cause in nine of ten data sets; NaN
          where no size that was tried is detected so often.
    rates : pandas.DataFrame
        Share of the data sets of each cause and size, "none" of size 0 among them, in which each
        kind is found; columns cause, size, found and rate.
    n_rows : int
        Planned rows.
    n_replicates : int
        Data sets of each cause and size, at most.
    false_alarm_rate : float

    Examples
    --------
    >>> import numpy as np
    >>> import hybridsurrogate as hs
    >>> from hybridsurrogate.datasets import make_log_sin
    >>> case = make_log_sin(random_state=0)
    >>> model = hs.PowerScaledSurrogate(case.simulator, surrogate=hs.ExactSurrogate())
    >>> planned = np.linspace(1, 10, 20)[:, None]
    >>> found = hs.detectability(
    ...     model, planned, causes=["step", "trend"], sizes=[1, 4], noise=0.1, random_state=0)
    >>> list(found.confusion(4).index)
    ['none', 'step', 'trend']
    >>> bool(found.smallest()["step"] <= 4)
    True
    """

    table: pd.DataFrame
    rates: pd.DataFrame
    n_rows: int
    n_replicates: int
    false_alarm_rate: float

    def curves(self, of: str = "detected") -> pd.DataFrame:
        """Return power over size: a row a size, a column a cause.

        Parameters
        ----------
        of : {"detected", "right", "named"}, default="detected"
        """
        if of not in ("detected", "right", "named"):
            raise ValueError(f'of must be "detected", "right" or "named", got {of!r}.')
        return _over_size(self.table, of)

    def confusion(self, size: float | None = None) -> pd.DataFrame:
        """Return how often each kind is found: a row a cause, a column a kind, "none" first.

        Parameters
        ----------
        size : float or None, default=None
            One of the sizes; None: on average over all.

        Raises
        ------
        ValueError
            For a size that was not tried.
        """
        known = sorted(set(self.table["size"]))
        if size is not None and size not in known:
            raise ValueError(f"size must be one of {known}, got {size!r}.")
        some = self.rates if size is None else self.rates[self.rates["size"].isin([0.0, size])]
        wide = some.pivot_table(
            index=["cause", "size"], columns="found", values="rate", fill_value=0.0, sort=False
        )
        wide = wide.groupby(level="cause").mean()
        wide = wide.loc[[name for name in (NOTHING, *self.curves()) if name in wide.index]]
        first = [name for name in (NOTHING, *wide.index) if name in wide.columns]
        return wide[[*dict.fromkeys([*first, *wide.columns])]]

    def smallest(self, power: float = POWER) -> pd.Series:
        """Return the smallest size of each cause that is detected with a probability.

        Interpolated between the sizes that were tried; NaN where none is detected so often. At
        most the smallest size that was tried.

        Parameters
        ----------
        power : float, default=0.9
        """
        check_number(power, "power", min_val=0, max_val=1)
        curves = self.curves()
        return pd.Series(
            {name: _of_curve(curves[name], float(power)) for name in curves}, dtype=float
        )

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw how often each cause is detected and named, over its size.

        Parameters
        ----------
        ax : matplotlib Axes or None, default=None

        Returns
        -------
        matplotlib Axes
        """
        return plot_power(self.table, ax)

    def report(self, full: bool = False) -> Report:
        """Return the report: prints as text, shows as HTML, ``.save("report.html")``.

        Parameters
        ----------
        full : bool, default=False
            Whether the text has the tables too; HTML always has them, folded.
        """
        return _report_of(self, full)


def detectability_of(
    conclusions: pd.DataFrame,
    kind_of: Mapping[str, str],
    in_noise: Mapping[str, bool],
    sizes: Sequence[float],
    n_rows: int,
    false_alarm_rate: float,
) -> Detectability:
    """Return the rates of conclusions.

    Parameters
    ----------
    conclusions : DataFrame
        One row a data set: cause, size, found, share and change.
    kind_of : dict of cause to str
        The kind that is its right name.
    in_noise : dict of cause to bool
        Whether it leaves the simulation's output as it is.
    sizes : sequence of float
    n_rows : int
    false_alarm_rate : float
    """
    groups = conclusions.groupby(["cause", "size"], sort=False)
    rates = groups["found"].value_counts(normalize=True).rename("rate").reset_index()
    rows = []
    for label, kind in kind_of.items():
        for size in sizes:
            if (label, size) not in groups.groups:
                continue
            some = groups.get_group((label, size))
            found = some["found"]
            wrong = found[(found != kind) & (found != NOTHING)]
            rows.append(
                {
                    "cause": label,
                    "size": size,
                    "detected": float(np.mean(found != NOTHING)),
                    "right": float(np.mean(found == kind)),
                    "named": float(
                        np.mean((found == kind) & (some["share"] >= SETTINGS.naming_level))
                    ),
                    "confused": len(wrong) / len(some),
                    "confused_with": str(wrong.mode().iloc[0]) if len(wrong) else "",
                    "change": float(np.median(some["change"])),
                }
            )
    table = pd.DataFrame(rows)
    table = table.assign(rows=_rows_needed(table, in_noise, n_rows))
    most = int(groups.size().drop(NOTHING, level="cause").max())
    return Detectability(table, rates, n_rows, most, false_alarm_rate)


def _over_size(table: pd.DataFrame, of: str) -> pd.DataFrame:
    names = list(dict.fromkeys(table["cause"]))
    return table.pivot_table(index="size", columns="cause", values=of)[names]


def _of_curve(curve: pd.Series, power: float) -> float:
    known = curve.dropna()
    return size_at(known.index.to_numpy(dtype=float), known.to_numpy(), power)


def _rows_needed(table: pd.DataFrame, in_noise: Mapping[str, bool], n_rows: int) -> FloatArray:
    """Return how many rows would detect each cause and size.

    A mean over k times as many rows has noise that is smaller by the square root of k, so that
    rows are as the inverse square of the size; a contrast of noise counts by its logarithm.
    """
    curves = _over_size(table, "detected")
    limit = np.array([_of_curve(curves[name], POWER) for name in table["cause"]])
    size = table["size"].to_numpy(dtype=float)
    noise = table["cause"].map(in_noise).to_numpy(dtype=bool)
    limit, size = (np.where(noise, np.log1p(one), one) for one in (limit, size))
    return np.asarray(np.maximum(np.ceil(n_rows * (limit / size) ** 2), 1.0))
