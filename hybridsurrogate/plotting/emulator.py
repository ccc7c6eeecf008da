"""How well an emulator predicts runs that are left out."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.utils.validation import check_is_fitted

from hybridsurrogate.plotting.style import AFTER, DATA, grid_of_axes

if TYPE_CHECKING:
    from hybridsurrogate.emulators.emulator import Emulator

# bars in the histogram, and points that are drawn at most
_BARS, _MOST = 10, 2000


def plot_emulator(emulator: Emulator, axes: ArrayLike | None = None) -> NDArray[np.object_]:
    """Draw runs left out against what an emulator of all others predicts, and their PIT.

    Left the predictions with 90 % intervals, on the line where they are exact; right a histogram of
    where the runs lie in their predictive distributions: level if the intervals are right, a hill
    where they are too wide, a valley where they are too narrow.

    Parameters
    ----------
    emulator : Emulator
        Fitted.
    axes : array of matplotlib Axes of shape (n_outputs, 2), or None

    Returns
    -------
    ndarray of matplotlib Axes, shape (n_outputs, 2)

    Raises
    ------
    sklearn.exceptions.NotFittedError
        Before ``fit``.

    Examples
    --------
    >>> import hybridsurrogate as hs
    >>> from hybridsurrogate.datasets import make_log_sin
    >>> from hybridsurrogate.plotting import plot_emulator
    >>> emulator = hs.Emulator("polynomial").fit(make_log_sin(random_state=0).simulation)
    >>> plot_emulator(emulator).shape
    (1, 2)
    """
    check_is_fitted(emulator, "left_out_")
    left_out = emulator.left_out_
    grid = grid_of_axes(axes, (len(left_out), 2), 8.0, 3.6 * len(left_out))
    for (name, one), (scatter, histogram) in zip(left_out.items(), grid, strict=True):
        some = np.linspace(0, len(one.y) - 1, min(len(one.y), _MOST)).astype(int)
        y, mean, sd = one.y[some], one.mean[some], one.sd[some]
        scatter.errorbar(y, mean, 1.645 * sd, fmt=".", color=AFTER, elinewidth=0.7, ms=3)
        scatter.axline((y.min(), y.min()), slope=1.0, color=DATA, lw=0.8)
        scatter.set(xlabel=f"{name}, simulated", ylabel=f"{name}, predicted without the run")
        scatter.set_title(f"Q² = {one.q2:.4g}")
        histogram.hist(one.pit, np.linspace(0, 1, _BARS + 1), density=True, color=AFTER)
        histogram.axhline(1.0, color=DATA, lw=0.8)
        histogram.set(xlabel="PIT of runs left out", ylabel="density")
        histogram.set_title(f"{100 * one.coverage():.0f} % within 90 % intervals")
    return grid
