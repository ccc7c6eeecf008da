"""Predictions over one input: draws of the mean, and bands with the noise."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize, to_rgb
from numpy.typing import ArrayLike, NDArray

from hybridsurrogate.plotting.scene import Scene, plot_scene
from hybridsurrogate.plotting.style import (
    BEFORE,
    OMEGA_COLOURS,
    QUIET,
    SCHEMES,
    explain,
    grid_of_axes,
    new_axes,
)

LEVELS = (0.99, 0.9, 0.5)
_N_LINES = 100
# share of the outputs drawn that may lie above or below the view
_RUNAWAY = 0.005
# how much of a scheme's colour the bands have, the widest first
_TINTS = (0.18, 0.38, 0.62)


def plot_mean_draws(
    x: ArrayLike,
    draws: ArrayLike,
    omega: ArrayLike,
    ax: Axes | None = None,
    scene: Scene | None = None,
    norm: Normalize | None = None,
) -> Axes:
    """Draw predictive means as lines, each in the colour of its omega.

    Parameters
    ----------
    x : array-like of shape (n,)
    draws : array-like of shape (n_draws, n)
        Without noise, as from ``sample_predictive_mean``; 100 of them are drawn.
    omega : array-like of shape (n_draws,)
        One parameter of each draw; NaN, drawn grey, where a surrogate has none: that of the
        measured data in predictive weighting.
    ax : matplotlib Axes or None
    scene : Scene or None
        Measurements, true process and training range, drawn with them.
    norm : matplotlib Normalize or None
        Scale of the colours; None: the range of ``omega``.

    Returns
    -------
    matplotlib Axes

    Examples
    --------
    >>> import numpy as np
    >>> from hybridsurrogate.plotting import plot_mean_draws
    >>> x, omega = np.linspace(0, 1, 20), np.array([0.9, 1.0, np.nan])
    >>> ax = plot_mean_draws(x, np.array([[0.9], [1.0], [1.5]]) * x, omega)
    >>> [len(lines.get_segments()) for lines in ax.collections]
    [2, 1]
    """
    ax = ax or new_axes()[0]
    x, draws, omega = (np.asarray(values, dtype=float) for values in (x, draws, omega))
    norm = norm or omega_norm([omega])
    # any subset, so that the parts of a mixture, which come one after the other, both show
    chosen = np.random.default_rng(0).permutation(len(draws))[:_N_LINES]
    order = np.argsort(x)
    x_all = np.broadcast_to(x[order], (len(chosen), len(x)))
    lines, shown = np.stack([x_all, draws[chosen][:, order]], axis=2), omega[chosen]
    known = np.isfinite(shown)
    look = {"lw": 0.7, "alpha": 0.5}
    coloured = LineCollection(list(lines[known]), cmap=OMEGA_COLOURS, norm=norm, zorder=2, **look)
    coloured.set_array(shown[known])
    ax.add_collection(coloured)
    if not known.all():
        plain = LineCollection(list(lines[~known]), colors=QUIET, zorder=1.9, **look)
        plain.set_label("draws without omega")
        ax.add_collection(plain)
    ax.autoscale_view()
    return ax if scene is None else plot_scene(scene, ax)


def omega_norm(omega: Sequence[ArrayLike]) -> Normalize:
    """Return one scale of colours for draws of omega: all but their outermost 1 %."""
    known = np.concatenate([np.ravel(np.asarray(values, dtype=float)) for values in omega])
    known = known[np.isfinite(known)]
    low, high = np.quantile(known, (0.005, 0.995)) if len(known) else (0.0, 1.0)
    return Normalize(float(low), float(high), clip=True)


def plot_mean_draws_over_beta(
    x: ArrayLike,
    draws: Mapping[str, Sequence[ArrayLike]],
    omega: Mapping[str, Sequence[ArrayLike]],
    betas: Sequence[float],
    axes: ArrayLike | None = None,
    scene: Scene | None = None,
    omega_label: str = "omega",
) -> NDArray[np.object_]:
    """Draw predictive means coloured by omega: a column for each beta, a row for each scheme.

    Parameters
    ----------
    x : array-like of shape (n,)
    draws : dict of str to n_betas arrays of shape (n_draws, n)
        By the name of the scheme.
    omega : dict of str to n_betas arrays of shape (n_draws,)
        As in `plot_mean_draws`.
    betas : sequence of float
    axes : array of matplotlib Axes of shape (n_schemes, n_betas), or None
    scene : Scene or None
    omega_label : str
        Name of the parameter, at the colour bar.

    Returns
    -------
    ndarray of matplotlib Axes, shape (n_schemes, n_betas)

    Examples
    --------
    >>> import numpy as np
    >>> from hybridsurrogate.plotting import plot_mean_draws_over_beta
    >>> x, omega = np.linspace(0, 1, 20), np.array([0.9, 1.0, 1.1])
    >>> draws = {"power scaling": [omega[:, None] * x] * 2}
    >>> plot_mean_draws_over_beta(x, draws, {"power scaling": [omega] * 2}, (0, 0.5)).shape
    (1, 2)
    """
    norm = omega_norm([values for scheme in draws for values in omega[scheme]])

    def draw(ax: Axes, scheme: str, k: int) -> None:
        plot_mean_draws(x, draws[scheme][k], omega[scheme][k], ax, scene, norm)

    grid = _over_beta(draws, betas, axes, scene, draw)
    bar = ScalarMappable(norm, OMEGA_COLOURS)
    look = {"extend": "both", "pad": 0.01, "aspect": 30}
    grid[0, 0].figure.colorbar(bar, ax=list(grid.ravel()), label=omega_label, **look)
    return grid


def plot_predictive_bands(
    x: ArrayLike,
    draws: ArrayLike,
    ax: Axes | None = None,
    scene: Scene | None = None,
    colour: str = BEFORE,
) -> Axes:
    """Draw the median and the central 50, 90 and 99 % of posterior predictive draws.

    Parameters
    ----------
    x : array-like of shape (n,)
    draws : array-like of shape (n_draws, n)
        With noise, as from ``sample_posterior_predictive``.
    ax : matplotlib Axes or None
    scene : Scene or None
        Measurements, true process and training range, drawn with them.
    colour : matplotlib colour

    Returns
    -------
    matplotlib Axes

    Examples
    --------
    >>> import numpy as np
    >>> from hybridsurrogate.plotting import plot_predictive_bands
    >>> draws = np.random.default_rng(0).standard_normal((500, 20))
    >>> ax = plot_predictive_bands(np.linspace(0, 1, 20), draws)
    >>> [band.get_label() for band in ax.collections]
    ['99 %', '90 %', '50 %']
    """
    ax = ax or new_axes()[0]
    x, draws = np.asarray(x, dtype=float), np.asarray(draws, dtype=float)
    order = np.argsort(x)
    for level, tint in zip(LEVELS, _TINTS, strict=True):
        ends = np.quantile(draws, (0.5 - level / 2, 0.5 + level / 2), axis=0)[:, order]
        # mixed with white, so that bands over each other keep their colours
        shade = tuple(1 - tint * (1 - part) for part in to_rgb(colour))
        label = f"{100 * level:g} %"
        ax.fill_between(x[order], *ends, color=shade, lw=0, label=label, zorder=2)
    middle = np.median(draws, axis=0)[order]
    ax.plot(x[order], middle, color=colour, lw=1.3, label="median", zorder=3)
    return ax if scene is None else plot_scene(scene, ax)


def plot_bands_over_beta(
    x: ArrayLike,
    draws: Mapping[str, Sequence[ArrayLike]],
    betas: Sequence[float],
    axes: ArrayLike | None = None,
    scene: Scene | None = None,
) -> NDArray[np.object_]:
    """Draw posterior predictive bands: a column for each beta, a row for each scheme.

    Parameters
    ----------
    x : array-like of shape (n,)
    draws : dict of str to n_betas arrays of shape (n_draws, n)
        With noise, by the name of the scheme.
    betas : sequence of float
    axes : array of matplotlib Axes of shape (n_schemes, n_betas), or None
    scene : Scene or None

    Returns
    -------
    ndarray of matplotlib Axes, shape (n_schemes, n_betas)

    Examples
    --------
    >>> import numpy as np
    >>> from hybridsurrogate.plotting import plot_bands_over_beta
    >>> draws = np.random.default_rng(0).standard_normal((500, 20))
    >>> schemes = {"power scaling": [draws] * 3, "predictive weighting": [draws] * 3}
    >>> plot_bands_over_beta(np.linspace(0, 1, 20), schemes, (0, 0.5, 1)).shape
    (2, 3)
    """
    styles = dict(zip(draws, SCHEMES, strict=False))

    def draw(ax: Axes, scheme: str, k: int) -> None:
        plot_predictive_bands(x, draws[scheme][k], ax, scene, styles[scheme].colour)

    return _over_beta(draws, betas, axes, scene, draw)


def _over_beta(
    draws: Mapping[str, Sequence[ArrayLike]],
    betas: Sequence[float],
    axes: ArrayLike | None,
    scene: Scene | None,
    draw: Callable[[Axes, str, int], None],
) -> NDArray[np.object_]:
    shape = (len(draws), len(betas))
    grid = grid_of_axes(axes, shape, 1.2 + 1.9 * shape[1], 1.0 + 1.9 * shape[0])
    for row, scheme in zip(grid, draws, strict=True):
        for k, ax in enumerate(row):
            draw(ax, scheme, k)
            ax.label_outer()
        row[0].set_ylabel(f"{scheme}\n{row[0].get_ylabel()}")
    for ax, beta in zip(grid[0], betas, strict=True):
        ax.set_title(f"beta = {beta:g}", fontsize="medium")
    view = _view(draws, scene)
    for ax in grid.ravel():
        ax.set_ylim(*view)
    explain(list(grid.ravel()), below=axes is None)
    return grid


def _view(draws: Mapping[str, Sequence[ArrayLike]], scene: Scene | None) -> tuple[float, float]:
    """Return the range of outputs to show: wide enough for the data, not for a runaway curve."""
    drawn = [np.asarray(values, dtype=float) for scheme in draws.values() for values in scheme]
    ends = np.array([np.quantile(values, (_RUNAWAY, 1 - _RUNAWAY)) for values in drawn])
    low, high = ends[:, 0].min(), ends[:, 1].max()
    known = np.empty(0) if scene is None else scene.outputs
    if len(known):
        room = 0.5 * float(np.ptp(known))
        low = max(min(low, known.min()), known.min() - room)
        high = min(max(high, known.max()), known.max() + room)
    margin = 0.04 * (high - low) or 1.0
    return float(low - margin), float(high + margin)
