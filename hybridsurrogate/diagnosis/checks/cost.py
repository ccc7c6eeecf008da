"""What a search costs that runs the simulation itself."""

from __future__ import annotations

import warnings
from time import perf_counter

import numpy as np

from hybridsurrogate.diagnosis.checks.settings import SETTINGS
from hybridsurrogate.exceptions import DiagnosisWarning
from hybridsurrogate.model.problem import Problem
from hybridsurrogate.numerics.digits import number


def seconds_a_run(problem: Problem) -> float:
    """Return the seconds that the simulation takes for one set of parameters at the measured rows.

    Zero for an emulator. More sets are timed where few look slow, while each takes far less of
    them than of fewer.
    """
    model = problem.model
    each = np.inf
    if not model.basis.is_simulation:
        return 0.0
    for n in SETTINGS.timed_runs:
        # other sets each time: outputs that are known already take no time
        z = np.random.RandomState().standard_normal((n, model.n_unknowns))
        start = perf_counter()
        model.simulated(problem.X, model.values(z))
        before, each = each, (perf_counter() - start) / n
        if each < SETTINGS.slow_run or each > SETTINGS.gain_of_many * before:
            break
    return each


def warn_if_slow(problem: Problem, n_folds: int | None = None) -> None:
    """Warn the caller of ``fit`` where the simulation is too slow to be run in a search.

    Parameters
    ----------
    problem : Problem
    n_folds : int or None, default=None
        Of the cross-validation, each with a separate search.
    """
    each = seconds_a_run(problem)
    folds = 0 if n_folds is None else n_folds
    sets = SETTINGS.runs_of_a_search * (1 + SETTINGS.cost_of_a_fold * folds)
    if each * sets < SETTINGS.slow_search:
        return
    thousands = round(sets, -3)
    without = "" if n_folds is None else " cv=None leaves the folds out."
    warnings.warn(
        f"The simulation takes {number(1000 * each, 2)} ms for one set of parameters, and this "
        f"diagnosis runs about {thousands:,.0f} of them, {thousands * len(problem.y):,.0f}"
        f" rows: about {number(each * sets / 60, 2)} minutes. With "
        "surrogate=None runs of it are made and searched in seconds, as with "
        f"simulation=simulator.run(200, n_jobs=-1) and surrogate=Kriging().{without}",
        DiagnosisWarning,
        stacklevel=4,
    )
