"""Which rows are held out, and when."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.random import RandomState
from numpy.typing import ArrayLike, NDArray
from sklearn.model_selection import KFold

from hybridsurrogate.simulation.simulator import SimulationData, Simulator
from hybridsurrogate.types import FloatArray

Folds = list[tuple[NDArray[np.intp], NDArray[np.intp]]]

# the last part of the rows is predicted from all that came before, block after block
_FUTURE_SHARE, _FUTURE_BLOCKS = 0.4, 3
# rows from which a first search may learn something
_MIN_PAST = 12


def random_folds(n: int, n_folds: int, random_state: RandomState | int) -> Folds:
    """Return (train, test) rows of folds drawn at random, at least two rows in each."""
    folds = KFold(min(n_folds, n // 2), shuffle=True, random_state=random_state)
    return list(folds.split(np.zeros(n)))


def folds_beyond(simulation: SimulationData | Simulator, X: FloatArray) -> Folds:
    """Return `future_folds` of the measured rows X, none where "beyond them" has many meanings.

    It has one along the only input of a simulation; in time, the first input of an `OdeSimulator`;
    and along an input by which the rows come sorted, as those of a log do.
    """
    simulator = simulation.simulator
    n_inputs = len(simulation.input_names)
    if n_inputs == 1 or (simulator is not None and simulator.is_in_time):
        return future_folds(X[:, 0])
    for x in X[:, :n_inputs].T:
        # the slow column of a grid is sorted, too, and its few values are no time
        if np.all(np.diff(x) >= 0) and 2 * len(np.unique(x)) > len(x):
            return future_folds(x)
    return []


def future_folds(x: FloatArray) -> Folds:
    """Return (train, test) rows in which the test rows lie beyond the training rows.

    The last 40 % of the rows are cut into three blocks of about the same size, each predicted from
    all rows before it (Burkner, Gabry and Vehtari 2020, Journal of Statistical Computation and
    Simulation 90:2499). Rows of equal x stay together.

    Parameters
    ----------
    x : ndarray of shape (n,)
        What orders the rows, such as time.

    Returns
    -------
    list of (train, test)
        Empty where fewer than 12 rows would be left for the first search.

    Examples
    --------
    >>> import numpy as np
    >>> from hybridsurrogate.diagnosis.validation.folds import future_folds
    >>> [(len(train), test.tolist()) for train, test in future_folds(np.arange(30.0)[::-1])]
    [(18, [11, 10, 9, 8]), (22, [7, 6, 5, 4]), (26, [3, 2, 1, 0])]
    """
    n = len(x)
    order = np.argsort(x, kind="stable")
    wanted = np.linspace((1 - _FUTURE_SHARE) * n, n, _FUTURE_BLOCKS + 1).round().astype(int)
    # a cut between rows of equal x moves up to the next larger x
    ends = [int(np.searchsorted(x[order], x[order[k]], "left")) for k in wanted[:-1]]
    ends = sorted({*(e for e in ends if e >= _MIN_PAST), n})
    return [(order[:a], order[a:b]) for a, b in pairwise(ends)]


def row_taker(X: ArrayLike) -> Callable[[Any], Any]:
    """Return a function from row numbers to rows of an array or a DataFrame."""
    return X.iloc.__getitem__ if hasattr(X, "iloc") else np.asarray(X).__getitem__
