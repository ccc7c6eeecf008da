"""The gain on rows held out, the whole diagnosis repeated without them."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from itertools import pairwise
from pickle import PicklingError
from typing import Any

import numpy as np
from joblib import Parallel, delayed
from numpy.random import RandomState
from numpy.typing import NDArray
from sklearn.model_selection import KFold

from hybridsurrogate.diagnosis.validation.gain import Held, HeldOutGain, gain_over, pointwise
from hybridsurrogate.diagnosis.validation.refit import Refit
from hybridsurrogate.exceptions import DiagnosisWarning, HybridSurrogateWarning
from hybridsurrogate.model.rows.measured_data import GivenRows
from hybridsurrogate.notebook import for_a_person
from hybridsurrogate.simulation.simulator import SimulationData, Simulator
from hybridsurrogate.types import FloatArray

# how a count of folds is written
_COUNT = "{desc} {n_fmt} of {total_fmt} ({elapsed})"


def in_parallel(tasks: Sequence[Any], n_jobs: int | None, progress: bool = False) -> list[Any]:
    """Return what `joblib.delayed` tasks return, from this process where no other can have them.

    Parameters
    ----------
    tasks : sequence of joblib.delayed calls
    n_jobs : int or None
        As in `joblib.Parallel`.
    progress : bool
        Print on a terminal how many were begun; in this process, how many are done.

    Examples
    --------
    >>> from joblib import delayed
    >>> from hybridsurrogate.diagnosis.validation.cross_validation import in_parallel
    >>> in_parallel([delayed(abs)(-1), delayed(abs)(2)], n_jobs=None)
    [1, 2]
    """
    try:
        # not return_as="generator", which joblib's "multiprocessing" refuses
        return list(Parallel(n_jobs=n_jobs)(for_a_person("Folds", progress, tasks, _COUNT)))
    except PicklingError:
        # a finished search is not lost because a simulation holds a lock or an open file
        warnings.warn(
            "The folds ran in this process: the simulation or a cause cannot be sent to another "
            "one. Write its function as `def name(...)` at the top of a module, without open files "
            "or locks around it, and pass that; or use n_jobs=None.",
            DiagnosisWarning,
            stacklevel=6,
        )
        return list(Parallel(n_jobs=1)(for_a_person("Folds", progress, tasks, _COUNT)))


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
    >>> from hybridsurrogate.diagnosis.validation.cross_validation import future_folds
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


def cross_validated(
    refitted: Refit,
    within: Folds,
    beyond: Folds,
    rows: GivenRows,
    n_jobs: int | None,
    progress: bool = False,
) -> tuple[HeldOutGain | None, HeldOutGain | None]:
    """Return the gain within the measured range and beyond it, None where there are no folds.

    Parameters
    ----------
    refitted : Refit
        Returns the models before and after for given rows, from a search on them.
    within, beyond : list of (train, test)
    rows : GivenRows
        Measured; weights count in the fits and in the means of their scores.
    n_jobs : int or None
        Folds at the same time, as in `joblib.Parallel`.
    progress : bool
        Count the folds on a terminal.
    """
    tasks = [
        delayed(score_fold)(refitted, rows.take(train), rows.take(test))
        for train, test in [*within, *beyond]
    ]
    scored: list[tuple[Held, list[str]]] = in_parallel(tasks, n_jobs, progress)
    doubtful = sorted({doubt for _, doubts in scored for doubt in doubts})
    if doubtful:
        warnings.warn(
            f"{len(doubtful)} of the fits behind the gain have doubtful draws, for example: "
            f"{doubtful[0]}",
            DiagnosisWarning,
            stacklevel=5,
        )
    held = [one for one, _ in scored]
    inside, outside = held[: len(within)], held[len(within) :]
    return gain_over(inside) if inside else None, gain_over(outside) if outside else None


def score_fold(refitted: Refit, train: GivenRows, test: GivenRows) -> tuple[Held, list[str]]:
    """Return the scores of the models before and after on held-out rows, and doubtful fits.

    Its warnings are part of what it returns: those of another process would be lost.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", HybridSurrogateWarning)
        plain, extended, kind = refitted(*train)
        before = pointwise(plain, *test)
        after = before if extended is plain else pointwise(extended, *test)
    return Held(before, after, kind), [
        str(w.message) for w in caught if "doubtful" in str(w.message)
    ]
