"""The smallest fault that would have shown in these rows, with these runs and priors."""

from __future__ import annotations

import numpy as np

from hybridsurrogate.diagnosis.search.evidence import Search
from hybridsurrogate.diagnosis.search.null_test import NullTest, replicates, statistics
from hybridsurrogate.priors import FloatArray
from hybridsurrogate.simulation.outputs import OUTPUT

# data sets of each shape and size; sizes in units of what the null leaves, after one scaling
_SETS, _SIZES = 8, np.geomspace(0.25, 16.0, 7)
# share of the data sets in which a fault has to show
_POWER = 0.9


def smallest_detectable(result: Search, test: NullTest | None, rate: float) -> float | None:
    """Return the root mean square of the smallest fault that would have been detected.

    Faults of a few shapes, a step in the middle and a straight line over each input, are added to
    replicates of "nothing is wrong". A fault of some size shows where the p-value of the whole
    search is at most ``rate`` in nine of ten replicates. The median over the shapes is returned:
    a parameter of the simulation may absorb one shape, and not the others.

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
    shapes = _shapes(result)
    if test is None or not len(shapes):
        return None
    limit = float(np.quantile(test.replicates, 1 - rate, method="higher"))
    # a fixed stream: a verdict has no randomness of its own
    null = replicates(result, _SETS, np.random.RandomState(0))
    unit = float(np.std(null - null.mean(axis=0)))
    sizes = unit * _SIZES
    # shape, size, data set, row
    data = null + sizes[:, None, None] * shapes[:, None, None, :]
    shown = statistics(result, data.reshape(-1, null.shape[1])) > limit
    power = shown.reshape(len(shapes), len(sizes), _SETS).mean(axis=2)
    return _median_size(power, sizes)


def _median_size(power: FloatArray, sizes: FloatArray) -> float | None:
    """Return the median over shapes of the size from which on all larger ones show."""
    enough = np.flip(np.cumprod(np.flip(power >= _POWER, axis=1), axis=1), axis=1).astype(bool)
    least = np.where(enough.any(axis=1), sizes[np.argmax(enough, axis=1)], np.inf)
    median = float(np.sort(least)[(len(least) - 1) // 2])
    return median if np.isfinite(median) else None


def _shapes(result: Search) -> FloatArray:
    """Return curves of unit root mean square over the rows, (k, n)."""
    model, X = result.problem.model, result.problem.X
    out = []
    for k in range(model.n_inputs):
        x = X[:, k]
        if model.columns[k] == OUTPUT or np.ptp(x) == 0:
            continue
        out += [(x > np.median(x)).astype(float), (x - x.mean()) / np.std(x)]
    curves = np.array(out).reshape(-1, len(X))
    return curves / np.sqrt(np.mean(curves**2, axis=1, keepdims=True))
