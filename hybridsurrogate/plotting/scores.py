"""Scores and densities over the weight beta, and of several simulations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib import ticker
from matplotlib.axes import Axes
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from hybridsurrogate.plotting.style import (
    AFTER,
    BEFORE,
    DATA,
    QUIET,
    SCHEMES,
    explain,
    grid_of_axes,
    list_names,
    new_axes,
    tidy,
)
from hybridsurrogate.scoring.scores import last_of_the_best
from hybridsurrogate.types import FloatArray

# the highest density reaches over this many lines of its neighbours
_OVERLAP_LINES = 1.3


def plot_densities_over_beta(
    betas: Sequence[float],
    draws: Sequence[ArrayLike],
    ax: Axes | None = None,
    prior: Any = None,
    truth: float | None = None,
    label: str = "omega",
    colour: str = BEFORE,
) -> Axes:
    """Draw the density of one unknown at each beta, one above the other, on one scale.

    Under each density are its median and its central 90 %.

    Parameters
    ----------
    betas : sequence of float
        Ascending, evenly spaced or not: each has a separate line.
    draws : sequence of n_betas arrays of shape (n_draws,)
    ax : matplotlib Axes or None
    prior : scipy.stats frozen distribution or None
        Drawn as a dashed outline on every line; densities end where its support does.
    truth : float or None
    label : str
        Name of the unknown.
    colour : matplotlib colour

    Returns
    -------
    matplotlib Axes

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.stats import norm
    >>> from hybridsurrogate.plotting import plot_densities_over_beta
    >>> draws = np.random.default_rng(0).standard_normal((2, 500))
    >>> ax = plot_densities_over_beta((0, 1), draws, prior=norm(0, 1), truth=0.5)
    >>> ax.get_xlabel()
    'omega'
    """
    own = ax is None
    ax = ax or new_axes(width=5.0, height=1.2 + 0.4 * len(betas))[0]
    given = [np.asarray(values, dtype=float) for values in draws]
    support = (-np.inf, np.inf) if prior is None else tuple(map(float, prior.support()))
    low = min(float(np.quantile(values, 0.003)) for values in given)
    high = max(float(np.quantile(values, 0.997)) for values in given)
    room = 0.05 * (high - low)
    grid = np.linspace(max(low - room, support[0]), min(high + room, support[1]), 400)
    densities = [_density(values, grid, support) for values in given]
    scale = _OVERLAP_LINES / max(float(density.max()) for density in densities)
    believed = None if prior is None else scale * prior.pdf(grid)
    for place, (values, density) in reversed(list(enumerate(zip(given, densities, strict=True)))):
        # a lower density hides what is behind it
        depth = 2.0 + 0.1 * (len(given) - place)
        top = place + scale * density
        ax.fill_between(grid, place, top, color=colour, alpha=0.55, lw=0, zorder=depth)
        ax.plot(grid, top, color=colour, lw=1, zorder=depth)
        if believed is not None:
            word = "prior" if place == 0 else ""
            ax.plot(grid, place + believed, "--", color=QUIET, lw=0.9, label=word, zorder=depth)
        ends = np.quantile(values, (0.05, 0.5, 0.95))
        words = ("90 %", "median") if place == 0 else ("", "")
        ax.hlines(place, ends[0], ends[2], color=DATA, lw=1.6, label=words[0], zorder=depth + 0.05)
        ax.plot(ends[1], place, "o", color=DATA, ms=3.5, label=words[1], zorder=depth + 0.06)
    if truth is not None:
        ax.axvline(truth, color=DATA, ls=":", lw=1.3, label=f"truth, {truth:g}", zorder=9)
    ax.set_yticks(range(len(given)), labels=[f"{beta:g}" for beta in betas])
    ax.set_ylim(-0.4, len(given) - 0.9 + _OVERLAP_LINES)
    ax.set_xlim(grid[0], grid[-1])
    ax.set_xlabel(label)
    ax.set_ylabel("beta")
    ax.spines[["top", "right", "left"]].set_visible(False)
    ax.tick_params(axis="y", length=0)
    explain([ax], below=own)
    return ax


def _density(draws: FloatArray, grid: FloatArray, support: tuple[float, ...]) -> FloatArray:
    """Return a kernel density that keeps its mass within its support, by reflection."""
    smooth = stats.gaussian_kde(draws)
    mirrored = [smooth(2 * end - grid) for end in support if np.isfinite(end)]
    return np.asarray(smooth(grid) + sum(mirrored))


def plot_comparison(table: pd.DataFrame, ax: Axes | None = None) -> Axes:
    """Draw the held-out score of each simulation as a difference from the best.

    Bars are one standard error of the paired difference to either side.

    Parameters
    ----------
    table : DataFrame
        ``table`` of a `SimulationComparison`.
    ax : matplotlib Axes, optional

    Returns
    -------
    matplotlib Axes

    Examples
    --------
    >>> import pandas as pd
    >>> from hybridsurrogate.plotting import plot_comparison
    >>> rows = {"difference": [0.0, -0.7], "difference_error": [0.0, 0.2]}
    >>> plot_comparison(pd.DataFrame(rows, index=["fine", "coarse"])).get_xlabel()
    'held-out ELPD a row, less that of the best'
    """
    ax = new_axes(height=1.2 + 0.45 * len(table))[0] if ax is None else ax
    ax.errorbar(
        table["difference"],
        list_names(ax, table.index),
        xerr=table["difference_error"].fillna(0.0),
        fmt="o",
        color=BEFORE,
        capsize=3,
    )
    ax.axvline(0.0, color=QUIET, lw=0.8, ls=":")
    return tidy(ax, "held-out ELPD a row, less that of the best", "", legend=False)


# each score: its name on the axis, and whether more of it is better
SCORES = {
    "elpd": ("ELPD per row (higher is better)", True),
    "rmse": ("RMSE (lower is better)", False),
}
# lines of other models
_LINES = ("-.", ":", (0, (5, 1)), (0, (1, 3)))


def plot_scores_over_beta(
    table: pd.DataFrame, axes: ArrayLike | None = None, references: pd.DataFrame | None = None
) -> NDArray[np.object_]:
    """Draw ELPD and RMSE over beta: a column for each test set, a line for each scheme.

    Lines are means over repeats, bands cover the central 90 % of the repeats, rings the best beta.
    Scores far worse than the best leave the view: 8 in ELPD, a factor of 30 in RMSE.

    Parameters
    ----------
    table : pandas.DataFrame
        Columns ``scheme``, ``test``, ``beta``, ``elpd`` and ``rmse``. Rows that agree in the first
        three are repeats: other seeds of the draws show the Monte Carlo error, other data that of
        the data. One row alone has no band.
    axes : array of matplotlib Axes of shape (2, n_tests), or None
    references : pandas.DataFrame or None
        Models without a beta, as level lines: columns ``model``, ``test``, ``elpd`` and ``rmse``.

    Returns
    -------
    ndarray of matplotlib Axes, shape (2, n_tests)

    Examples
    --------
    >>> import pandas as pd
    >>> from hybridsurrogate.plotting import plot_scores_over_beta
    >>> rows = [("power scaling", "in range", b, -b, 1 + b) for b in (0.0, 0.5, 1.0)]
    >>> table = pd.DataFrame(rows, columns=["scheme", "test", "beta", "elpd", "rmse"])
    >>> plot_scores_over_beta(table).shape
    (2, 1)
    """
    tests = list(dict.fromkeys(table["test"]))
    shape = (len(SCORES), len(tests))
    grid = grid_of_axes(axes, shape, 1.0 + 3.1 * shape[1], 5.6)
    for row, (score, (title, more)) in zip(grid, SCORES.items(), strict=True):
        for ax, test in zip(row, tests, strict=True):
            shown = table[table["test"] == test]
            _plot_schemes(ax, shown, score, more)
            if references is not None:
                _plot_references(ax, references[references["test"] == test], score)
        row[0].set_ylabel(title)
    for ax, test in zip(grid[0], tests, strict=True):
        ax.set_title(test, fontsize="medium")
    for ax in grid[-1]:
        ax.set_xlabel("beta")
    explain(list(grid.ravel()), below=axes is None)
    return grid


def _plot_schemes(ax: Axes, table: pd.DataFrame, score: str, more: bool) -> None:
    schemes = zip(table.groupby("scheme", sort=False), SCHEMES, strict=False)
    for k, ((scheme, rows), style) in enumerate(schemes):
        repeats = rows.groupby("beta")[score]
        mean, low, high = repeats.mean(), repeats.quantile(0.05), repeats.quantile(0.95)
        beta, line = mean.index.to_numpy(dtype=float), mean.to_numpy(dtype=float)
        ax.fill_between(beta, low, high, color=style.colour, alpha=0.25, lw=0)
        form = style.line + style.mark
        ax.plot(beta, line, form, color=style.colour, ms=4, label=scheme)
        best = int(line.argmax() if more else line.argmin())
        # of different sizes, as the best is often at the same end
        size = 9 + 4 * k
        ax.plot(beta[best], line[best], "o", ms=size, mfc="none", color=style.colour)
    ax.set_xlim(-0.04, 1.04)
    best, worst = (table[score].max(), table[score].min())[:: 1 if more else -1]
    # what is 8 nats a row or 30 times worse than the best leaves the view
    if more:
        ax.set_ylim(bottom=max(float(ax.get_ylim()[0]), best - 8))
    elif best > 0 and worst > 5 * best:
        ax.set_yscale("log")
        ax.set_ylim(0.8 * best, 1.25 * min(worst, 30 * best))
        ax.yaxis.set_major_locator(ticker.LogLocator(subs=(1, 2, 5)))
        ax.yaxis.set_major_formatter("{x:g}")
        ax.yaxis.set_minor_formatter(ticker.NullFormatter())


def _plot_references(ax: Axes, table: pd.DataFrame, score: str) -> None:
    levels = table.groupby("model", sort=False)[score].mean()
    if levels.empty:
        return
    for (model, level), line in zip(levels.items(), _LINES, strict=False):
        ax.axhline(level, color=DATA, ls=line, lw=1.2, label=model)
    # a model that is better than every beta is what the level is drawn for
    low, high = ax.get_ylim()
    if score == "elpd":
        ax.set_ylim(low, max(high, float(levels.max()) + 0.05 * (high - low)))
    else:
        ax.set_ylim(min(low, 0.8 * float(levels.min())), high)


def plot_beta_scan(table: pd.DataFrame, ax: Axes | None = None) -> Axes:
    """Draw held-out ELPD against beta before and after, the largest of the best betas marked.

    Parameters
    ----------
    table : pandas.DataFrame
        From ``DiscrepancyDiagnosis.beta_scan``.
    ax : matplotlib Axes or None

    Returns
    -------
    matplotlib Axes

    Examples
    --------
    >>> import pandas as pd
    >>> from hybridsurrogate.plotting import plot_beta_scan
    >>> scan = {"beta": [0.0, 0.5, 1.0], "before": [-1.0, -2, -3], "after": [-1.0, -0.5, -0.8]}
    >>> ax = plot_beta_scan(pd.DataFrame(scan))
    >>> [text.get_text() for text in ax.get_legend().get_texts()]
    ['before, best beta 0', 'after, best beta 0.5']
    """
    ax = ax or new_axes()[0]
    for word, colour, line in (("before", BEFORE, "--o"), ("after", AFTER, "-s")):
        best = table.iloc[last_of_the_best(table[word])]
        label = f"{word}, best beta {best['beta']:g}"
        ax.plot(table["beta"], table[word], line, ms=4, color=colour, label=label)
        ax.plot(best["beta"], best[word], "o", ms=12, mfc="none", color=colour)
    ax.set_xlabel("beta (0: measured data only, 1: simulation only)")
    ax.set_xlim(-0.03, 1.03)
    ax.set_ylabel("held-out log density per row")
    ax.legend(frameon=False, fontsize="small")
    return ax
