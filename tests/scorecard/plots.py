"""The pictures of a scorecard."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from . import tables
from .page import by_catalogue

_WORDS = {"detected": "detected", "exact": "right kind first", "alike": "near copies counted"}


def plot_reliability(table: pd.DataFrame, ax: Axes) -> None:
    """Stated probability of the first kind against how often it is right."""
    ax.plot([0, 1], [0, 1], color="0.7", linewidth=1)
    for name, part in by_catalogue(table):
        bins = tables.name_calibration(part)
        if bins.empty:
            continue
        ends = np.abs(bins[["low", "high"]].to_numpy().T - bins["right"].to_numpy())
        ax.errorbar(bins["stated"], bins["right"], ends, marker="o", capsize=2, label=name)
    ax.set(xlabel="stated probability of the first kind", ylabel="how often it is right")
    ax.legend()


def plot_rates(table: pd.DataFrame, ax: Axes) -> None:
    """Rates against effect size."""
    for k, (name, part) in enumerate(by_catalogue(table)):
        found = tables.rates(part, "size")
        for style, (word, label) in zip(("-", "--", ":"), _WORDS.items(), strict=True):
            ax.plot(
                found.index,
                found[word],
                style,
                color=f"C{k}",
                marker="o",
                label=f"{label}, {name}",
            )
    sizes = sorted(tables.single(table)["size"].unique())
    ax.set_xscale("log", base=2)
    ax.set_xticks(sizes, [f"{size:g}" for size in sizes])
    ax.set(xlabel="effect size, noise sds", ylabel="share of cases", ylim=(0, 1.02))
    ax.legend(fontsize="small")


def plot_coverage(table: pd.DataFrame, ax: Axes) -> None:
    """Coverage of the intervals, with the limits of so few cases."""
    parts = {name: tables.interval_coverage(part) for name, part in by_catalogue(table)}
    # one place for a number in every catalogue, though not every catalogue has them all
    numbers = sorted({number for found in parts.values() for number in found.index} - {"all"})
    ax.axvline(0.9, color="0.7", linewidth=1)
    for k, (name, found) in enumerate(parts.items()):
        shown = found.drop(index="all", errors="ignore")
        if shown.empty:
            continue
        place = np.array([numbers.index(number) for number in shown.index]) + 0.2 * k
        ends = np.abs(shown[["low", "high"]].to_numpy().T - shown["coverage"].to_numpy())
        ax.errorbar(shown["coverage"], place, xerr=ends, fmt="o", capsize=2, label=name)
    ax.set_yticks(np.arange(len(numbers)), numbers)
    ax.set(xlabel="coverage of 90 % intervals, with 95 % limits", xlim=(0, 1.02))
    if ax.get_legend_handles_labels()[0]:
        ax.legend(loc="lower left", fontsize="small")


PLOTS: dict[str, Callable[[pd.DataFrame, Axes], None]] = {
    "rates": plot_rates,
    "reliability": plot_reliability,
    "coverage": plot_coverage,
}


def write_plots(table: pd.DataFrame, folder: Path) -> list[Path]:
    """Write every picture as scorecard-*.png into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    if tables.single(table).empty:
        return []
    paths = []
    for name, plot in PLOTS.items():
        figure = Figure(figsize=(6, 4.5), layout="constrained")
        plot(table, figure.add_subplot())
        paths.append(folder / f"scorecard-{name}.png")
        figure.savefig(paths[-1], dpi=110)
    return paths
