"""The smallest fault that would have shown in these rows, with these runs and priors."""

from __future__ import annotations

import numpy as np

from hybridsurrogate.diagnosis.search.null_test import NullTest, faults_of
from hybridsurrogate.diagnosis.search.search import Search
from hybridsurrogate.types import FloatArray

# share of the data sets in which a fault has to show
_POWER = 0.9


def smallest_detectable(result: Search, test: NullTest | None, rate: float) -> float | None:
    """Return the root mean square of the smallest fault that would have been detected.

    A fault of some size shows where the p-value of the whole search is at most ``rate`` in nine of
    ten data sets with it, see `faults_of`. The median over the shapes is returned: a parameter of
    the simulation may absorb one shape, and not the others.

    Parameters
    ----------
    result : Search
        The first one.
    test : NullTest or None
        Of the same search.
    rate : float
        False alarm rate.

    Returns
    -------
    float or None
        On the scale of eta. None where rows do not vary along an input, or no such fault up to 16
        times the residual and the emulator's error shows.
    """
    if test is None:
        return None
    limit = float(np.quantile(test.replicates, 1 - rate, method="higher"))
    sizes, statistic = test.faults or faults_of(result)
    if not len(statistic):
        return None
    return _median_size(np.mean(statistic > limit, axis=2), sizes)


def _median_size(power: FloatArray, sizes: FloatArray) -> float | None:
    """Return the median over shapes of the size from which on all larger ones show."""
    enough = np.flip(np.cumprod(np.flip(power >= _POWER, axis=1), axis=1), axis=1).astype(bool)
    least = np.where(enough.any(axis=1), sizes[np.argmax(enough, axis=1)], np.inf)
    median = float(np.sort(least)[(len(least) - 1) // 2])
    return median if np.isfinite(median) else None
