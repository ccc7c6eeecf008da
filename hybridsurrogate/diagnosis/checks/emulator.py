"""How well the runs, and the surrogate through them, tell the simulation at the measured rows."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from hybridsurrogate.diagnosis.search.evidence import Search
from hybridsurrogate.exceptions import DiagnosisWarning
from hybridsurrogate.inference.conjugate.emulator_posterior import emulator_posterior
from hybridsurrogate.simulation.simulator import SimulationData
from hybridsurrogate.surrogates import Kriging
from hybridsurrogate.surrogates.base import Surrogate
from hybridsurrogate.surrogates.basis import Basis

# more than the noise hides, in its standard deviations; measured rows mend some of what is missed
MOST_OPEN, MOST_MISSED = 1.0, 2.0


def advice(surrogate: Surrogate | None) -> str:
    """Return what to do about a surrogate that misses the simulation."""
    return "give more runs" if isinstance(surrogate, Kriging) else "try Kriging() or more runs"


class EmulatorCheck(NamedTuple):
    """What the runs and the surrogate tell of the simulation at the measured rows.

    Root mean squares over these rows, in standard deviations of the noise, and rows beyond.

    Attributes
    ----------
    left_open : float
        What the runs do not tell of the simulation. It is part of every comparison of the search.
    missed : float
        What the surrogate, trained on the runs alone, misses of what they do tell. The search does
        without it; the estimators predict with it.
    beyond : dict of str to int
        Measured rows that lie further out along an input than every run, by its name.
    """

    left_open: float
    missed: float
    beyond: dict[str, int]

    def warn(self, surrogate: Surrogate) -> None:
        """Warn where the noise does not hide it."""
        if self.left_open > MOST_OPEN:
            warnings.warn(
                f"At the measured rows the runs leave the simulation open by {self.left_open:.1f} "
                "times the noise: effects that are not larger cannot be found. Give more runs, or "
                "the simulation itself with surrogate=ExactSurrogate().",
                DiagnosisWarning,
                stacklevel=4,
            )
        if self.missed > MOST_MISSED:
            warnings.warn(
                f"At the measured rows {type(surrogate).__name__}, trained on the runs alone, "
                f"misses the simulation by {self.missed:.1f} times the noise. The search does "
                f"without it, but what is predicted rests on it: {advice(surrogate)}.",
                DiagnosisWarning,
                stacklevel=4,
            )


def check_emulator(result: Search, surrogate: Basis, runs: SimulationData) -> EmulatorCheck | None:
    """Return how well the surrogate's basis tells the simulation at the best fit of all.

    None where the simulation itself is run, or its runs leave nothing open.
    """
    problem = result.problem
    if not problem.model.basis.leaves_open:
        return None
    w = result.candidates[int(np.argmax(result.probability))]
    values = w.model.values(w.mode.z[None])
    if len(w.grid.nodes):
        values[:, w.grid.nodes] = w.grid.points[w.mode.node]
    U = w.model.emulator_error(problem.X, values, result.emulator.factor)
    outputs, _, noise = w.model.simulated(problem.X, values, result.emulator.mean)
    own = emulator_posterior(surrogate, problem.simulation).mean
    alone = replace(w.model, basis=surrogate, reference=own)
    missed = alone.simulated(problem.X, values, own)[0] - outputs
    # outputs, rows and counts have a noise of their own: of counts sigma is one
    unit = noise[0]
    squares = np.sum(U**2, axis=1) / unit**2, (missed / unit) ** 2
    rms = np.sqrt([np.mean(each) for each in squares]) / w.sigma
    X = problem.X[:, : runs.X.shape[1]]
    low, high = runs.X.min(axis=0), runs.X.max(axis=0)
    outside = np.sum((low > X) | (high < X), axis=0).tolist()
    beyond = {name: k for name, k in zip(runs.input_names, outside, strict=True) if k}
    left_open, missed_by = rms.tolist()
    return EmulatorCheck(left_open, missed_by, beyond)
