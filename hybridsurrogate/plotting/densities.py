"""Posterior densities over the weight beta."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import ArrayLike
from scipy import stats

from hybridsurrogate.plotting.style import BEFORE, DATA, QUIET, explain, new_axes
from hybridsurrogate.types import FloatArray

# the highest density reaches over this many lines of its neighbours
_OVERLAP = 1.3
_N_GRID, _OUTSIDE = 400, 0.003


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
    low = min(float(np.quantile(values, _OUTSIDE)) for values in given)
    high = max(float(np.quantile(values, 1 - _OUTSIDE)) for values in given)
    room = 0.05 * (high - low)
    grid = np.linspace(max(low - room, support[0]), min(high + room, support[1]), _N_GRID)
    densities = [_density(values, grid, support) for values in given]
    scale = _OVERLAP / max(float(density.max()) for density in densities)
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
    ax.set_ylim(-0.4, len(given) - 0.9 + _OVERLAP)
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
