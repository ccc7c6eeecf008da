"""The pictures of a scorecard."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from . import tables

_STYLES = {
    "exact": ("right kind first", "-"),
    "alike": ("near copies counted", "--"),
    "same": ("not distinguished counted", ":"),
}
_FORMS = ("first kinds", "later forms")


def plot_reliability(table: pd.DataFrame, ax: Axes) -> None:
    """Stated probability of the first kind against how often it is right."""
    ax.plot([0, 1], [0, 1], color="0.7", linewidth=1)
    bins = tables.name_calibration(table)
    ends = np.abs(bins[["low", "high"]].to_numpy().T - bins["right"].to_numpy())
    ax.errorbar(bins["stated"], bins["right"], ends, marker="o", capsize=2)
    ax.set(xlabel="stated probability of the first kind", ylabel="how often it is right")


def plot_rates(table: pd.DataFrame, ax: Axes) -> None:
    """Rates against effect size, at the number of rows that most cases have."""
    single = tables.single(table)
    rows = single["rows"].mode()[0]
    rates = tables.first_and_later(single[single["rows"] == rows]).droplevel("rows")
    for k, forms in enumerate(_FORMS):
        if forms not in rates.index.get_level_values("forms"):
            continue
        found = rates.loc[forms]
        for rate, (name, style) in _STYLES.items():
            label = f"{forms}, {name}"
            ax.plot(found.index, found[rate], style, color=f"C{k}", marker="o", label=label)
    sizes = sorted(rates.index.get_level_values("size").unique())
    ax.set_xscale("log", base=2)
    ax.set_xticks(sizes, [f"{size:g}" for size in sizes])
    ax.set(xlabel=f"effect size, noise sds ({rows} rows)", ylabel="share of cases", ylim=(0, 1.02))
    ax.legend(fontsize="small")


def plot_coverage(table: pd.DataFrame, ax: Axes) -> None:
    """Coverage of the intervals, with the limits of so few cases."""
    found = tables.interval_coverage(table).drop(index="all", errors="ignore")
    place = np.arange(len(found))
    ax.axvline(0.9, color="0.7", linewidth=1)
    ends = np.abs(found[["low", "high"]].to_numpy().T - found["coverage"].to_numpy())
    ax.errorbar(found["coverage"], place, xerr=ends, fmt="o", capsize=2)
    ax.set_yticks(place, [f"{name} ({n})" for name, n in found["cases"].items()])
    ax.set(xlabel="coverage of 90 % intervals, with 95 % limits", xlim=(0, 1.02))


PLOTS: dict[str, Callable[[pd.DataFrame, Axes], None]] = {
    "rates": plot_rates,
    "reliability": plot_reliability,
    "coverage": plot_coverage,
}


def write_plots(table: pd.DataFrame, folder: Path, page: str = "scorecard") -> list[Path]:
    """Write every picture into a folder, by the name of the page that shows it."""
    folder.mkdir(parents=True, exist_ok=True)
    if tables.single(table).empty:
        return []
    paths = []
    for name, plot in PLOTS.items():
        figure = Figure(figsize=(6, 4.5), layout="constrained")
        plot(table, figure.add_subplot())
        paths.append(folder / f"{page}-{name}.png")
        figure.savefig(paths[-1], dpi=110)
    return paths
