"""How rough a simulation is: over which steps its slopes mean something.

Rounded output, the loose tolerance of a solver, a table that is looked up or random numbers of its
own make an output jump where parameters hardly change. A difference over a short step is then a
jump divided by next to nothing, or zero between two jumps.
"""

from __future__ import annotations

import warnings
from itertools import pairwise

import numpy as np

from hybridsurrogate.estimators.problem import Problem
from hybridsurrogate.exceptions import DiagnosisWarning
from hybridsurrogate.inference.measured import MeasuredModel
from hybridsurrogate.priors import FloatArray

# steps in standard deviations of the priors, and places at which slopes over two are compared
_STEPS = (1e-3, 1e-2, 1e-1)
_PLACES = 20
# slopes that differ by this share of their size, root mean square over rows and then averaged over
# places, disagree: smooth ones by some 1e-4, those of an output with a kink by 0.02, of one that
# jumps by 0.7 or more
_DISAGREE = 0.2
# of a simulation that runs away more is not to be squared
_ABSURD = 1e100
# jumps of this share of the noise hide effects
_LARGE = 0.25


def difference_step(model: MeasuredModel, X: FloatArray) -> float:
    """Return the shortest step over which slopes agree with those over one ten times as long.

    Without causes. The shortest, a thousandth of a standard deviation of the priors, does if slopes
    over one ten times shorter agree, too: those of a fast oscillation. The longest, a tenth, where
    none agree.
    """
    if not model.n_parameters:
        return _STEPS[0]
    slopes = _slopes(model, X, _STEPS[0])
    shorter = _slopes(model, X, _STEPS[0] / 10)
    # what hardly ever changes over so short a step may be about to jump
    changes = np.any(shorter != 0, axis=2).mean(axis=0) > 0.5
    is_smooth = changes & (_disagreement(shorter, slopes) <= _DISAGREE)
    for step, longer_step in pairwise(_STEPS):
        longer = _slopes(model, X, longer_step)
        if np.all(is_smooth | (_disagreement(slopes, longer) <= _DISAGREE)):
            return step
        slopes = longer
    return _STEPS[-1]


def _disagreement(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return by which share of their size slopes (places, d, n) differ, (d,)."""
    size = np.maximum(np.linalg.norm(a, axis=2), np.linalg.norm(b, axis=2))
    there = size > 0
    # a place says no more than another one, however large its slopes, and nothing without any
    share = np.linalg.norm(a - b, axis=2) / np.where(there, size, 1.0)
    averaged: FloatArray = share.sum(axis=0) / np.maximum(there.sum(axis=0), 1)
    return averaged


def warn_if_rough(problem: Problem) -> None:
    """Warn the caller of ``fit`` where the simulation jumps by much of the noise.

    Jumps are measured by second differences over the longest step around the best fit that is
    known: of independent jumps these have six times the variance.
    """
    model = problem.model
    if not model.basis.is_simulation or model.step < _STEPS[-1]:
        return
    ahead, behind = np.swapaxes(_around(model, problem.X, problem.good, model.step), 0, 1)
    best = _output(model, problem.X, problem.good)
    second = ahead + behind - 2 * best[:, None]
    jump = float(np.sqrt(np.mean(second[np.isfinite(second)] ** 2) / 6))
    noise = float(np.std(problem.y - best[0]))
    if not jump > _LARGE * noise:
        return
    warnings.warn(
        f"The simulation is rough: its output jumps by about {jump:.2g} where parameters change "
        f"by a tenth of a standard deviation of their priors, and what it misses is {noise:.2g}. "
        "Is the output rounded, is a solver's tolerance loose, or does it draw random numbers? "
        "Effects of this size get lost. A smoother output helps, or runs of it: "
        "simulator.run(200) with surrogate=PolynomialChaos() averages over jumps.",
        DiagnosisWarning,
        stacklevel=3,
    )


def _slopes(model: MeasuredModel, X: FloatArray, step: float) -> FloatArray:
    """Return slopes (places, d, n) at places of the priors, zero where the simulation fails."""
    # a fixed spread, as the search has no randomness of its own
    z = np.random.RandomState(0).standard_normal((_PLACES, model.n_parameters))
    around = _around(model, X, z, step)
    with np.errstate(invalid="ignore", over="ignore"):
        slopes: FloatArray = (around[:, 0] - around[:, 1]) / (2 * step)
    slopes[~(np.abs(slopes) < _ABSURD)] = 0.0
    return slopes


def _around(model: MeasuredModel, X: FloatArray, z: FloatArray, step: float) -> FloatArray:
    """Return outputs (places, 2, d, n) a step ahead of and behind z (places, d)."""
    d = z.shape[1]
    points = z[:, None] + step * np.vstack([np.eye(d), -np.eye(d)])
    return _output(model, X, points.reshape(-1, d)).reshape(len(z), 2, d, len(X))


def _output(model: MeasuredModel, X: FloatArray, z: FloatArray) -> FloatArray:
    """Return the simulation's output (J, n) at z (J, d)."""
    return model.simulated(X, model.values(z), model.basis.coefficient_mean)[0]
