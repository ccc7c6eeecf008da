"""What a search costs that runs the simulation itself."""

from __future__ import annotations

import warnings
from time import perf_counter

import numpy as np

from hybridsurrogate.digits import number
from hybridsurrogate.exceptions import DiagnosisWarning
from hybridsurrogate.problem.problem import Problem

# sets of parameters that a search runs at least: 33 000 to 112 000 with two parameters, 40 rows
_RUNS = 30_000
# seconds for one set of parameters from which a search takes minutes
_SLOW = 0.005
# sets that are timed: many at once may take hardly longer than two
_TIMED = (2, 200)


def seconds_a_run(problem: Problem) -> float:
    """Return the seconds that the simulation takes for one set of parameters at the measured rows.

    Zero for an emulator. Many sets are timed where two look slow.
    """
    model = problem.model
    each = 0.0
    if not model.basis.is_simulation:
        return each
    for n in _TIMED:
        z = np.random.RandomState(0).standard_normal((n, model.n_unknowns))
        start = perf_counter()
        model.simulated(problem.X, model.values(z))
        each = (perf_counter() - start) / n
        if each < _SLOW:
            break
    return each


def warn_if_slow(problem: Problem) -> None:
    """Warn the caller of ``fit`` where the simulation is too slow to be run in a search."""
    each = seconds_a_run(problem)
    if each < _SLOW:
        return
    warnings.warn(
        f"The simulation takes {number(1000 * each, 2)} ms for one set of parameters, and a search "
        f"runs at least {_RUNS} of them: {number(_RUNS * each / 60, 2)} minutes or much more, and "
        "several times as many with folds. Runs of it, simulator.run(200) with "
        "surrogate=Kriging(), are searched in seconds; cv=None leaves the folds out.",
        DiagnosisWarning,
        stacklevel=3,
    )
