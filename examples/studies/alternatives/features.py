"""What a tool for regression gets to see: the recorded columns and the simulation's output."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from hidden_effects.simulations import Array

from .calibration import Calibrated


@dataclass(frozen=True)
class Features:
    """Scaled columns: inputs from 0 to 1 over the measured rows, recorded ones standardised.

    The simulation's output is only divided by its spread: a gain is a factor on all of it.
    ``words`` says what a term that is linear in the column would be called.
    """

    calibrated: Calibrated
    words: tuple[str, ...]
    centre: Array
    scale: Array

    def __call__(self, X: Array) -> Array:
        """Return the columns at any rows."""
        return (_raw(self.calibrated, X) - self.centre) / self.scale


def features(calibrated: Calibrated) -> Features:
    """Scale the columns by the measured rows."""
    problem = calibrated.problem
    raw = _raw(calibrated, problem.X)
    p, n_extras = len(problem.simulator.input_names), problem.X.shape[1]
    centre, scale = raw.mean(axis=0), raw.std(axis=0)
    centre[:p], scale[:p] = raw[:, :p].min(axis=0), np.ptp(raw[:, :p], axis=0)
    centre[-1] = 0.0
    words = ("trend",) * p + ("missing-input",) * (n_extras - p) + ("gain",)
    return Features(calibrated, words, centre, scale)


def _raw(calibrated: Calibrated, X: Array) -> Array:
    return np.column_stack([X, calibrated.predict(X)])
