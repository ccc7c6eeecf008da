"""What a search costs that runs the simulation itself."""

from __future__ import annotations

import warnings
from time import perf_counter

import numpy as np

from hybridsurrogate.diagnosis.checks.settings import SETTINGS
from hybridsurrogate.digits import number
from hybridsurrogate.exceptions import DiagnosisWarning
from hybridsurrogate.problem.problem import Problem


def seconds_a_run(problem: Problem) -> float:
    """Return the seconds that the simulation takes for one set of parameters at the measured rows.

    Zero for an emulator. Many sets are timed where two look slow.
    """
    model = problem.model
    each = 0.0
    if not model.basis.is_simulation:
        return each
    for n in SETTINGS.timed_runs:
        z = np.random.RandomState(0).standard_normal((n, model.n_unknowns))
        start = perf_counter()
        model.simulated(problem.X, model.values(z))
        each = (perf_counter() - start) / n
        if each < SETTINGS.slow_run:
            break
    return each


def warn_if_slow(problem: Problem) -> None:
    """Warn the caller of ``fit`` where the simulation is too slow to be run in a search."""
    each = seconds_a_run(problem)
    if each < SETTINGS.slow_run:
        return
    runs = SETTINGS.runs_of_a_search
    warnings.warn(
        f"The simulation takes {number(1000 * each, 2)} ms for one set of parameters, and a search "
        f"runs at least {runs} of them: {number(runs * each / 60, 2)} minutes or much more, and "
        "several times as many with folds. Runs of it, simulator.run(200) with "
        "surrogate=Kriging(), are searched in seconds; cv=None leaves the folds out.",
        DiagnosisWarning,
        stacklevel=3,
    )
