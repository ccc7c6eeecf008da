"""Space-filling designs: where to run a simulation."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from numbers import Integral
from typing import Any

import numpy as np
from scipy.stats import qmc

from hybridsurrogate.arguments import check_choice, check_number, random_generator
from hybridsurrogate.types import FloatArray

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
    >>> from hybridsurrogate.simulation.design import draw_design
    >>> draw_design([(0, 1), (10, 20)], 5, random_state=0).shape
    (5, 2)
    """
    # points of a Sobol sequence have 30 bits
    check_number(n_runs, "n_runs", Integral, min_val=1, max_val=2**30)
    check_choice(design, "design", _DESIGNS)
    engine_options: dict[str, Any] = {_RNG_NAME: random_generator(random_state)}
    if design == "sobol":
        # scipy warns unless a power of two is drawn; the first n points of one fill the box too
        power = int(n_runs - 1).bit_length()
        unit = qmc.Sobol(len(ranges), **engine_options).random_base2(power)[:n_runs]
    else:
        unit = qmc.LatinHypercube(len(ranges), **engine_options).random(n_runs)
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
    beyond. Other points go to each end, the last ones first, a quarter of all at the most. A point
    stays where it was if its output at the end is missing, or further beyond all others than these
    are apart. For example, a source has an unbounded level at a distance of zero, which does not
    inform a surrogate elsewhere.

    Parameters
    ----------
    outputs : callable
        ``outputs(points) -> (n,) or (n, k), str or None``, and what the first run that failed said.
    points : ndarray of shape (n, d)
    ranges : sequence of at most d pairs (low, high)
    share : float

    Returns
    -------
    points (n, d), outputs, and what the first run that failed said.
    """
    n = len(points)
    each = min(round(share * n), n // (8 * len(ranges)))
    moved, last = points.copy(), n
    for j, ends in enumerate(ranges):
        for end in ends:
            moved[last - each : last, j] = end
            last -= each
    y, error = outputs(points[:last])
    if last == n:
        return points, y, error
    try:
        # a failure at an end shows in its output, not in numpy's warnings
        with np.errstate(all="ignore"):
            at_ends, _ = outputs(moved[last:])
    except Exception:  # of a function of arrays, that some ends make fail for all
        at_ends = np.full((n - last, *y.shape[1:]), np.nan)
    finite = np.isfinite(y)
    none = not finite.any()
    low = np.min(y, axis=0, where=finite, initial=-np.inf if none else np.inf)
    high = np.max(y, axis=0, where=finite, initial=np.inf if none else -np.inf)
    within = np.isfinite(at_ends) & (at_ends >= 2 * low - high) & (at_ends <= 2 * high - low)
    within = within.reshape(n - last, -1).all(axis=1)
    if not within.all():
        back = last + np.flatnonzero(~within)
        moved[back] = points[back]
        at_ends[~within], again = outputs(points[back])
        error = error or again
    return moved, np.concatenate([y, at_ends]), error
