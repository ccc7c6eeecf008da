"""Space-filling designs: where to run a simulation."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.stats import qmc

from hybridsurrogate.priors import FloatArray

_DESIGNS = ("sobol", "latin-hypercube")

# scipy 1.15 renamed the engines' argument from seed to rng
_RNG_NAME = "rng" if "rng" in inspect.signature(qmc.Sobol).parameters else "seed"


def draw_design(
    ranges: Sequence[tuple[float, float]],
    n_runs: int,
    design: str = "sobol",
    random_state: Any = None,
) -> FloatArray:
    """Draw points that fill a box evenly.

    Parameters
    ----------
    ranges : sequence of k pairs (low, high)
    n_runs : int
        Number of points.
    design : {"sobol", "latin-hypercube"}
        A scrambled Sobol sequence, or a Latin hypercube.
    random_state : None, int, numpy Generator or RandomState

    Returns
    -------
    ndarray of shape (n_runs, k)

    Examples
    --------
    >>> from hybridsurrogate.design import draw_design
    >>> draw_design([(0, 1), (10, 20)], 5, random_state=0).shape
    (5, 2)
    """
    if n_runs < 1:
        raise ValueError(f"n_runs must be at least 1, got {n_runs}.")
    engine_options: dict[str, Any] = {_RNG_NAME: random_generator(random_state)}
    if design == "sobol":
        # scipy warns unless a power of two is drawn; the first n points of one fill the box too
        power = int(n_runs - 1).bit_length()
        unit = qmc.Sobol(len(ranges), **engine_options).random_base2(power)[:n_runs]
    elif design == "latin-hypercube":
        unit = qmc.LatinHypercube(len(ranges), **engine_options).random(n_runs)
    else:
        raise ValueError(f"design must be one of {', '.join(_DESIGNS)}, got {design!r}.")
    low, high = np.asarray(ranges, dtype=float).T
    return low + unit * (high - low)


def run_with_ends(
    outputs: Callable[[FloatArray], tuple[FloatArray, str | None]],
    points: FloatArray,
    ranges: Sequence[tuple[float, float]],
    share: float,
) -> tuple[FloatArray, FloatArray, str | None]:
    """Run points of which a share is moved to each end of each of the first ranges.

    A space-filling design has none at the ends, where functions are steepest and nothing is known
    beyond. Other points go to each end, the last ones first. Those stay where they were that have
    no output at the end, or one further beyond all others than these are apart: a source has any
    level at a distance of zero, and tells nothing there of what it is elsewhere.

    Parameters
    ----------
    outputs : callable
        ``outputs(points) -> (n,), str or None``, and what the first run that failed said.
    points : ndarray of shape (n, k)
    ranges : sequence of at most k pairs (low, high)
    share : float

    Returns
    -------
    points (n, k), outputs (n,), and what the first run that failed said.
    """
    moved, last = points.copy(), len(points)
    for j, ends in enumerate(ranges):
        for end in ends:
            first = max(last - round(share * len(points)), 0)
            moved[first:last, j] = end
            last = first
    # what fails at an end is told by its output, not by numpy's warnings
    with np.errstate(all="ignore" if last < len(points) else None):
        y, error = outputs(moved)
    others = y[:last][np.isfinite(y[:last])]
    low, high = (others.min(), others.max()) if others.size else (-np.inf, np.inf)
    within = np.isfinite(y) & (y >= 2 * low - high) & (y <= 2 * high - low)
    back = last + np.flatnonzero(~within[last:])
    if back.size:
        moved[back] = points[back]
        y[back], again = outputs(points[back])
        error = again or error
    return moved, y, error


def random_generator(random_state: Any) -> np.random.Generator:
    """Return a numpy Generator from None, an int, a Generator or a RandomState."""
    # numpy makes no Generator from a RandomState, which scikit-learn's users pass: it draws a seed
    if isinstance(random_state, np.random.RandomState):
        random_state = random_state.randint(2**31 - 1)
    return np.random.default_rng(random_state)
