"""What predictions are compared with: measurements, the true process, where there is training."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from numpy.typing import ArrayLike

from hybridsurrogate.plotting.style import DATA, HELD_OUT, OMEGA_COLOURS, add_legend, new_axes
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
