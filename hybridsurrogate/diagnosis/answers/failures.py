"""Parameters for which the simulation itself fails."""

from __future__ import annotations

import numpy as np

from hybridsurrogate.diagnosis.search.search import Search
from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.types import FloatArray

# sets of parameters that are tried for each cause
_TRIED = 64


def failures(result: Search) -> list[str]:
    """Return for each compared cause how often the simulation fails under it, "" for never.

    Sets of parameters from the priors, of the simulation and of the cause, are run at the measured
    rows. A set that fails anywhere is impossible: its density is zero, and the search passes it by.
    Only a simulation that is run directly can fail; an emulator has learned from runs that
    worked.
    """
    counts = [
        _count(w.fit.model, result.problem.X)
        if w.cause is None or w.cause.touches_simulation
        else 0
        for w in result.candidates
    ]
    return [
        f"the simulation fails for {count} of {_TRIED} sets of parameters from the priors, which "
        "count as impossible"
        if count
        else ""
        for count in counts
    ]


def _count(model: MeasuredModel, X: FloatArray) -> int:
    if not model.basis.is_simulation or not model.n_unknowns:
        return 0
    # a fixed spread, so that a table is reproducible
    z = np.random.RandomState(0).standard_normal((_TRIED, model.n_unknowns))
    known, _, _ = model.simulated(X, model.values(z))
    return int(np.sum(~np.isfinite(known).all(axis=1)))
