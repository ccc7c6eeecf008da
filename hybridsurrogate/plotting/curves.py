"""Predictions over one input, with what they are compared with."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize, to_rgb
from numpy.typing import ArrayLike, NDArray

from hybridsurrogate.plotting.style import (
    BEFORE,
    DATA,
    HELD_OUT,
    OMEGA_COLOURS,
    QUIET,
    SCHEMES,
    add_legend,
    explain,
    grid_of_axes,
    new_axes,
)
from hybridsurrogate.types import FloatArray

_SHADE = "#ECECEC"
# of the bars that show ranges, in shares of the Axes' height
_BAR_STEP, _BAR_TOP = 0.07, 0.96


class Scene(NamedTuple):
    """What figures of one case study have in common; what is None is not drawn.

    Parameters
    ----------
    measured : pair of ndarray of shape (n,)
        Inputs and outputs.
    truth : pair of ndarray of shape (m,)
        Inputs in ascending order and the output of the true process, without noise.
    train : pair of float
        Range of the measured inputs.
    tests : dict of str to pair of float
        Ranges of the test sets by their names.
    xlabel, ylabel : str
    y_err : ndarray of shape (n,) or None
        Known standard deviations of what was measured: bars.

    Examples
    --------
    >>> import numpy as np
    >>> from hybridsurrogate.plotting import Scene
    >>> x = np.linspace(1, 100, 30)
    >>> Scene((x, np.log(x)), train=(1, 100), ylabel="height").ylabel
    'height'
    """

    measured: tuple[FloatArray, FloatArray] | None = None
    truth: tuple[FloatArray, FloatArray] | None = None
    train: tuple[float, float] | None = None
    tests: Mapping[str, tuple[float, float]] | None = None
    xlabel: str = "x"
    ylabel: str = "y"
    y_err: FloatArray | None = None

    @property
    def outputs(self) -> FloatArray:
        """All outputs that must be in sight."""
        pairs = [pair for pair in (self.measured, self.truth) if pair is not None]
        return np.concatenate([np.empty(0), *(np.asarray(y, dtype=float) for _, y in pairs)])


def plot_measured(
    ax: Axes,
    x: FloatArray,
    y: FloatArray,
    label: str = "measured",
    held_out: bool = False,
    y_err: FloatArray | None = None,
) -> Axes:
    """Draw measurements as dots, those held out as crosses, their known errors as bars.

    Parameters
    ----------
    ax : matplotlib Axes
    x, y : ndarray of shape (n,)
    label : str, default="measured"
    held_out : bool, default=False
    y_err : ndarray of shape (n,) or None, default=None
        Known standard deviations.

    Returns
    -------
    matplotlib Axes

    Examples
    --------
    >>> import numpy as np
    >>> from matplotlib.figure import Figure
    >>> from hybridsurrogate.plotting import plot_measured
    >>> x = np.array([0.0, 1.0])
    >>> ax = plot_measured(Figure().subplots(), x, 2 * x, "later", held_out=True)
    >>> ax.lines[0].get_marker(), ax.lines[0].get_label()
    ('x', 'later')
    """
    mark, colour = ("x", HELD_OUT) if held_out else (".", DATA)
    size = 4 if len(x) <= 150 else 2.5
    ax.plot(x, y, mark, color=colour, ms=size + held_out, label=label, zorder=3)
    if y_err is not None:
        ax.errorbar(x, y, y_err, fmt="none", ecolor=colour, elinewidth=0.6, alpha=0.5, zorder=2.9)
    return ax


def plot_scene(scene: Scene, ax: Axes | None = None) -> Axes:
    """Draw measurements as dots, the true process as a dashed line, the range of training shaded.

    Parameters
    ----------
    scene : Scene
    ax : matplotlib Axes or None

    Returns
    -------
    matplotlib Axes

    Examples
    --------
    >>> import numpy as np
    >>> from hybridsurrogate.plotting import Scene, plot_scene
    >>> x = np.linspace(0, 10, 5)
    >>> ax = plot_scene(Scene((x, x**2), truth=(x, x**2), train=(0, 10), xlabel="days"))
    >>> ax.get_xlabel(), len(ax.lines), len(ax.patches)
    ('days', 2, 1)
    """
    ax = ax or new_axes()[0]
    if scene.train is not None:
        ax.axvspan(*scene.train, color=_SHADE, lw=0, zorder=0)
    if scene.truth is not None:
        ax.plot(*scene.truth, color=DATA, ls="--", lw=1.2, label="true process", zorder=3)
    if scene.measured is not None:
        plot_measured(ax, *scene.measured, y_err=scene.y_err)
    ax.set_xlabel(scene.xlabel)
    ax.set_ylabel(scene.ylabel)
    return ax


def plot_setup(
    scene: Scene,
    x: ArrayLike,
    y: ArrayLike,
    omega: ArrayLike,
    ax: Axes | None = None,
    omega_label: str = "omega",
) -> Axes:
    """Draw runs of a simulation under the measurements, and bars for training and test.

    Parameters
    ----------
    scene : Scene
    x, y, omega : array-like of shape (n_runs,)
        One input, the output and one parameter of the runs, which colours them.
    ax : matplotlib Axes or None
    omega_label : str
        Name of the parameter, at the colour bar.

    Returns
    -------
    matplotlib Axes

    Examples
    --------
    >>> import numpy as np
    >>> from hybridsurrogate.datasets import make_log_sin
    >>> from hybridsurrogate.plotting import Scene, plot_setup
    >>> case, x = make_log_sin(random_state=0), np.linspace(1, 200, 100)
    >>> truth = case.simulator(x, np.ones(100)) + np.sin(0.05 * x)
    >>> tests = {"in range": (1, 100), "out of range": (100, 200)}
    >>> scene = Scene((case.X[:, 0], case.y), (x, truth), (1, 100), tests)
    >>> runs = case.simulation
    >>> plot_setup(scene, runs.X[:, 0], runs.y, runs.omega[:, 0]).get_xlabel()
    'x'
    """
    ax = plot_scene(scene, ax)
    omega = np.asarray(omega, dtype=float)
    norm = Normalize(float(omega.min()), float(omega.max()))
    runs = ax.scatter(
        x, y, c=omega, cmap=OMEGA_COLOURS, norm=norm, s=14, lw=0, label="simulation runs", zorder=2
    )
    ax.figure.colorbar(runs, ax=ax, label=omega_label, pad=0.01)
    bars = {} if scene.train is None else {"training": scene.train}
    bars |= {f"test: {name}": ends for name, ends in (scene.tests or {}).items()}
    low, high = ax.get_ylim()
    # headroom, so that the bars lie above all points
    ax.set_ylim(low, low + (high - low) / (1 - _BAR_STEP * (len(bars) + 0.5)))
    over = ax.get_xaxis_transform()
    for k, (name, (start, end)) in enumerate(bars.items()):
        place, colour = _BAR_TOP - k * _BAR_STEP, DATA if name == "training" else HELD_OUT
        ax.plot([start, end], [place] * 2, "|-", color=colour, lw=1.5, transform=over)
        note = ax.text((start + end) / 2, place, name, transform=over, fontsize="small")
        note.set(ha="center", va="center", color=colour)
        note.set_bbox({"facecolor": "white", "edgecolor": "none", "pad": 1})
    return add_legend(ax)


# central intervals, and how much of a scheme's colour their bands have, the widest first
LEVELS = {0.99: 0.18, 0.9: 0.38, 0.5: 0.62}


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
    chosen = np.random.default_rng(0).permutation(len(draws))[:100]
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
    for level, tint in LEVELS.items():
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
    ends = np.array([np.quantile(values, (0.005, 0.995)) for values in drawn])
    low, high = ends[:, 0].min(), ends[:, 1].max()
    known = np.empty(0) if scene is None else scene.outputs
    if len(known):
        room = 0.5 * float(np.ptp(known))
        low = max(min(low, known.min()), known.min() - room)
        high = min(max(high, known.max()), known.max() + room)
    margin = 0.04 * (high - low) or 1.0
    return float(low - margin), float(high + margin)
